# SPDX-License-Identifier: GPL-3.0-or-later
"""The faces, triangles and seconds of adaptive subdivision with an angle of shading beside the tolerance.

python benchmarks/normals.py -- [NAME…]        with the bpy wheel

Tolerance: 1e-3 of the diagonal; angles in degrees, 0 for the distance alone. The last columns are the processor seconds
of the core, and the time of each face in parts of that without an angle.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np

from ccdepth_addon.core.adaptive.planner import subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from tests import meshes
from tests.blender import scene

TOLERANCE, ANGLES, MOST_FACES = 1e-3, (0, 10, 5, 3, 2), 1_000_000


def bevelled(blender_object: bpy.types.Object, width: float) -> bpy.types.Object:
    """The object with a bevel of two segments applied."""
    modifier = blender_object.modifiers.new("Bevel", "BEVEL")
    modifier.width, modifier.segments = width, 2
    bpy.context.view_layer.objects.active = blender_object
    bpy.ops.object.modifier_apply(modifier=modifier.name)
    return blender_object


def chair() -> bpy.types.Object:
    """A seat and four legs, bevelled."""
    legs = [((x, y, -0.5), (0.12, 0.12, 0.9)) for x in (-0.42, 0.42) for y in (-0.42, 0.42)]
    parts = []
    for place, scale in [((0, 0, 0), (1, 1, 0.15)), *legs]:
        bpy.ops.mesh.primitive_cube_add(size=1, location=place)
        parts.append(bpy.context.object)
        parts[-1].scale = scale
        bpy.ops.object.transform_apply(scale=True)
    for each in parts:
        each.select_set(True)
    bpy.ops.object.join()
    return bevelled(bpy.context.object, 0.03)


def bevelled_cube() -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add()
    return bevelled(bpy.context.object, 0.1)


def torus() -> bpy.types.Object:
    bpy.ops.mesh.primitive_torus_add(major_segments=12, minor_segments=8)
    return bpy.context.object


MODELS: dict[str, Callable[[], bpy.types.Object]] = {
    "Suzanne": scene.add_suzanne,
    "chair": chair,
    "bevelled cube": bevelled_cube,
    "torus 12 x 8": torus,
}


def main(names: list[str]) -> None:
    for name in names or MODELS:
        alone = 0.0
        for angle in ANGLES:
            scene.clear()
            mesh = scene.polygon_mesh_of(MODELS[name]().data)
            limit = TOLERANCE * meshes.diagonal(mesh)
            request = AdaptiveRequest(limit, Mode.ADAPTIVE, MOST_FACES, shading=float(np.radians(angle)))
            begun = process_time()
            found = subdivide_adaptively(mesh, request, mesh.positions)
            seconds = process_time() - begun
            faces = len(found.bounds)
            triangles = int((np.diff(found.mesh.face_starts) - 2).sum())
            alone = alone or seconds / faces
            print(
                f"{name:16} {angle:3}°  {faces:7,} faces  {triangles:7,} triangles  {found.narrow_count:4} narrow"
                f"  {seconds:6.2f} s  {seconds / faces / alone:5.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else [])
