# SPDX-License-Identifier: GPL-3.0-or-later
"""A street seen by a walking camera: faces with a tolerance in pixels over the shot, and with one length for all.

python benchmarks/street.py [PICTURE.png]        with the bpy wheel

Objects stand on both sides of a street, and a camera walks along it; then the street is one object; and then hills of
few faces. The length for all is the least that a face has by pixels. On every tenth frame, samples of the limit
surface, by Blender's own modifier at a deep level, are compared with the nearest points of the result: the farthest
apart that their images are, in pixels, among all inside the image. A surface point may have a drawn one nearer in the
image, so the figure is no less than the true one. PICTURE is a render of the result on the last frame.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
import numpy as np
from mathutils import Matrix
from mathutils.bvhtree import BVHTree

import ccdepth_addon
from tests.blender import scene

PIXELS, WIDTH, HEIGHT = 0.5, 1280, 720
PLACES, APART, ASIDE = 8, 5.0, 3.0
FRAMES, STEP, WALKED = 60, 10, 12.0
DEEP = 5

Points = np.ndarray


def add_street() -> list[bpy.types.Object]:
    """Suzannes and tori in turn on both sides of the y axis, smooth."""
    made = []
    for place in range(PLACES):
        for side in (-1, 1):
            if (place + side) % 4 in (0, 1):
                bpy.ops.mesh.primitive_monkey_add()
            else:
                bpy.ops.mesh.primitive_torus_add(
                    major_segments=12, minor_segments=8, major_radius=0.8, minor_radius=0.35
                )
            own = bpy.context.object
            own.location = (side * ASIDE, 4.0 + APART * place, 1.0)
            own.rotation_euler = (0.3 * place, 0.0, side * 0.8)
            own.data.shade_smooth()
            made.append(own)
    return made


def add_camera() -> None:
    """A camera that walks along the street for the scene's frames."""
    current = bpy.context.scene
    current.render.resolution_x, current.render.resolution_y, current.render.resolution_percentage = WIDTH, HEIGHT, 100
    current.frame_start, current.frame_end = 1, FRAMES
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    current.collection.objects.link(camera)
    camera.rotation_euler = (np.radians(88), 0.0, 0.0)
    for frame, y in ((1, -3.0), (FRAMES, -3.0 + WALKED)):
        camera.location = (0.0, y, 1.6)
        camera.keyframe_insert("location", frame=frame)
    current.camera = camera


def subdivided(objects: list[bpy.types.Object], **settings: object) -> list[bpy.types.Object]:
    """The results of objects, in their order; the objects are shown again."""
    results = []
    for each in objects:
        each.hide_set(False)
        bpy.ops.object.select_all(action="DESELECT")
        each.select_set(True)
        bpy.context.view_layer.objects.active = each
        bpy.ops.ccdepth.subdivide(shading_angle=0.0, **settings)
        results.append(bpy.context.object)
    return results


def samples(holder: bpy.types.Object) -> Points:
    """(N, 3): points of the limit surface, in the scene."""
    copy = holder.copy()
    bpy.context.scene.collection.objects.link(copy)
    modifier = copy.modifiers.new("Deep", "SUBSURF")
    modifier.levels, modifier.quality, modifier.use_limit_surface = DEEP, 10, True
    bpy.context.view_layer.update()
    evaluated = copy.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = scene.values_of(evaluated.data.vertices, "co", np.float32, 3).astype(np.float64)
    bpy.data.objects.remove(copy)
    return moved(found, holder.matrix_world)


def moved(points: Points, matrix: Matrix) -> Points:
    return points @ np.array(matrix.to_3x3()).T + np.array(matrix.translation)


def nearest(points: Points, result: bpy.types.Object) -> Points:
    """(N, 3): the points of a result that are nearest to points."""
    corners = moved(scene.mesh_data(result.data).positions.astype(np.float64), result.matrix_world)
    tree = BVHTree.FromPolygons(corners.tolist(), scene.triangles_of(result.data).tolist())
    return np.array([tree.find_nearest(point)[0] for point in points.tolist()])


def images(points: Points, camera: bpy.types.Object) -> tuple[Points, Points]:
    """(N, 2): the images of points in pixels from the middle; and (N,): their depths."""
    seen = moved(points, camera.matrix_world.inverted())
    depths = -seen[:, 2]
    focal = camera.data.lens / camera.data.sensor_width * WIDTH
    return focal * seen[:, :2] / np.maximum(depths, 1e-9)[:, None], depths


def compare(objects: list[bpy.types.Object]) -> None:
    """Print faces and errors in pixels of objects, and the faces with one length for all."""
    current = bpy.context.scene
    results = subdivided(objects, tolerance_mode="PIXELS", tolerance=PIXELS)
    lengths = [each.data.ccdepth.world_tolerance for each in results]
    faces = sum(len(each.data.polygons) for each in results)
    print(f"in pixels: {faces:,} faces, within {min(lengths):.2g} of the scene at least", flush=True)
    pairs = [(points, nearest(points, result)) for points, result in zip(map(samples, objects), results, strict=True)]
    for frame in range(1, FRAMES + 1, STEP):
        current.frame_set(frame)
        farthest = 0.0
        for points, drawn in pairs:
            (of_surface, depths), (of_drawn, _) = images(points, current.camera), images(drawn, current.camera)
            inside = (np.abs(of_surface) <= (WIDTH / 2, HEIGHT / 2)).all(axis=1) & (
                depths > current.camera.data.clip_start
            )
            apart = np.linalg.norm(of_surface - of_drawn, axis=1)[inside]
            farthest = max(farthest, float(apart.max(initial=0.0)))
        print(f"frame {frame:3}: at most {farthest:.3f} of {PIXELS} pixels", flush=True)
    others = subdivided(objects, tolerance_mode="ABSOLUTE", tolerance=min(lengths))
    same = sum(len(each.data.polygons) for each in others)
    print(f"one length for all, {min(lengths):.2g}: {same:,} faces, {same / faces:.1f} times as many", flush=True)
    for each in others:
        bpy.data.objects.remove(each)


def joined(objects: list[bpy.types.Object]) -> bpy.types.Object:
    """One object with copies of all objects."""
    for each in objects:
        each.hide_set(False)
    bpy.ops.object.select_all(action="DESELECT")
    for each in objects:
        each.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]
    bpy.ops.object.duplicate()
    bpy.ops.object.join()
    return bpy.context.object


def hills() -> bpy.types.Object:
    """Hilly ground of 128 faces below the street, from behind the camera to beyond the last object."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=16, size=1)
    own = bpy.context.object
    for vertex in own.data.vertices:
        x, y, _ = vertex.co
        vertex.co = 24 * x, 18 + 48 * y, 0.5 * np.sin(7 * x) * np.cos(19 * y)
    return own


def main() -> None:
    ccdepth_addon.register()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    objects = add_street()
    add_camera()
    bpy.context.scene.ccdepth.camera_frames = "SCENE"
    print("each object by itself")
    compare(objects)
    if len(sys.argv) > 1:
        for each in objects:
            each.hide_render = True
        render(Path(sys.argv[1]))
    print("the street as one object")
    compare([joined(objects)])
    print("hills below it")
    compare([hills()])


def render(path: Path) -> None:
    current = bpy.context.scene
    current.render.engine = "BLENDER_WORKBENCH"
    current.display.shading.light = "MATCAP"
    current.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
