# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision on selected objects: where the adaptive mesh goes and what it is, modifiers and Edit Mode;
of many objects, and of objects that are scaled unevenly."""

import gc
from collections.abc import Callable, Generator
from dataclasses import replace
from itertools import islice, product
from unittest.mock import Mock

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import TOLERANCE, faces, known_count, shape, subdivide
from tests.blender.updating import set_scene, stale_line
from tests.steps import result_of, taken

pytestmark = pytest.mark.every_blender

# Where nothing depends on how many faces there are.
ROUGH = 0.1


def hills(name: str = "Hills") -> bpy.types.Object:
    return scene.add_object(meshes.landscape(4, 3), name)


def test_the_result_is_a_new_object_beside_the_hidden_original() -> None:
    holder = hills()
    parent = scene.add("Parent")
    scene.add_collection("Heads", holder, parent)
    holder.parent, parent.location = parent, (1.0, 2.0, 3.0)
    before = faces(holder)
    [result] = subdivide(holder)
    bpy.context.view_layer.update()
    assert result != holder
    assert result.matrix_world == holder.matrix_world
    assert set(result.users_collection) == set(holder.users_collection)
    assert result.parent == parent
    assert bpy.context.active_object == result
    assert (holder.hide_get(), holder.hide_render) == (True, True)
    assert (result.visible_get(), result.hide_render) == (True, False)
    assert faces(holder) == before
    assert faces(result) > before
    assert addon.is_untouched([holder])


def test_the_result_of_a_rigid_body_is_one_as_well() -> None:
    holder = hills()
    addon.select(holder)
    bpy.ops.rigidbody.object_add()
    holder.modifiers.new("Mirror", "MIRROR")
    [result] = subdivide(holder, tolerance=ROUGH)
    assert result.rigid_body is not None
    assert result.data.ccdepth.base_faces == 2 * faces(holder)
    assert set(result.users_collection) == set(holder.users_collection)


def test_attributes_and_the_record_tell_what_was_made() -> None:
    holder = hills()
    scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS")
    [result] = subdivide(holder, mode="PER_FACE")
    record, depths, bounds = result.data.ccdepth, addon.depths(result), addon.bounds(result)
    assert depths.min() >= 0
    assert 0 < bounds.max() <= np.float32(TOLERANCE)
    assert (record.subdivision, record.faces, record.base_faces) == ("PER_FACE", len(depths), 12)
    assert record.world_tolerance == pytest.approx(TOLERANCE)
    assert record.largest_bound == bounds.max()
    assert addon.histogram(result) == dict(zip(*np.unique(depths, return_counts=True), strict=True))
    set_scene(tolerance=TOLERANCE, mode="PER_FACE")
    assert stale_line(result) == ""


def test_each_mode_makes_another_mesh_of_quads_and_triangles() -> None:
    holder, sizes = scene.add_object(meshes.fan(7, 3)), {}
    for mode in ("ADAPTIVE", "PER_FACE"):
        [result] = subdivide(holder, mode=mode, tolerance=0.02)
        sizes[mode] = faces(result)
        assert {polygon.loop_total for polygon in result.data.polygons} == {3, 4}
    assert sizes["ADAPTIVE"] < sizes["PER_FACE"]


@pytest.mark.parametrize("scale", [(1.0, 4.0, 0.3), (-2.0, 1.0, 1.0)])
def test_scale_is_counted_in(scale: tuple[float, float, float]) -> None:
    holder, applied = hills(), hills()
    holder.scale = scale
    holder.location = (100.0, 0.0, 0.0)
    [scaled] = subdivide(holder, tolerance=0.05)
    applied.data.transform(Matrix.Diagonal((*scale, 1.0)))
    [same] = subdivide(applied, tolerance=0.05)
    assert abs(faces(scaled) - faces(same)) <= 0.002 * faces(same)
    assert scaled.scale[:] == pytest.approx(scale)
    assert addon.bounds(scaled).max() <= np.float32(0.05)


def test_single_precision_is_counted_in() -> None:
    """Far from the origin of its mesh, where vertices are stored off by a good part of the tolerance."""
    holder = scene.add_object(meshes.single_precision(meshes.moved(meshes.landscape(1, 1, seed=5), 1e4, 1e4, 0.0)))
    [result] = subdivide(holder)
    addon.measure(result, holder)
    assert result.data.ccdepth.deviation_reached <= addon.bounds(result).max() <= np.float32(TOLERANCE)


def test_a_cube_keeps_a_third_of_its_volume() -> None:
    """As the manual says."""
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.001)
    mesh = bmesh.new()
    mesh.from_mesh(result.data)
    # Sides of 2; the manual rounds.
    assert mesh.calc_volume() == pytest.approx(8 / 3, rel=0.05)
    mesh.free()


def test_a_relative_tolerance_is_a_part_of_the_diagonal() -> None:
    holder = hills()
    diagonal = holder.dimensions.length
    [relative] = subdivide(holder, tolerance=0.01, tolerance_mode="RELATIVE")
    assert relative.data.ccdepth.world_tolerance == pytest.approx(0.01 * diagonal)
    [absolute] = subdivide(holder, tolerance=0.01 * diagonal)
    assert faces(relative) == faces(absolute)
    large = scene.add_mesh(holder.data)
    large.scale = (3.0, 3.0, 3.0)
    [shared, _] = subdivide(holder, large, tolerance=0.01, tolerance_mode="RELATIVE")
    assert addon.bounds(shared).max() == pytest.approx(3 * addon.bounds(relative).max())


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_objects_that_share_a_mesh_share_the_result(output: str) -> None:
    first = hills()
    second, large = scene.add_mesh(first.data), scene.add_mesh(first.data)
    second.rotation_euler = (0.1, 0.2, 0.3)
    large.scale = (3.0, 3.0, 3.0)
    other = scene.add_mesh(first.data)
    results = subdivide(first, second, large, tolerance=ROUGH, output=output)
    assert {result.data for result in results} == {results[0].data} != {other.data}
    assert faces(other) == 12
    assert addon.bounds(large if output == "IN_PLACE" else results[0]).max() <= np.float32(ROUGH)


def test_objects_that_share_a_mesh_but_not_the_surface_get_results_of_their_own() -> None:
    """Or not the way in which UVs are smoothed; a light that is selected stays as it is."""
    first = hills()
    bent, wide, stretched = (scene.add_mesh(first.data) for _ in range(3))
    bent.modifiers.new("Bend", "SIMPLE_DEFORM").angle = 1.0
    wide.scale = (3.0, 0.5, 0.5)
    for holder, smooth in ((first, "PRESERVE_BOUNDARIES"), (stretched, "NONE")):
        scene.add_subdivision(holder, 1).uv_smooth = smooth
    results = subdivide(light := scene.add_light(), first, bent, wide, stretched, tolerance=ROUGH)
    assert light in results
    assert len({result.data for result in results}) == 1 + 4


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_edit_mode_is_left_and_entered_again(output: str) -> None:
    import bmesh

    first, second = hills("Suzanne"), scene.add_object(meshes.creased_cube())
    with addon.edit_mode(first, second):
        edited = bmesh.from_edit_mesh(first.data)
        edited.verts.ensure_lookup_table()
        edited.verts[3].co.z += 0.5
        bmesh.update_edit_mesh(first.data)
        settings = {"tolerance": ROUGH, "tolerance_mode": "ABSOLUTE", "output": output}
        assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
        assert bpy.context.mode == "EDIT_MESH"
        assert len(bpy.context.objects_in_mode) == 2
        results = sorted(bpy.context.objects_in_mode, key=lambda obj: obj.name)
    names = ["Mesh", "Suzanne"] if output == "IN_PLACE" else ["Mesh Adaptive", "Suzanne Adaptive"]
    assert [result.name for result in results] == names
    assert all(addon.depths(result).max() > 0 for result in results)
    assert shape(results[1]).max() > 1.2


@pytest.mark.parametrize(
    ("operator", "module", "name"),
    [
        ("subdivide", "operators.adaptive_operator", "prepare_adaptive"),
        ("subdivide", "operators.adaptive_operator", "place"),
        ("count_faces", "operators.count_faces", "count_text"),
    ],
)
def test_edit_mode_stays_whatever_fails(operator: str, module: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(addon.module(module), name, Mock(side_effect=LookupError("odd")))
    with addon.edit_mode(scene.add_object(meshes.cube())):
        with pytest.raises(RuntimeError, match="odd"):
            getattr(bpy.ops.ccdepth, operator)(tolerance=TOLERANCE)
        assert bpy.context.mode == "EDIT_MESH"


@pytest.mark.parametrize("operator", ["subdivide", "count_faces", "compute"])
def test_an_operator_that_has_run_keeps_nothing_of_its_work(operator: str) -> None:
    """Blender keeps the last operators, with all they hold."""
    addon.select(hills())
    work = addon.module("operators.mesh_operators").Job
    assert getattr(bpy.ops.ccdepth, operator)("EXEC_DEFAULT", True, tolerance=TOLERANCE) == {"FINISHED"}
    gc.collect()
    assert not [kept for kept in gc.get_objects() if isinstance(kept, work)]


def test_what_was_counted_in_is_taken_off_the_result() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    holder.modifiers.new("Mirror", "MIRROR")
    holder.modifiers.new("Off", "DISPLACE").show_viewport = False
    scene.add_subdivision(holder, 2)
    holder.modifiers.new("Bend", "SIMPLE_DEFORM")
    holder.modifiers.new("Hair", "PARTICLE_SYSTEM")
    holder.data.materials.append(bpy.data.materials.new("Red"))
    holder.material_slots[0].link, holder.material_slots[0].material = "OBJECT", bpy.data.materials.new("Blue")
    [counted] = subdivide(holder)
    assert [modifier.name for modifier in counted.modifiers] == ["Off", "Bend", "Hair"]
    assert [(slot.link, slot.material.name) for slot in counted.material_slots] == [("OBJECT", "Blue")]
    assert counted.data.ccdepth.base_faces == 2 * faces(holder)
    [left_out] = subdivide(holder, use_modifiers=False)
    assert [modifier.name for modifier in left_out.modifiers] == ["Mirror", "Off", "Bend", "Hair"]
    assert left_out.data.ccdepth.base_faces == faces(holder)
    assert [modifier.name for modifier in holder.modifiers] == ["Mirror", "Off", "Subdivision", "Bend", "Hair"]


def test_the_result_can_take_the_place_of_the_mesh_with_what_modifiers_make() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    name = holder.data.name
    holder.data.uv_layers.new(name="Map")
    holder.data.materials.append(bpy.data.materials.new("Red"))
    holder.vertex_groups.new(name="Group").add(range(8), 0.5, "REPLACE")
    holder.modifiers.new("Mirror", "MIRROR")
    scene.add_subdivision(holder, 1).uv_smooth = "SMOOTH_ALL"
    [result] = subdivide(holder, output="IN_PLACE")
    assert result == holder
    assert result.visible_get()
    assert [mesh.name for mesh in bpy.data.meshes] == [result.data.name] == [name]
    assert faces(result) > 2 * 16
    assert [layer.name for layer in result.data.uv_layers] == ["Map"]
    # Of the base mesh each face has the corners of the square; another choice keeps them.
    assert max(corner.vector.x for corner in result.data.uv_layers["Map"].uv) < 0.99
    assert [slot.material.name for slot in result.material_slots] == ["Red"]
    assert [group.name for group in result.vertex_groups] == ["Group"]
    weighted = [vertex for vertex in result.data.vertices if vertex.groups]
    assert 0 < len(weighted) < len(result.data.vertices)


def test_shape_keys_stay_unless_modifiers_are_applied_with_them_and_their_mix_is_measured(
    capfd: pytest.CaptureFixture[str],
) -> None:
    holder, long = hills(), hills()
    for point in scene.add_key(holder, "Long", 1.0).points:
        point.co.z *= 3.0
    [result] = subdivide(holder, tolerance=ROUGH)
    long.data.transform(Matrix.Diagonal((1.0, 1.0, 3.0, 1.0)))
    [same] = subdivide(long, tolerance=ROUGH)
    assert [block.name for block in result.data.shape_keys.key_blocks] == ["Basis", "Long"]
    assert abs(faces(result) - faces(same)) <= 0.01 * faces(same)
    assert addon.bounds(result).max() <= np.float32(ROUGH)
    warning = "Hills: the tolerance is not proved where a vertex group limits a shape key"
    assert warning not in capfd.readouterr().out
    holder.vertex_groups.new(name="Group").add([0], 1.0, "REPLACE")
    holder.data.shape_keys.key_blocks["Long"].vertex_group = "Group"
    subdivide(holder, tolerance=ROUGH)
    assert warning in capfd.readouterr().out
    holder.modifiers.new("Bend", "SIMPLE_DEFORM")
    [result] = subdivide(holder, tolerance=ROUGH)
    assert result.data.shape_keys is None
    assert "Hills: its shape keys are applied" in capfd.readouterr().out


def test_custom_normals_that_are_left_out_are_told(capfd: pytest.CaptureFixture[str]) -> None:
    holder = scene.add_object(meshes.cube(), "Shaded")
    holder.data.shade_smooth()
    holder.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(holder.data.loops))
    for exact_normals in (True, False):
        [result] = subdivide(holder, tolerance=ROUGH, exact_normals=exact_normals, shading_angle=0.0)
        assert result.data.has_custom_normals == exact_normals
        assert ("Shaded: its custom normals are left out" in capfd.readouterr().out) == (not exact_normals)


placing = addon.module("operators.place_results")

SETTINGS = addon.module("tasks.adaptive_task").AdaptiveSettings(TOLERANCE, "ABSOLUTE", True, "ADAPTIVE", 5_000_000)
RECORDED = addon.module("state.properties").Settings({"use_modifiers": True})


def reading(objects: list[bpy.types.Object]) -> Generator[object, None, object]:
    """The steps of reading objects to subdivide."""
    return addon.module("tasks.adaptive_task").prepare_adaptive(bpy.context, objects, SETTINGS)


def writing(objects: list[bpy.types.Object]) -> Generator[object, None, object]:
    """The steps of making meshes, once they are computed; they return the results before they are placed."""
    answers = addon.module("tasks.adaptive_meshes").subdivide(result_of(reading(objects)), SETTINGS)
    return placing.make_meshes(bpy.context, answers, SETTINGS, exact_normals=False)


def reducing(objects: list[bpy.types.Object]) -> Generator[object, None, object]:
    """The steps of reducing them, as the operator takes them in a window."""
    answers = addon.module("tasks.adaptive_meshes").subdivide(result_of(reading(objects)), SETTINGS)
    return addon.module("operators.reduced_meshes").Reducer(bpy.context, SETTINGS, exact_normals=True).make(answers)


def three_objects() -> list[bpy.types.Object]:
    """Two of them share a mesh, one is not selected, and all have modifiers."""
    first = scene.add_object(meshes.cube())
    objects = [first, scene.add_mesh(first.data), scene.add_object(meshes.cube())]
    for holder, name in zip(objects, ("First", "Second", "Third"), strict=True):
        holder.name = name
    objects[1].scale = (3.0, 0.5, 1.0)
    for holder in objects:
        scene.add_subdivision(holder, 1)
    objects[0].hide_render = objects[2].hide_render = True
    addon.select(*objects[:2])
    return objects


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_objects_that_cannot_be_placed_beside_leave_all_as_they_were(failing: int) -> None:
    """One has left the view layer meanwhile, which may be the first, or come after others."""
    objects = three_objects()
    left, was_selected = objects[failing], objects[failing].select_get()
    active = bpy.context.view_layer.objects.active
    with snapshot.unchanged(lambda path: path[-1] == "active"):
        made = result_of(writing(objects))
        collection = scene.add_collection("Left out", left, alone=True)
        bpy.context.view_layer.layer_collection.children["Left out"].exclude = True
        with pytest.raises(addon.module("tasks.surfaces").ComputeError, match="nothing was written"):
            placing.place(bpy.context, made, RECORDED, placing.beside)
        bpy.context.scene.collection.objects.link(left)
        bpy.data.collections.remove(collection)
        bpy.context.view_layer.update()
        left.select_set(was_selected)
    assert failing == 1 or bpy.context.view_layer.objects.active == active


def test_objects_whose_mesh_cannot_be_replaced_leave_all_as_they_were() -> None:
    """The last is in Edit Mode, where Blender drops the new mesh and says nothing."""
    objects, error = three_objects(), addon.module("tasks.surfaces").ComputeError
    with snapshot.unchanged(lambda path: path[2:3] == ("attribute",) and path[3].startswith(".")):
        made = result_of(writing(objects))
        with addon.edit_mode(objects[2]), pytest.raises(error, match="nothing was written"):
            placing.place(bpy.context, made, RECORDED, placing.instead)
        addon.select(*objects[:2])


@pytest.mark.parametrize(
    ("steps", "count"), [(reading, 2), (writing, 2), *((reducing, count) for count in (1, 3, 8, 14))]
)
def test_giving_up_on_the_way_leaves_everything(
    steps: Callable[..., Generator[object]], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    objects = three_objects()
    monkeypatch.setattr(addon.module("exchange.evaluated"), "OBJECTS_AT_ONCE", 1)
    with snapshot.unchanged():
        begun = steps(objects)
        assert len(list(islice(taken(begun), count))) == count
        begun.close()


# Of each kind, so that all together are evaluated in two groups.
COUNT = 4
BATCHES = 2

# Blender evaluates the scene before and after each operator and at its end as well, however many objects there are.
OTHER_EVALUATIONS = 8


def many() -> list[bpy.types.Object]:
    """Of other scales: without a modifier, with one that adds faces and with one that removes some; and of each such
    kind some that share their mesh and some with meshes of their own."""
    objects = []
    for modifier, shared in product(("", "BEVEL", "MASK"), (False, True)):
        first = scene.add_object(meshes.cube())
        first.vertex_groups.new(name="Kept").add(first.data.polygons[0].vertices[:], 1.0, "REPLACE")
        same = [first] + [scene.add_mesh(first.data if shared else first.data.copy()) for _ in range(COUNT - 1)]
        for index, holder in enumerate(same):
            holder.scale.x = 1.0 + index / COUNT
            holder.scale.y = 1.0 / holder.scale.x
            added = holder.modifiers.new(modifier.title(), modifier) if modifier else None
            if modifier == "MASK":
                added.vertex_group = "Kept"
        objects += same
    return objects


@pytest.mark.parametrize(("operator", "tolerance"), [("compute", 0.1), ("subdivide", 0.3)])
def test_the_scene_is_evaluated_a_few_times_and_each_has_its_own_result(
    operator: str, tolerance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    objects = many()
    monkeypatch.setattr(addon.module("exchange.evaluated"), "OBJECTS_AT_ONCE", len(objects) // BATCHES + 1)
    other = objects[3 * COUNT - 1]
    other.modifiers["Bevel"].segments = 4
    addon.select(*objects)
    # Each evaluation of a scene with objects in it takes as long as there are objects.
    evaluations: list[int] = []

    def count(evaluated: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if evaluated.objects:
            evaluations.append(len(depsgraph.updates))

    bpy.app.handlers.depsgraph_update_post.append(count)
    try:
        assert getattr(bpy.ops.ccdepth, operator)(tolerance=tolerance) == {"FINISHED"}
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(count)
    assert len(evaluations) <= OTHER_EVALUATIONS + 2 * BATCHES
    if operator == "compute":
        assert other.data.ccdepth.added_deepest >= 0
        expected, alone = addon.depths(other), scene.add_mesh(other.data.copy())
        alone.matrix_world = other.matrix_world
        alone.modifiers.new("Bevel", "BEVEL").segments = 4
        addon.compute(alone, tolerance=0.1, tolerance_mode=bpy.context.scene.ccdepth.tolerance_mode)
        assert addon.depths(alone).tolist() == expected.tolist()


def folded_unless_flattened(data: meshes.MeshData, name: str = "Mesh") -> bpy.types.Object:
    """Flattened, the object is smooth where its mesh is folded, and Blender triangulates the mesh."""
    holder = scene.add_object(replace(data, positions=data.positions * (1.0, 1.0, 200.0)), name)
    holder.scale = (1.0, 1.0, 0.005)
    return holder


@pytest.mark.parametrize("mode", ["ADAPTIVE", "PER_FACE"])
def test_faces_of_uneven_objects_are_counted_as_they_are_made_and_drawn_as_proved(mode: str) -> None:
    landscape = folded_unless_flattened(meshes.landscape(4, 3), "Landscape")
    fan = folded_unless_flattened(meshes.fan(5, 2), "Fan")
    sheared = scene.add_object(meshes.bumpy(meshes.cylinder(5), 0.2), "Sheared")
    sheared.parent = scene.add("Parent")
    sheared.parent.scale = (10.0, 1.0, 0.1)
    sheared.rotation_euler = (0.5, 0.6, 0.7)
    modified = scene.add_object(meshes.landscape(2, 2), "Modified")
    modified.modifiers.new("Mirror", "MIRROR")
    subdivided_as_counted([landscape, fan, sheared, modified], tolerance=0.1, mode=mode)


def subdivided_as_counted(holders: list[bpy.types.Object], **settings: object) -> list[bpy.types.Object]:
    """The results, whose faces are as many as were counted before, which changed nothing; and which are drawn along
    the diagonals that were proved, the first of each quad."""
    set_scene(**settings)
    addon.select(*holders)
    with snapshot.unchanged():
        assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    counts = {holder.name: known_count(holder).faces for holder in holders}
    results = subdivide(*holders, **settings)
    assert {result.name.removesuffix(" Adaptive"): faces(result) for result in results} == counts
    for result in results:
        result.data.calc_loop_triangles()
        starts = {polygon.index: polygon.loop_start for polygon in result.data.polygons if polygon.loop_total == 4}
        drawn = [each for each in result.data.loop_triangles if each.polygon_index in starts]
        assert drawn
        for each in drawn:
            assert sorted(loop - starts[each.polygon_index] for loop in each.loops) in ([0, 1, 2], [0, 2, 3])
    return results


@pytest.mark.parametrize("scale", [(1.0, 1.0, 0.0), (1.0, 1.0, -1e-12)])
def test_objects_scaled_to_nothing_are_drawn_as_they_are_proved(scale: tuple[float, float, float]) -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.scale = scale
    [result] = subdivided_as_counted([holder], tolerance=TOLERANCE)
    assert addon.bounds(result).max() <= TOLERANCE
