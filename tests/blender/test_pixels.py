# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances in pixels: images of results against the surface, lengths by hand, frames, instances, and refusals."""

import json
from collections.abc import Callable
from itertools import pairwise
from math import hypot, sqrt
from pathlib import Path

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import run, save
from tests.blender.subdividing import faces, known_count, refuses

PIXELS = 0.5
WIDTH, HEIGHT = 960, 540

# Of a lens of 50 mm on a sensor of 36 mm, in pixels.
FOCAL = 50 / 36 * WIDTH


@pytest.fixture(autouse=True)
def camera() -> bpy.types.Object:
    """The scene's camera, at the origin, which looks along the negative z axis; and the tolerance in pixels."""
    current = bpy.context.scene
    current.render.resolution_x, current.render.resolution_y = WIDTH, HEIGHT
    current.camera = scene.add("Camera", bpy.data.cameras.new("Camera"))
    current.ccdepth.tolerance_mode, current.ccdepth.shading_angle = "PIXELS", 0.0
    return current.camera


def compute(*objects: bpy.types.Object, pixels: float = PIXELS, **settings: object) -> None:
    addon.compute(*objects, tolerance=pixels, tolerance_mode="PIXELS", **settings)


def subdivide(*objects: bpy.types.Object, pixels: float = PIXELS) -> list[bpy.types.Object]:
    """The results, in the order of their names."""
    addon.finish("subdivide", *objects, tolerance=pixels, tolerance_mode="PIXELS")
    return sorted(bpy.context.selected_objects, key=lambda each: each.name)


def add_plate(z: float = -10.0, mesh: bpy.types.Mesh | None = None) -> bpy.types.Object:
    """A bent plate across the axis of the camera, with its nearest control point at z."""
    holder = scene.add_object(meshes.landscape(4, 3), "Plate") if mesh is None else scene.add_mesh(mesh)
    points = scene.mesh_data(holder.data).positions
    holder.location = -(points.max(axis=0) + points.min(axis=0)) / 2
    holder.location.z = z - points[:, 2].max()
    return holder


def by_hand(holder: bpy.types.Object, pixels: float = PIXELS) -> float:
    """The least tolerance of the promise, of a camera at the origin: without the part for what is off the hull."""
    points = scene.mesh_data(holder.data).positions + np.array(holder.location)
    depths = -points[:, 2]
    tangent = (np.hypot(points[:, 0], points[:, 1]) / depths).max()
    corner = hypot(0.6 * WIDTH, 0.6 * HEIGHT) / FOCAL
    return pixels * depths.min() / FOCAL / sqrt(1 + min(tangent, corner) ** 2)


@pytest.mark.every_blender
def test_the_tolerance_is_the_length_of_the_pixels() -> None:
    plate = add_plate()
    compute(plate)
    length = plate.data.ccdepth.world_tolerance
    # A drawn point may be beside the hull by a hundredth of the depth, so a little less than by hand.
    assert 0.97 * by_hand(plate) < length < by_hand(plate)
    assert addon.facts(plate)["Seen From"] == "0.5 px of Camera, frame 1"
    found = addon.depths(plate)
    addon.compute(plate, tolerance=length, tolerance_mode="ABSOLUTE")
    np.testing.assert_array_equal(addon.depths(plate), found)
    assert plate.data.ccdepth.seen_from == ""


def test_images_of_a_result_are_within_the_pixels_of_the_surface(camera: bpy.types.Object) -> None:
    """Against Blender's own modifier, far deeper than the result, at points all over its triangles."""
    suzanne = scene.add_suzanne()
    suzanne.location, suzanne.rotation_euler = (0.3, 0.1, -3), (-1.2, 0.3, 0)
    camera.data.lens, camera.data.shift_x = 24, 0.1
    [result] = subdivide(suzanne, pixels=2.0)
    modifier = scene.add_subdivision(suzanne, 5)
    modifier.use_limit_surface = True
    suzanne.hide_set(False)
    deep = scene.evaluated_mesh_data(suzanne)
    world = np.array(suzanne.matrix_world)
    corners = np.cumsum([0, *deep.face_sizes])
    quads = [deep.corner_vertices[a:b].tolist() for a, b in pairwise(corners)]
    tree = BVHTree.FromPolygons((deep.positions @ world[:3, :3].T + world[:3, 3]).tolist(), quads)
    drawn = scene.mesh_data(result.data).positions @ world[:3, :3].T + world[:3, 3]
    triangles = drawn[scene.triangles_of(result.data)]
    weights = np.random.default_rng(1).dirichlet((0.5, 0.5, 0.5), len(triangles))
    largest = 0.0
    for point in (triangles * weights[:, :, None]).sum(axis=1):
        nearest, *_ = tree.find_nearest(Vector(point))
        images = [world_to_camera_view(bpy.context.scene, camera, Vector(each)) for each in (point, nearest)]
        apart = [(one - other) * side for one, other, side in zip(*images, (WIDTH, HEIGHT, 0), strict=True)]
        largest = max(largest, hypot(*apart[:2]))
    # Blender's deep level itself is off by hundredths of a pixel.
    assert 0.2 < largest < 2.0


def test_objects_nearer_to_the_camera_get_more_faces_and_those_off_screen_fewer() -> None:
    near, far, off = add_plate(-10), add_plate(-1000), add_plate(-10)
    off.location.x += 100
    made = subdivide(near, far, off, pixels=0.1)
    assert faces(made[0]) > faces(made[1])
    assert faces(made[0]) > faces(made[2])
    by_record = [each.data.ccdepth.world_tolerance for each in made]
    assert by_record[1] > 50 * by_record[0]
    data = scene.mesh_data(off.data)
    points, corners = data.positions + np.array(off.location), np.cumsum([0, *data.face_sizes])
    quads = [{*data.corner_vertices[a:b].tolist()} for a, b in pairwise(corners)]
    distances = []
    for quad in quads:
        near_points = points[[*set().union(*(each for each in quads if each & quad))]]
        box = np.clip(0.0, near_points.min(axis=0), near_points.max(axis=0))
        distances.append(np.linalg.norm(box))
    # By its definition: of the nearest point of a box around a face's control points, times four.
    assert by_record[2] == pytest.approx(4 * 0.1 * min(distances) / FOCAL, rel=1e-6)


def add_road(nearest: float, mesh: bpy.types.Mesh | None = None) -> bpy.types.Object:
    """A bumpy strip from the depth nearest to twelve more; the mesh of another one the other way round. All of it is in
    the image."""
    bpy.context.scene.camera.data.lens = 5
    if mesh is None:
        holder = scene.add_object(meshes.landscape(3, 12), "Road")
        holder.rotation_euler, holder.location = (-np.pi / 2, 0, 0), (-1.5, -1, -nearest)
    else:
        holder = scene.add_mesh(mesh)
        holder.rotation_euler, holder.location = (np.pi / 2, 0, 0), (-1.5, -1, -nearest - 12)
    bpy.context.view_layer.update()
    return holder


def test_an_object_from_near_to_far_is_finer_where_it_is_near() -> None:
    road = add_road(1.0)
    compute(road, pixels=0.5)
    depths = scene.values_of(road.data.attributes["ccdepth"].data, "value", np.int32)[:, 0]
    assert np.median(depths[:6]) >= np.median(depths[-6:]) + 2
    [result] = subdivide(road, pixels=0.5)
    record = result.data.ccdepth
    assert record.largest_bound > 3 * record.world_tolerance
    assert 0 < record.largest_ratio <= 1
    count, settings = faces(result), bpy.context.scene.ccdepth
    bpy.context.view_layer.objects.active = result
    for pixels, verdict in ((0.5, "MET"), (0.1, "NOT_MET")):
        settings.pixels = pixels
        addon.finish("measure", result)
        assert result.data.ccdepth.measurement.verdict == verdict
        assert (
            result.data.ccdepth.deviation <= (1 + 1e-6) * 0.5 / pixels * result.data.ccdepth.measurement.world_tolerance
        )
    road.hide_set(False)
    addon.finish("subdivide", road, tolerance=record.world_tolerance, tolerance_mode="ABSOLUTE")
    assert faces(bpy.context.object) > 2 * count


@pytest.mark.thorough
def test_reduced_objects_are_within_the_pixels_from_near_to_far() -> None:
    road, settings = add_road(1.0), bpy.context.scene.ccdepth
    [whole] = subdivide(road, pixels=0.5)
    road.hide_set(False)
    addon.finish("subdivide", road, tolerance=0.5, tolerance_mode="PIXELS", reduce=True)
    result, settings.pixels = bpy.context.object, 0.5
    assert faces(result) < 2 * 0.8 * faces(whole)
    assert result.data.ccdepth.largest_bound > result.data.ccdepth.world_tolerance
    assert 0.5 < result.data.ccdepth.largest_ratio <= 1
    addon.finish("measure", result)
    assert result.data.ccdepth.measurement.verdict == "MET"


def test_one_mesh_is_fine_enough_wherever_one_of_its_objects_is_near() -> None:
    road = add_road(1.0)
    other = add_road(1.5, road.data)
    [alone] = subdivide(road, pixels=0.2)
    road.hide_set(False)
    made = subdivide(road, other, pixels=0.2)
    assert made[0].data == made[1].data
    assert faces(made[0]) > 1.2 * faces(alone)
    bpy.context.scene.ccdepth.pixels = 0.2
    for each, source in zip(made, (road, other), strict=True):
        addon.finish("measure", each)
        assert (each.data.ccdepth.measurement.verdict, made[0].data.ccdepth.measurement.against) == ("MET", source.name)
    compute(road, other, pixels=0.2)
    depths = scene.values_of(road.data.attributes["ccdepth"].data, "value", np.int32)[:, 0]
    # In one object or the other both ends are near.
    assert abs(np.median(depths[:6]) - np.median(depths[-6:])) <= 1


def test_of_objects_with_one_mesh_the_nearest_counts() -> None:
    near = add_plate(-10)
    far = add_plate(-40, near.data)
    for objects in ((near, far), (far, near)):
        compute(*objects)
        assert near.data.ccdepth.world_tolerance < by_hand(near) < by_hand(far)
    [one, other] = subdivide(near, far)
    assert one.data == other.data
    count = faces(one)
    bpy.data.objects.remove(far)
    for each in (one, other):
        bpy.data.objects.remove(each)
    assert faces(subdivide(near)[0]) == count


def test_over_the_scenes_range_the_nearest_frame_counts(camera: bpy.types.Object) -> None:
    plate, current = add_plate(-10), bpy.context.scene
    current.frame_start, current.frame_end = 1, 5
    scene.animate(camera, "location", {1: (0, 0, 20), 3: (0, 0, -2), 5: (0, 0, 30)})
    lengths = []
    for frame in range(1, 6):
        current.frame_set(frame)
        compute(plate)
        lengths.append(plate.data.ccdepth.world_tolerance)
    current.frame_set(4)
    compute(plate, camera_frames="SCENE")
    # Between frames the box of both counts, with the farthest tangent of both.
    assert 0.999 * min(lengths) <= plate.data.ccdepth.world_tolerance <= min(lengths)
    assert (current.frame_current, plate.data.ccdepth.seen_from) == (4, "Camera, frames 1-5")
    # Depths with frames of their own are for the camera on each of these.
    compute(plate, frames="CUSTOM", frame_list="1,5")
    assert plate.data.ccdepth.world_tolerance == pytest.approx(min(lengths[0], lengths[4]))


def test_an_object_that_grows_counts_at_its_size_on_each_frame() -> None:
    plate, current = add_plate(-10), bpy.context.scene
    current.frame_start, current.frame_end = 1, 2
    current.frame_set(1)
    compute(plate, camera_frames="SCENE")
    before = plate.data.ccdepth.world_tolerance
    scene.animate(plate, "scale", {1: (1, 1, 1), 2: (3, 3, 3)})
    current.frame_set(1)
    compute(plate, camera_frames="SCENE")
    assert plate.data.ccdepth.world_tolerance < before / 3


def test_found_tolerances_in_pixels_fit() -> None:
    plate, settings = add_plate(), bpy.context.scene.ccdepth
    addon.finish("find_tolerance", plate, face_budget=300)
    assert settings.tolerance_mode == "PIXELS"
    count = known_count(plate).faces
    [result] = subdivide(plate, pixels=settings.pixels)
    assert faces(result) == count <= 300


def test_updates_and_measurements_take_the_same_pixels() -> None:
    plate, settings = add_plate(), bpy.context.scene.ccdepth
    [result] = subdivide(plate)
    count = faces(result)
    addon.finish("update", result)
    assert faces(result) == count
    bpy.context.view_layer.objects.active = result
    addon.finish("measure", result)
    assert result.data.ccdepth.measurement.verdict == "MET"
    assert result.data.ccdepth.measurement.seen_from == "Camera, frame 1"
    settings.pixels = 2.0
    addon.finish("update", result)
    assert faces(result) < count


def no_camera(_camera: bpy.types.Object) -> None:
    bpy.context.scene.camera = None


def other_name(_camera: bpy.types.Object) -> None:
    bpy.context.scene.ccdepth.camera = "Nobody"


def panoramic(camera: bpy.types.Object) -> None:
    camera.data.type = "PANO"


def no_pixels(_camera: bpy.types.Object) -> None:
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 50, 50, 1


def too_coarse_paint(_camera: bpy.types.Object) -> None:
    bpy.data.objects["Plate"].vertex_groups.new(name="Detail").add([0], 1.0, "REPLACE")
    settings = bpy.context.scene.ccdepth
    settings.tolerance_by, settings.vertex_group, settings.coarsest = "VERTEX_GROUP", "Detail", 30.0


def bad_scale(_camera: bpy.types.Object) -> None:
    bpy.context.scene.ccdepth.off_screen_scale = 0.0


def too_many(_camera: bpy.types.Object) -> None:
    bpy.context.scene.ccdepth.pixels = 20.0


def negative(_camera: bpy.types.Object) -> None:
    bpy.context.scene.ccdepth.pixels = -1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (no_camera, "The scene has no camera, and"),
        (other_name, "The scene has no camera called “Nobody”"),
        (panoramic, "neither a perspective nor an orthographic camera"),
        (no_pixels, "has no pixels: raise the resolution"),
        (bad_scale, "The Off-Screen Scale must be 1 or more"),
        (too_coarse_paint, "its tolerance is up to 15 pixels, and at most 13.3 can be proved"),
        (too_many, "its tolerance is up to 20 pixels, and at most 13.3 can be proved"),
        (negative, "must be greater than zero"),
    ],
)
@pytest.mark.parametrize("operator", ["compute", "subdivide", "measure"])
def test_refusals_in_one_line(
    camera: bpy.types.Object, change: Callable[[bpy.types.Object], None], message: str, operator: str
) -> None:
    plate = add_plate()
    change(camera)
    refuses(operator, message, plate)


def test_the_command_line_takes_pixels_of_a_camera_and_checks_its_report(tmp_path: Path) -> None:
    plate = add_plate()
    other = scene.add("Other", bpy.data.cameras.new("Other"))
    other.location.z = 50
    length = by_hand(plate)
    source, report = save(tmp_path / "plate.blend"), tmp_path / "report.json"
    assert run(source, "--tolerance", "0.5px", "--camera", "Other", "--json", report, "--method", "certified") == 0
    [entry] = json.loads(report.read_text())["files"][0]["objects"]
    assert (entry["settings"]["camera"], entry["settings"]["tolerance_mode"]) == ("Other", "PIXELS")
    # Six times as far.
    assert entry["tolerance"] > 5 * length
    assert run("--verify", report) == 0
    assert run(source, "--tolerance", "0.5px", "--camera", "Nobody") == 1
