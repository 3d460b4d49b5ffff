# SPDX-License-Identifier: GPL-3.0-or-later
"""Compute Depth on selected objects: what it writes, and that scale, duplicates and modes are counted in."""

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from ccdepth_addon.core.depth.face_depths import METHODS, VERTICES, face_depths
from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE
from tests.blender.test_measure_guarantee import shown
from tests.steps import result_of

pytestmark = pytest.mark.every_blender


def expected(holder: bpy.types.Object, tolerance: float = TOLERANCE) -> np.ndarray:
    """What the core says of the object's mesh as it is, by the method of its record, else of the scene; the object has
    no modifiers, so its vertices are on the limit surface."""
    method = holder.data.ccdepth.method or bpy.context.scene.ccdepth.method
    mesh = scene.polygon_mesh_of(holder.data)
    return face_depths(mesh, tolerance, method, "LIMIT").depths


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("vertices", VERTICES)
def test_it_writes_what_the_core_finds(method: str, vertices: str) -> None:
    # By distance Suzanne takes many seconds.
    holder = scene.add_object(meshes.landscape(6, 4)) if method == "DISTANCE" else scene.add_suzanne()
    addon.compute(holder, tolerance=TOLERANCE, method=method, vertices=vertices)
    mesh = scene.polygon_mesh_of(holder.data)
    result, depths = face_depths(mesh, TOLERANCE, method, vertices), addon.depths(holder)
    np.testing.assert_array_equal(depths, result.depths)
    np.testing.assert_allclose(addon.bounds(holder), result.bounds, rtol=1e-6)
    assert addon.bounds(holder).max() <= np.float32(TOLERANCE)
    kinds = [holder.data.attributes[name] for name in ("ccdepth", "ccdepth_bound")]
    assert [(kind.domain, kind.data_type) for kind in kinds] == [("FACE", "INT"), ("FACE", "FLOAT")]
    assert not holder.data.color_attributes
    record = holder.data.ccdepth
    assert record.has_result
    assert (record.tolerance, record.world_tolerance) == (pytest.approx(TOLERANCE), pytest.approx(TOLERANCE))
    assert (record.tolerance_mode, record.method, record.vertices) == ("ABSOLUTE", method, vertices)
    assert (record.faces, record.deepest) == (len(depths), depths.max())
    assert addon.histogram(holder) == dict(zip(*np.unique(depths, return_counts=True), strict=True))
    assert int(record.uniform_faces) == len(holder.data.loops) * 4 ** (record.uniform_level - 1)


@pytest.mark.parametrize("scale", [(3.0, 3.0, 3.0), (1.0, 8.0, 0.3), (-2.0, 1.0, 1.0)])
def test_scale_counts(scale: tuple[float, float, float]) -> None:
    holder = scene.add_suzanne()
    holder.scale = scale
    holder.location = (100.0, 0.0, 0.0)
    addon.compute(holder, tolerance=TOLERANCE)
    found = addon.depths(holder)
    holder.data.transform(Matrix.Diagonal((*scale, 1.0)))
    np.testing.assert_array_equal(found, expected(holder))


def test_linked_duplicates_take_the_largest_depths() -> None:
    first = scene.add_suzanne()
    scales = [(1.0, 1.0, 1.0), (6.0, 1.0, 1.0), (1.0, 6.0, 1.0), (2.0, 0.5, 0.5)]
    objects = [first] + [scene.add_mesh(first.data) for _ in scales[1:]]
    alone = []
    for holder, scale in zip(objects, scales, strict=True):
        holder.scale = scale
        addon.compute(holder, tolerance=TOLERANCE)
        alone.append(addon.depths(holder))
    addon.compute(*objects, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(first), np.max(alone, axis=0))
    assert len(first.data.ccdepth.contributors) == len(objects)


def test_equal_duplicates_are_computed_once() -> None:
    first = scene.add_suzanne()
    objects = [first] + [scene.add_mesh(first.data) for _ in range(3)]
    objects[2].scale = (2.0, 2.0, 2.0)
    objects[3].rotation_euler = (0.1, 0.2, 0.3)
    computation = addon.module("tasks.depth_task")
    bpy.context.view_layer.update()
    settings = computation.DepthSettings(TOLERANCE, "ABSOLUTE", True, "SECOND_ORDER", "CONTROL")
    work = result_of(computation.prepare_depths(bpy.context, objects, settings))
    work.decide()
    [task] = work.tasks.values()
    assert [request.surface.object_name for request in task.requests] == [objects[2].name]


def test_progress_rises_over_depths_and_the_level_of_all_meshes() -> None:
    """Of a mesh with two users, neither of which outdoes the other, and of another mesh."""
    first = scene.add_object(meshes.with_random_creases(meshes.landscape(6, 6), share=0.3))
    second = scene.add_mesh(first.data)
    first.scale, second.scale = (2.0, 1.0, 1.0), (1.0, 2.0, 1.0)
    objects = [first, second, scene.add_object(meshes.landscape(8, 8))]
    bpy.context.view_layer.update()
    task = addon.module("tasks.depth_task")
    settings = task.DepthSettings(0.01, "ABSOLUTE", True, "CERTIFIED", "LIMIT")
    work = result_of(task.prepare_depths(bpy.context, objects, settings))
    fractions: list[float] = []
    task.compute_depths(work, fractions.append)
    assert [len(each.requests) for each in work.tasks.values()] == [2, 1]
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1


def test_all_selected_objects_are_computed_and_others_are_not_unless_active_alone() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.landscape(5, 5))
    other = scene.add_object(meshes.cube())
    addon.compute(first, second, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(first), expected(first))
    np.testing.assert_array_equal(addon.depths(second), expected(second))
    assert addon.is_untouched([other])
    # Where none is selected, the active one is.
    addon.select(other)
    other.select_set(False)
    assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    assert other.data.ccdepth.has_result


def test_edit_mode_stays_and_writes_what_object_mode_writes_of_what_is_being_edited() -> None:
    import bmesh

    first, second = scene.add_suzanne(), scene.add_object(meshes.creased_cube())
    with addon.edit_mode(first, second):
        edited = bmesh.from_edit_mesh(first.data)
        next(iter(edited.verts)).co.z += 0.5
        for face in list(edited.faces)[:100]:
            face.hide_set(True)
        bmesh.update_edit_mesh(first.data)
        assert bpy.ops.ccdepth.compute(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE") == {"FINISHED"}
        assert bpy.context.mode == "EDIT_MESH"
        fingerprint = first.data.ccdepth.fingerprint
    for holder in (first, second):
        np.testing.assert_array_equal(addon.depths(holder), expected(holder))
        assert holder.data.ccdepth.faces == len(holder.data.polygons)
    assert not [mesh for mesh in bpy.data.meshes if mesh not in (first.data, second.data)]
    written = addon.depths(first), addon.bounds(first)
    bpy.ops.ccdepth.clear()
    addon.compute(first, second, tolerance=TOLERANCE)
    assert first.data.ccdepth.fingerprint == fingerprint
    for before, after in zip(written, (addon.depths(first), addon.bounds(first)), strict=True):
        np.testing.assert_array_equal(before, after)


def test_edit_mode_counts_in_duplicates_of_what_is_being_edited() -> None:
    first, large = scene.add_suzanne(), scene.add_object(meshes.cube())
    large.data = first.data
    large.scale = (5.0, 5.0, 5.0)
    addon.compute(first, large, tolerance=TOLERANCE)
    found = addon.depths(first)
    bpy.ops.ccdepth.clear()
    with addon.edit_mode(large, first):
        bpy.ops.ccdepth.compute(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE")
    np.testing.assert_array_equal(addon.depths(first), found)


def test_settings_of_the_scene_hold_unless_given() -> None:
    holder = scene.add_suzanne()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.vertices = "ABSOLUTE", 0.05, "LIMIT"
    addon.compute(holder)
    record = holder.data.ccdepth
    assert (record.tolerance, record.vertices) == (pytest.approx(0.05), "LIMIT")
    bpy.ops.ccdepth.compute(tolerance=0.02)
    assert (record.tolerance, record.tolerance_mode) == (pytest.approx(0.02), "ABSOLUTE")
    bpy.ops.ccdepth.compute(vertices="CONTROL")
    assert (record.tolerance, record.vertices) == (pytest.approx(0.05), "CONTROL")
    assert settings.vertices == "LIMIT"


@pytest.mark.parametrize("angle", [-0.6, 0.6])
def test_a_relative_tolerance_of_a_sheared_object_is_a_part_of_the_longest_diagonal(angle: float) -> None:
    holder = scene.add_object(meshes.cube())
    holder.parent, holder.rotation_euler.z = scene.add("Parent", None), angle
    holder.parent.scale = (1.0, 3.0, 1.0)
    addon.compute(holder, tolerance=0.01, tolerance_mode="RELATIVE")
    corners = np.array(holder.bound_box) @ np.array(holder.matrix_world)[:3, :3].T
    longest = np.linalg.norm(corners[:, None] - corners, axis=-1).max()
    assert holder.data.ccdepth.world_tolerance == pytest.approx(0.01 * longest)


def test_of_similar_duplicates_the_smallest_tolerance_is_recorded_and_the_bounds_of_the_largest() -> None:
    """Though each is measured in units of its own tolerance, and one is as good as the other."""
    small = scene.add_object(meshes.cube())
    large = scene.add_mesh(small.data)
    large.scale = (3.0, 3.0, 3.0)
    addon.compute(small, tolerance=0.01, tolerance_mode="RELATIVE")
    smallest = small.data.ccdepth.world_tolerance
    addon.compute(large, tolerance=0.01, tolerance_mode="RELATIVE")
    alone = addon.bounds(large)
    for objects in ((large, small), (small, large)):
        addon.compute(*objects, tolerance=0.01, tolerance_mode="RELATIVE")
        assert small.data.ccdepth.world_tolerance == smallest
        np.testing.assert_allclose(addon.bounds(small), alone, rtol=1e-6)


def test_another_result_takes_the_place_of_the_first_and_says_which_depths_are_the_least() -> None:
    holder = scene.add_object(meshes.cube())
    addon.compute(holder, tolerance=TOLERANCE, method="CERTIFIED")
    assert holder.data.ccdepth.exact_faces == len(holder.data.polygons)
    addon.compute(holder, tolerance=10 * TOLERANCE, method="SECOND_ORDER")
    assert holder.data.ccdepth.exact_faces == 0
    np.testing.assert_array_equal(addon.depths(holder), expected(holder, 10 * TOLERANCE))
    assert len([name for name in holder.data.attributes.keys() if name.startswith("ccdepth")]) == 2  # noqa: SIM118


def test_bounds_are_never_rounded_down() -> None:
    bounds = np.append(np.random.default_rng(1).random(100), [0.0, 1e-30, 1.0])
    single = addon.module("state.mesh_values").rounded_up(bounds)
    assert single.dtype == np.float32
    assert np.all(single >= bounds)
    assert np.all(single <= bounds * (1 + np.finfo(np.float32).eps))


# Triangles that are looked for.
SOME = 1000

MESHES: dict[str, Callable[[], bpy.types.Object]] = {
    "landscape": lambda: scene.add_object(meshes.landscape(5, 4, 3)),
    "hexagons": lambda: scene.add_object(meshes.hexagons(3, 3, 0.2)),
    "suzanne": scene.add_suzanne,
}


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("name", MESHES)
def test_triangles_are_those_that_blender_draws(name: str, level: int) -> None:
    """All but those of quads that may be folded, which count with both diagonals."""
    holder = MESHES[name]()
    mesh = scene.polygon_mesh_of(holder.data)
    level_quads = addon.module("core.mesh.level_quads")
    refinement = addon.module("core.surface.refinement").Refinement.start(mesh, np.arange(mesh.face_count))
    is_turned = np.zeros(mesh.face_count, dtype=bool)
    for _ in range(level):
        is_turned = level_quads.turned_children(is_turned, refinement.mesh.face_sizes[: len(is_turned)])
        refinement = refinement.refined()
    leaves = addon.module("core.deviation.leaf_deviations").DrawnLeaves.of(
        refinement, is_turned, addon.module("core.bounds.norm_bounds").Vertices.CONTROL, None
    )
    drawn = level_quads.QUAD_TRIANGLES[is_turned.astype(int)]
    corners = np.take_along_axis(leaves.points[:, None], drawn[..., None], axis=2).reshape(-1, 3, 3)
    certain = np.repeat(~leaves.is_folded, 2)
    scene.add_subdivision(holder, level).use_limit_surface = False
    seen = shown(holder)
    found = seen.positions[seen.triangles].mean(axis=1)
    assert len(found) == len(corners)
    assert np.count_nonzero(certain) > 0.9 * len(corners)
    middles = np.random.default_rng(1).permutation(corners[certain].mean(axis=1))[:SOME]
    # Single precision at coordinates of some ten; middles along the other diagonal are farther off by far.
    for middle in middles:
        assert np.linalg.norm(found - middle, axis=1).min() < 1e-5


def test_by_default_depths_are_by_distance_and_the_panel_says_so() -> None:
    holder = scene.add_object(meshes.torus(8, 6))
    bpy.context.scene.ccdepth.property_unset("method")
    addon.compute(holder, tolerance=0.05)
    assert holder.data.ccdepth.method == "DISTANCE"
    facts = addon.facts(holder)
    assert (facts["Method"], facts["Proved Minimal"]) == ("By Distance", "All faces")
    addon.compute(holder, tolerance=0.05, method="CERTIFIED")
    assert "Proved Minimal" not in addon.facts(holder)


def test_the_effort_says_how_much_is_measured_and_the_panel_how_many_faces_were_left() -> None:
    holder = scene.add_suzanne()
    found = {}
    for effort in ("QUICK", "NORMAL", "FULL"):
        addon.compute(holder, tolerance=0.01, tolerance_mode="RELATIVE", method="DISTANCE", effort=effort)
        found[effort] = addon.depths(holder)
        left = holder.data.ccdepth.faces_left
        assert (left > 0) == (effort == "QUICK")
        assert addon.facts(holder).get("Might Need Less") == (f"{left:,}" if left else None)
    np.testing.assert_array_equal(found["NORMAL"], found["FULL"])
    assert np.all(found["FULL"] <= found["QUICK"])
    assert np.any(found["FULL"] < found["QUICK"])


# Of these no lesser depth is enough on any face, at this part of the diagonal.
LEAST: dict[str, tuple[Callable[[], meshes.MeshData], float]] = {
    "cube": (meshes.cube, 0.01),
    "creased cube": (meshes.creased_cube, 0.03),
    "torus": (lambda: meshes.torus(8, 6), 0.01),
}


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("name", LEAST)
def test_the_level_that_is_set_is_measured_to_be_enough_and_the_one_before_is_not(name: str, vertices: str) -> None:
    """By Measure Deviation."""
    make, tolerance = LEAST[name]
    holder, near = scene.add_object(make()), {"tolerance": tolerance, "tolerance_mode": "RELATIVE"}
    addon.compute(holder, **near, method="DISTANCE", vertices=vertices)
    record = holder.data.ccdepth
    assert record.exact_faces == record.faces
    bpy.ops.ccdepth.set_levels()
    [modifier] = holder.modifiers
    for verdict in ("MET", "NOT_MET"):
        addon.measure(holder, **near, accuracy=1.0, time_limit=20)
        assert record.measurement.verdict == verdict
        modifier.levels -= 1
