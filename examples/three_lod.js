// SPDX-License-Identifier: GPL-3.0-or-later
// The levels of detail of a .glb file that CC Depth wrote with --lods, as objects of three.js:
//
//   const gltf = await new GLTFLoader().loadAsync("model.glb");
//   useLevels(gltf.scene, renderer.domElement.height / fileHeight);

import { Box3, LOD, Sphere } from "three";

// Replace each set of levels below a root by a THREE.LOD. The file's distances are for one height and field of view of
// the view; scale: how many times as large height / tan(angle / 2) of your view is.
export function useLevels(root, scale = 1) {
  const sets = new Map();
  root.updateWorldMatrix(true, true);
  root.traverse((node) => {
    if ("ccdepth_level" in node.userData) sets.set(node.parent, [...(sets.get(node.parent) ?? []), node]);
  });
  for (const [parent, levels] of sets) {
    const sphere = new Box3().setFromObject(levels[0]).getBoundingSphere(new Sphere());
    const lod = new LOD();
    lod.position.copy(parent.worldToLocal(sphere.center.clone()));
    for (const { level, distance } of levels.map((node) => ({ level: node, distance: node.userData.ccdepth_distance }))) {
      level.position.sub(lod.position);
      // THREE.LOD measures from the centre, and the file from the nearest point.
      const isFinest = level.userData.ccdepth_level === 0;
      lod.addLevel(level, isFinest ? 0 : distance * scale + sphere.radius);
    }
    parent.add(lod);
  }
}
