# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure Deviation: what it writes and reports, on which objects, and that it is undone and cleared.

test_measure_guarantee tests the distances. Most of it runs for a moment only: what is proved
by then is enough to look at.
"""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Quaternion, Vector

from tests import meshes
from tests.blender import addon, scene


def subdivided_cube(levels: int = 1) -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), "Cube")
    scene.add_subdivision(holder, levels)
    return holder


# The limit position of a vertex of valence n is (n² times itself, 4 times its neighbours, and once those across its
# quads, by sum) / (n (n + 5)): for a corner of the cube from −1 to 1 that is (9 + 4 − 1) / 24 = 1/2 along each axis.
CORNER_OF_CUBE = np.sqrt(3.0) / 2.0


def assert_holds(record: bpy.types.PropertyGroup, distance: float) -> None:
    """The deviation is this, between what is reached and what is proved, however much time there was."""
    assert record.deviation_reached <= distance * (1 + 1e-6)
    assert record.deviation >= distance * (1 - 1e-6)


def test_attribute_and_record() -> None:
    holder = subdivided_cube()
    addon.measure(holder, tolerance=0.5)
    attribute = holder.data.attributes["ccdepth_deviation"]
    assert (attribute.data_type, attribute.domain) == ("FLOAT", "FACE")
    record, values = holder.data.ccdepth, addon.deviations(holder)
    assert len(values) == 6
    assert 0.0 < record.deviation_reached <= record.deviation
    assert values.max() == pytest.approx(record.deviation)
    found = record.measurement
    assert (found.measured, found.against) == ("Cube", "Cube")
    assert found.world_tolerance == 0.5
    assert 0 <= found.worst_face < 6
    assert not record.has_result
    assert "ccdepth" not in holder.data.attributes


def test_what_the_modifiers_show_is_measured() -> None:
    coarse, fine = subdivided_cube(1), subdivided_cube(3)
    for holder in (coarse, fine):
        addon.measure(holder)
    # A level makes a smooth surface four times as good.
    assert fine.data.ccdepth.deviation_reached < coarse.data.ccdepth.deviation / 4
    fine.modifiers[0].show_viewport = False
    addon.measure(fine)
    assert_holds(fine.data.ccdepth, CORNER_OF_CUBE)


@pytest.mark.parametrize(
    ("tolerance", "verdict", "words"),
    [
        (10.0, "MET", "within the tolerance of 10 m"),
        (1e-3, "NOT_MET", "not within the tolerance of 0.001 m"),
    ],
)
def test_the_tolerance_is_met_or_not(
    tolerance: float, verdict: str, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    holder = subdivided_cube()
    addon.measure(holder, tolerance=tolerance)
    assert holder.data.ccdepth.measurement.verdict == verdict
    printed = capfd.readouterr().out
    assert "Deviation at most " in printed
    assert words in printed


def test_between_the_two_distances_nothing_is_decided() -> None:
    decide = addon.module("state.deviation_results").verdict
    assert decide(1.2, 1.0, 1.1).name == "UNDECIDED"
    assert decide(1.2, 1.0, 1.2).name == "MET"
    assert decide(1.2, 1.0, 1.0).name == "UNDECIDED"
    assert decide(1.2, 1.0, 0.99).name == "NOT_MET"


def test_a_tolerance_may_be_a_part_of_the_diagonal() -> None:
    holder = subdivided_cube()
    holder.scale = (2.0, 2.0, 2.0)
    addon.measure(holder, tolerance=0.1, tolerance_mode="RELATIVE")
    assert holder.data.ccdepth.measurement.world_tolerance == pytest.approx(0.1 * 4.0 * np.sqrt(3.0))


def test_what_is_left_open_comes_from_the_scene() -> None:
    settings = bpy.context.scene.ccdepth
    settings.tolerance, settings.tolerance_mode = 0.25, "ABSOLUTE"
    settings.accuracy, settings.time_limit, settings.use_modifiers = 0.5, 0.5, False
    holder = subdivided_cube()
    addon.select(holder)
    assert bpy.ops.ccdepth.measure() == {"FINISHED"}
    found = holder.data.ccdepth.measurement
    assert (found.world_tolerance, found.accuracy, found.use_modifiers) == (0.25, 0.5, False)


def test_when_the_time_is_over_it_tells_what_is_proved(capfd: pytest.CaptureFixture[str]) -> None:
    holder = scene.add_suzanne()
    addon.measure(holder, accuracy=1e-6, time_limit=0.01)
    record = holder.data.ccdepth
    assert not record.measurement.accuracy_met
    assert record.deviation > record.deviation_reached
    assert "stopped before the accuracy was reached" in capfd.readouterr().out


@pytest.mark.parametrize("editing", [False, True])
def test_both_modes_measure_the_same(editing: bool) -> None:
    holder = scene.add_object(meshes.cube())
    addon.select(holder)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    settings = {"tolerance": 0.5, "tolerance_mode": "ABSOLUTE", "time_limit": 0.5}
    assert bpy.ops.ccdepth.measure(**settings) == {"FINISHED"}
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    assert_holds(holder.data.ccdepth, CORNER_OF_CUBE)
    assert addon.deviations(holder).max() == pytest.approx(holder.data.ccdepth.deviation)
    assert addon.colors(holder).shape == (24, 4)


def test_edit_mode_measures_the_mesh_as_it_is_being_edited() -> None:
    import bmesh

    holder = scene.add_object(meshes.cube())
    with addon.edit_mode(holder):
        edited = bmesh.from_edit_mesh(holder.data)
        for vertex in edited.verts:
            vertex.co *= 2.0
        bpy.ops.ccdepth.measure(time_limit=0.5)
    assert_holds(holder.data.ccdepth, 2.0 * CORNER_OF_CUBE)


def test_of_several_the_others_are_measured_against_the_active_one() -> None:
    source = subdivided_cube(2)
    first, second = (scene.add_object(scene.evaluated_mesh_data(source), name) for name in ("First", "Second"))
    second.location.x = 0.25
    addon.measure(first, second, source)
    assert addon.is_untouched([source])
    near, moved = first.data.ccdepth, second.data.ccdepth
    assert {near.measurement.against, moved.measurement.against} == {"Cube"}
    assert near.deviation_reached < 0.1
    assert moved.deviation > 0.2
    assert len(addon.deviations(first)) == len(first.data.polygons)
    largest = max(near.deviation, moved.deviation)
    assert near.measurement.largest_shown == moved.measurement.largest_shown == pytest.approx(largest)


def test_several_objects_in_edit_mode() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    other.location.x = 1.0
    with addon.edit_mode(other, source):
        assert bpy.ops.ccdepth.measure(time_limit=0.5) == {"FINISHED"}
        assert bpy.ops.ccdepth.select_worst() == {"FINISHED"}
    assert addon.is_untouched([source])
    assert other.data.ccdepth.measurement.against == "Cube"
    assert other.data.ccdepth.deviation > 0.5
    np.testing.assert_array_equal(selected(other), [other.data.ccdepth.measurement.worst_face])


def test_faces_that_modifiers_make_go_back_to_the_mesh() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(meshes.grid(2, 1), "Other")
    mirror = other.modifiers.new("Mirror", "MIRROR")
    mirror.use_axis = (False, False, True)
    other.modifiers.new("Triangulate", "TRIANGULATE")
    other.location.z = 3.0
    addon.measure(other, source)
    values = addon.deviations(other)
    assert len(values) == len(other.data.polygons)
    assert np.all(values > 2.0)


def test_added_faces_count_in_the_largest_alone() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    group = bpy.data.node_groups.new("Far", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    ends = [group.nodes.new(kind) for kind in ("NodeGroupInput", "NodeGroupOutput")]
    cube, move, join = (group.nodes.new(f"GeometryNode{kind}") for kind in ("MeshCube", "Transform", "JoinGeometry"))
    move.inputs["Translation"].default_value = (9.0, 0.0, 0.0)
    group.links.new(cube.outputs["Mesh"], move.inputs["Geometry"])
    group.links.new(move.outputs["Geometry"], join.inputs[0])
    group.links.new(ends[0].outputs[0], join.inputs[0])
    group.links.new(join.outputs[0], ends[1].inputs[0])
    other.modifiers.new("Far", "NODES").node_group = group
    addon.measure(other, source, accuracy=0.5, time_limit=30.0)
    record = other.data.ccdepth
    assert record.deviation_reached > 6.0
    assert addon.deviations(other).max() < 2.0
    assert record.measurement.worst_face == -1
    assert bpy.ops.ccdepth.select_worst() == {"CANCELLED"}


def test_objects_that_share_a_mesh_get_the_larger_of_each_face() -> None:
    source = subdivided_cube(2)
    data = scene.evaluated_mesh_data(source)
    near = scene.add_object(data, "Near")
    far = bpy.data.objects.new("Far", near.data)
    bpy.context.scene.collection.objects.link(far)
    far.location.x = 2.0
    addon.measure(near, far, source, accuracy=0.5, time_limit=30.0)
    record = near.data.ccdepth
    assert record.measurement.measured == "Far"
    assert record.deviation_reached > 1.0


def test_transforms_of_both_count() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    source.parent = other.parent = parent
    other.location.x = 0.5
    addon.measure(other, source)
    before = other.data.ccdepth.deviation
    reached = other.data.ccdepth.deviation_reached
    parent.scale = (3.0, 3.0, 3.0)
    parent.location = (70.0, -20.0, 11.0)
    parent.rotation_euler = (0.3, 1.0, -2.0)
    addon.measure(other, source)
    assert other.data.ccdepth.deviation >= 3.0 * reached
    assert other.data.ccdepth.deviation_reached <= 3.0 * before
    place = np.array(other.data.ccdepth.measurement.worst_point)
    middle = np.array(parent.location)
    assert np.linalg.norm(place - middle) < 3.0 * np.sqrt(3.0)


def test_an_adaptive_result_is_measured_against_its_source() -> None:
    source = subdivided_cube(2)
    addon.select(source)
    bpy.ops.ccdepth.subdivide(tolerance=0.02, tolerance_mode="ABSOLUTE")
    result = bpy.data.objects["Cube Adaptive"]
    record = result.data.ccdepth
    addon.select(result)
    bpy.ops.ccdepth.measure(tolerance=0.02, tolerance_mode="ABSOLUTE", time_limit=5.0)
    alone = (record.deviation, record.deviation_reached)
    assert record.measurement.against == source.name
    assert record.deviation_reached <= 0.02
    assert record.has_result
    assert record.subdivision == "ADAPTIVE"
    assert record.shows_deviation
    source.hide_set(False)
    addon.measure(result, source, tolerance=0.02, time_limit=5.0)
    assert (record.deviation, record.deviation_reached) == alone
    # What Clear removes, it is still a result.
    addon.select(result)
    bpy.ops.ccdepth.clear()
    bpy.ops.ccdepth.measure(tolerance=0.02, tolerance_mode="ABSOLUTE", time_limit=5.0)
    record = result.data.ccdepth
    assert (record.deviation, record.deviation_reached) == alone
    bpy.data.objects.remove(source)
    with pytest.raises(RuntimeError, match="“Cube”, the object it was made from, has been removed"):
        bpy.ops.ccdepth.measure()


def test_what_was_measured_against_the_active_object_is_shown() -> None:
    """Although the active object was measured before, and is farther off."""
    source = subdivided_cube(1)
    addon.measure(source, time_limit=1.0)
    addon.select(source)
    bpy.ops.ccdepth.subdivide(tolerance=0.02, tolerance_mode="ABSOLUTE")
    result = bpy.data.objects["Cube Adaptive"]
    source.hide_set(False)
    addon.measure(result, source, tolerance=0.02, time_limit=5.0)
    assert bpy.context.active_object == source
    shown = addon.module("state.deviation_results").shown_object
    assert shown(bpy.context) == result
    addon.select(source)
    assert shown(bpy.context) == source


def test_the_heat_map_shows_what_was_done_last() -> None:
    holder = subdivided_cube()
    addon.compute(holder, tolerance=0.1)
    depth_colors = addon.colors(holder)
    addon.measure(holder, time_limit=0.1)
    assert holder.data.ccdepth.shows_deviation
    assert not np.array_equal(addon.colors(holder), depth_colors)
    assert holder.data.attributes.active_color_name == "ccdepth_color"
    deviations, depths = addon.deviations(holder), addon.depths(holder)
    addon.compute(holder, tolerance=0.1)
    np.testing.assert_array_equal(addon.colors(holder), depth_colors)
    np.testing.assert_array_equal(addon.deviations(holder), deviations)
    np.testing.assert_array_equal(addon.depths(holder), depths)
    assert not holder.data.ccdepth.shows_deviation


@pytest.mark.parametrize("editing", [False, True])
def test_colours_stand_for_deviations(editing: bool) -> None:
    source = subdivided_cube(2)
    other = scene.add_object(meshes.landscape(3, 2), "Other")
    addon.measure(other, source, tolerance=0.75)
    module, values = addon.module("state.colors"), addon.deviations(other).astype(np.float64)
    sizes = [polygon.loop_total for polygon in other.data.polygons]
    bpy.context.scene.ccdepth.distance_top = 0.5
    for color_range, top in (("TOLERANCE", 0.75), ("FIXED", 0.5), ("LARGEST", values.max())):
        addon.select(other)
        if editing:
            bpy.ops.object.mode_set(mode="EDIT")
        bpy.context.scene.ccdepth.distance_range = color_range
        if editing:
            bpy.ops.object.mode_set(mode="OBJECT")
        expected = module.to_linear(module.scale_colors(values / top))
        np.testing.assert_allclose(addon.colors(other)[:, :3], np.repeat(expected, sizes, axis=0), atol=1e-6)
    assert values.max() > 0.75
    beyond = module.scale_colors(np.array([1.5]))[0]
    assert np.abs(module.VIRIDIS_COLORS - beyond).sum(axis=1).min() > 0.3


@pytest.mark.parametrize("editing", [False, True])
def test_clear_takes_everything_away(editing: bool) -> None:
    holder = subdivided_cube()
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    before = sorted(attribute.name for attribute in holder.data.attributes)
    addon.select(holder)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.measure(time_limit=0.1)
    bpy.ops.ccdepth.compute()
    bpy.ops.ccdepth.clear()
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    assert addon.is_untouched([holder])
    assert sorted(attribute.name for attribute in holder.data.attributes) == before
    assert holder.data.attributes.active_color_name == "Paint"
    record = holder.data.ccdepth
    assert (record.deviation, record.deviation_reached, record.measurement.fingerprint) == (0.0, 0.0, "")


def test_undo_and_redo() -> None:
    holder = subdivided_cube()
    addon.select(holder)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.ccdepth.measure(time_limit=0.1)
    bpy.ops.ed.undo_push(message="Measure Deviation")
    deviation = holder.data.ccdepth.deviation
    bpy.ops.ed.undo()
    assert addon.is_untouched(bpy.data.objects)
    bpy.ops.ed.redo()
    (holder,) = bpy.data.objects
    assert holder.data.ccdepth.deviation == deviation
    assert addon.deviations(holder).max() == pytest.approx(deviation)


def test_nothing_else_is_changed() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(scene.evaluated_mesh_data(source), "Other")
    data = [len(getattr(bpy.data, name)) for name in ("objects", "meshes", "collections", "shape_keys")]
    addon.measure(other, source, time_limit=0.1)
    assert [len(getattr(bpy.data, name)) for name in ("objects", "meshes", "collections", "shape_keys")] == data
    assert [attribute.name for attribute in source.data.attributes if "ccdepth" in attribute.name] == []
    assert {each.name for each in bpy.context.selected_objects} == {"Cube", "Other"}


# Select Worst Face


def selected(holder: bpy.types.Object) -> np.ndarray:
    faces = np.empty(len(holder.data.polygons), dtype=bool)
    holder.data.polygons.foreach_get("select", faces)
    return np.flatnonzero(faces)


@pytest.mark.parametrize("editing", [False, True])
def test_the_worst_face_is_selected(editing: bool) -> None:
    holder = scene.add_object(meshes.torus(5, 4))
    addon.measure(holder)
    worst = holder.data.ccdepth.measurement.worst_face
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.ccdepth.select_worst(frame=True) == {"FINISHED"}
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(selected(holder), [worst])


def test_of_several_objects_the_worst_one_counts() -> None:
    source = subdivided_cube(2)
    near, far = (scene.add_object(scene.evaluated_mesh_data(source), name) for name in ("Near", "Far"))
    far.location.x = 1.0
    addon.measure(near, far, source, accuracy=0.5, time_limit=30.0)
    for holder in (near, far):
        holder.data.polygons.foreach_set("select", np.zeros(len(holder.data.polygons), dtype=bool))
    assert bpy.ops.ccdepth.select_worst() == {"FINISHED"}
    np.testing.assert_array_equal(selected(near), [])
    np.testing.assert_array_equal(selected(far), [far.data.ccdepth.measurement.worst_face])


def view() -> bpy.types.RegionView3D:
    (space,) = [area.spaces.active for area in bpy.context.window.screen.areas if area.type == "VIEW_3D"]
    return space.region_3d


def test_framing_moves_the_view_there() -> None:
    holder = scene.add_object(meshes.torus(5, 4))
    holder.location = (30.0, 0.0, 0.0)
    addon.measure(holder)
    addon.select(holder)
    bpy.ops.ccdepth.select_worst(frame=True)
    np.testing.assert_allclose(view().view_location, holder.data.ccdepth.measurement.worst_point, rtol=1e-6)


@pytest.mark.parametrize("editing", [False, True])
@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (0.5, 3.0, 1.0), (-1.0, 1.0, 2.0), (-1.0, -2.0, -1.0)])
def test_framing_shows_the_front_of_the_face(editing: bool, scale: tuple[float, float, float]) -> None:
    """The vector from the middle of a convex object to the face points out, whatever its corners say."""
    holder = subdivided_cube()
    holder.rotation_euler, holder.scale = (0.3, 0.5, 0.7), scale
    addon.measure(holder)
    addon.select(holder)
    outwards = Vector(holder.data.ccdepth.measurement.worst_point) - holder.matrix_world.translation
    behind = outwards.to_track_quat("-Z", "Y")
    view().view_rotation = behind
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.select_worst()
    assert view().view_rotation.rotation_difference(behind).angle < 1e-3, "it is not asked to move"
    bpy.ops.ccdepth.select_worst(frame=True)
    turned = view().view_rotation.copy()
    assert outwards.normalized().dot(turned @ Vector((0.0, 0.0, 1.0))) > 0.2
    # A view that shows the face stays as it is.
    seen = turned @ Quaternion((1.0, 0.0, 0.0), 0.5)
    view().view_rotation = seen
    bpy.ops.ccdepth.select_worst(frame=True)
    assert view().view_rotation.rotation_difference(seen).angle < 1e-3


def test_a_hidden_worst_face_is_not_selected() -> None:
    holder = subdivided_cube()
    addon.measure(holder)
    holder.data.polygons[holder.data.ccdepth.measurement.worst_face].hide = True
    assert bpy.ops.ccdepth.select_worst() == {"CANCELLED"}


def test_selecting_needs_a_measurement() -> None:
    addon.select(scene.add_suzanne())
    with pytest.raises(RuntimeError, match="Measure Deviation first"):
        bpy.ops.ccdepth.select_worst()
