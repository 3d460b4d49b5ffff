# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure Deviation: what it writes and reports, on which objects, and that it is undone and cleared.

test_measure_guarantee tests the distances. Most of it runs for a moment only: what is proved by then is enough to look
at.
"""

from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.subdividing import refuses, subdivide

pytestmark = pytest.mark.every_blender

# Settings with which two distances become known to within a half, without a limit of time that matters.
ROUGHLY = {"accuracy": 0.5, "time_limit": 30.0}

# The limit position of a vertex of valence n is (n² times itself, 4 times its neighbours, and once those across its
# quads, by sum) / (n (n + 5)): for a corner of the cube from −1 to 1 that is (9 + 4 − 1) / 24 = 1/2 along each axis.
CORNER_OF_CUBE = np.sqrt(3.0) / 2.0

in_both_modes = pytest.mark.parametrize("editing", [False, True])


def subdivided_cube(levels: int = 1) -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), "Cube")
    scene.add_subdivision(holder, levels)
    return holder


def shown_by(source: bpy.types.Object, name: str, x: float = 0.0) -> bpy.types.Object:
    """Another object with the mesh that an object shows."""
    holder = scene.add_object(scene.evaluated_mesh_data(source), name)
    holder.location.x = x
    return holder


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
    # Each face of a cube is as far as the others, on both sides.
    assert values.min() >= record.deviation_reached
    found = record.measurement
    assert (found.measured, found.against) == ("Cube", "")
    assert found.world_tolerance == 0.5
    assert 0 <= found.worst_face < 6
    assert not record.has_result
    assert "ccdepth" not in holder.data.attributes


def test_what_the_modifiers_show_is_measured() -> None:
    holder = subdivided_cube(3)
    addon.measure(holder)
    # Each level makes a smooth surface four times as good.
    assert holder.data.ccdepth.deviation_reached < CORNER_OF_CUBE / 4
    holder.modifiers[0].show_viewport = False
    addon.measure(holder)
    assert_holds(holder.data.ccdepth, CORNER_OF_CUBE)


def test_the_tolerance_is_met_or_not_or_nothing_is_decided(capfd: pytest.CaptureFixture[str]) -> None:
    holder = subdivided_cube()
    for tolerance, verdict, words in ((10.0, "MET", ": within the"), (1e-3, "NOT_MET", ": not within the")):
        addon.measure(holder, tolerance=tolerance)
        assert holder.data.ccdepth.measurement.verdict == verdict
        printed = capfd.readouterr().out
        assert "Deviation at most " in printed
        assert f"{words} tolerance of {tolerance:g} m" in printed
        least = float(printed.partition("at least ")[2].split()[0])
        assert least <= holder.data.ccdepth.deviation_reached * (1 + 1e-6)
    # Nearer to what is reached than the accuracy would tell.
    for part, verdict in ((1.01, "MET"), (0.99, "NOT_MET")):
        addon.measure(holder, tolerance=holder.data.ccdepth.deviation_reached * part, accuracy=0.5, time_limit=9.0)
        assert holder.data.ccdepth.measurement.verdict == verdict
    decide = addon.module("tasks.deviation_task").verdict_of
    for tolerance, name in ((1.2, "MET"), (1.1, "UNDECIDED"), (1.0, "UNDECIDED"), (0.99, "NOT_MET")):
        assert decide(1.2, 1.0, tolerance).name == name


def test_what_is_proved_is_rounded_up_and_what_is_reached_down() -> None:
    """A third is between two numbers of single precision."""
    holder, third = subdivided_cube(), 1.0 / 3.0
    tasks, write = addon.module("tasks.deviation_task"), addon.module("state.mesh_values").write_deviations
    faces = np.zeros(len(holder.data.polygons))
    cube = addon.module("exchange.data_blocks").Identity.of(holder)
    answer = tasks.MeshDeviation([cube], cube, 1.0, faces, third, third, True, False, 0, np.zeros(3), 0.0, 0.0)
    write([holder], [answer], tasks.MeasureSettings(1.0, "ABSOLUTE", True, 0.1, 1.0))
    record = holder.data.ccdepth
    assert record.deviation_reached < third < record.deviation


def test_when_the_time_is_over_it_tells_what_is_proved(capfd: pytest.CaptureFixture[str]) -> None:
    holder = scene.add_suzanne()
    addon.measure(holder, accuracy=1e-6, time_limit=0.01)
    record = holder.data.ccdepth
    assert not record.measurement.accuracy_met
    assert record.deviation > record.deviation_reached
    assert "the Time Limit is over: raise the limit" in capfd.readouterr().out


@in_both_modes
def test_both_modes_measure_the_same(editing: bool) -> None:
    """Edit Mode measures the mesh as it is being edited."""
    holder = scene.add_object(meshes.cube())
    with addon.edit_mode(holder, editing=editing):
        for vertex in bmesh.from_edit_mesh(holder.data).verts if editing else ():
            vertex.co *= 2.0
        assert bpy.ops.ccdepth.measure(tolerance=0.5, tolerance_mode="ABSOLUTE", time_limit=0.5) == {"FINISHED"}
    assert_holds(holder.data.ccdepth, (2.0 if editing else 1.0) * CORNER_OF_CUBE)
    assert addon.deviations(holder).max() == pytest.approx(holder.data.ccdepth.deviation)


@pytest.mark.parametrize("order", [(1.0, 0.0), (0.0, 1.0)])
@in_both_modes
def test_of_several_the_others_are_measured_against_the_active_one(editing: bool, order: tuple[float, float]) -> None:
    source = subdivided_cube(2)
    first, second = (shown_by(source, name, x) for name, x in zip(("First", "Second"), order, strict=True))
    near, moved = (first, second) if order[1] else (second, first)
    for holder in (near, moved):
        holder.data.polygons.foreach_set("select", np.zeros(len(holder.data.polygons), dtype=bool))
    with addon.edit_mode(first, second, source, editing=editing):
        if editing:
            bpy.ops.mesh.select_all(action="DESELECT")
        assert bpy.ops.ccdepth.measure(**ROUGHLY) == bpy.ops.ccdepth.select_worst() == {"FINISHED"}
    assert addon.is_untouched([source])
    assert {each.data.ccdepth.measurement.against for each in (near, moved)} == {"Cube"}
    assert near.data.ccdepth.deviation_reached < 0.1
    assert moved.data.ccdepth.deviation > 0.5
    assert len(addon.deviations(first)) == len(first.data.polygons)
    assert scene.selected_faces(near) == []
    assert scene.selected_faces(moved) == [moved.data.ccdepth.measurement.worst_face]


def test_faces_that_modifiers_make_go_back_to_the_mesh() -> None:
    source = subdivided_cube(2)
    other = scene.add_object(meshes.grid(2, 1), "Other")
    other.modifiers.new("Mirror", "MIRROR").use_axis = (False, False, True)
    other.modifiers.new("Triangulate", "TRIANGULATE")
    other.location.z = 3.0
    addon.measure(other, source)
    values = addon.deviations(other)
    assert len(values) == len(other.data.polygons)
    assert np.all(values > 2.0)


def test_the_worst_face_is_one_of_the_mesh_where_modifiers_repeat_it() -> None:
    """The last copy is four times as large as the cube, and where it is farthest off is a face that was made."""
    holder = scene.add_object(meshes.cube(), "Repeated")
    larger = scene.add_object(meshes.cube(), "Larger")
    larger.location.x, larger.scale = 5.0, (2.0, 2.0, 2.0)
    array = holder.modifiers.new("Array", "ARRAY")
    array.count, array.use_relative_offset, array.use_object_offset, array.offset_object = 3, False, True, larger
    scene.add_subdivision(holder, 1)
    holder.modifiers["Subdivision"].use_limit_surface = True
    addon.measure(holder, **ROUGHLY)
    assert 0 <= holder.data.ccdepth.measurement.worst_face < len(holder.data.polygons)


def test_faces_of_the_limit_surface_count_where_the_object_shows_nothing_of_them() -> None:
    """On its own mesh each face has the farther of both ways. What the viewport shows counts, not what is rendered."""
    holder = scene.add_object(meshes.grid(3, 1), "Masked")
    scene.add_subdivision(holder, 1)
    group = holder.vertex_groups.new(name="Left")
    group.add([vertex.index for vertex in holder.data.vertices if vertex.co.x < 1.5], 1.0, "REPLACE")
    mask = holder.modifiers.new("Mask", "MASK")
    mask.vertex_group, mask.show_render = group.name, False
    addon.measure(holder, **ROUGHLY)
    middles = np.array([polygon.center.x for polygon in holder.data.polygons])
    farthest = int(middles.argmax())
    assert addon.deviations(holder)[farthest] > 0.5
    assert holder.data.ccdepth.measurement.worst_face == farthest


def test_added_faces_count_in_the_largest_alone() -> None:
    source = subdivided_cube(2)
    other = shown_by(source, "Other")
    group = scene.node_tree("GeometryNodeJoinGeometry")
    cube, move = (group.nodes.new(f"GeometryNode{kind}") for kind in ("MeshCube", "Transform"))
    move.inputs["Translation"].default_value = (9.0, 0.0, 0.0)
    group.links.new(cube.outputs["Mesh"], move.inputs["Geometry"])
    group.links.new(move.outputs["Geometry"], group.nodes["Join Geometry"].inputs[0])
    other.modifiers.new("Far", "NODES").node_group = group
    addon.measure(other, source, **ROUGHLY)
    record = other.data.ccdepth
    assert record.deviation_reached > 6.0
    assert addon.deviations(other).max() < 2.0
    assert record.measurement.worst_face == -1
    assert bpy.ops.ccdepth.select_worst() == {"CANCELLED"}


def sharing_a_mesh(names: tuple[str, str]) -> tuple[bpy.types.Object, dict[str, bpy.types.Object]]:
    """A source, and two objects with the mesh that it shows, of which the one called Far is 2 m away."""
    source = subdivided_cube(2)
    holders = {name: shown_by(source, name) for name in names}
    for holder in holders.values():
        holder.data = holders[names[0]].data
    holders["Far"].location.x = 2.0
    return source, holders


@pytest.mark.parametrize("names", [("Near", "Far"), ("Far", "Near")])
def test_objects_that_share_a_mesh_get_the_larger_of_each_face(names: tuple[str, str]) -> None:
    """Whichever of them comes first."""
    source, holders = sharing_a_mesh(names)
    addon.measure(*holders.values(), source, **ROUGHLY)
    record = holders["Far"].data.ccdepth
    assert record.measurement.measured == "Far"
    assert record.deviation >= record.deviation_reached > 1.0
    assert addon.deviations(holders["Far"]).min() > 0.1


def test_objects_that_share_a_mesh_are_as_accurate_as_the_least_accurate() -> None:
    source, holders = sharing_a_mesh(("Far", "Fine"))
    # For its 200,000 triangles there is no time.
    scene.add_subdivision(holders["Fine"], 5)
    addon.measure(*holders.values(), source, accuracy=0.5, time_limit=1.0)
    found = holders["Far"].data.ccdepth.measurement
    assert (found.measured, found.accuracy_met) == ("Far", False)
    bpy.data.objects.remove(holders["Fine"])
    addon.measure(holders["Far"], source, **ROUGHLY)
    assert found.accuracy_met


def test_transforms_of_both_count() -> None:
    source = subdivided_cube(2)
    other = shown_by(source, "Other")
    parent = source.parent = other.parent = scene.add("Parent")
    other.location.x = 0.5
    addon.select(other, source)
    with snapshot.unchanged(lambda path: snapshot.is_ours(path) and path[1] != "Cube"):
        addon.measure(other, source)
    before, reached = other.data.ccdepth.deviation, other.data.ccdepth.deviation_reached
    parent.scale = (3.0, 3.0, 3.0)
    parent.location, parent.rotation_euler = (70.0, -20.0, 11.0), (0.3, 1.0, -2.0)
    addon.measure(other, source)
    record = other.data.ccdepth
    assert record.deviation >= 3.0 * reached
    assert record.deviation_reached <= 3.0 * before
    place = np.array(record.measurement.worst_point)
    assert np.linalg.norm(place - np.array(parent.location)) < 3.0 * np.sqrt(3.0)


def test_an_adaptive_result_is_measured_against_its_source() -> None:
    source = subdivided_cube(2)
    addon.measure(source)
    [result] = subdivide(source, tolerance=0.02)
    assert "ccdepth_deviation" not in result.data.attributes
    record, settings = result.data.ccdepth, {"tolerance": 0.02, "time_limit": 5.0}
    addon.measure(result, **settings)
    alone = (record.deviation, record.deviation_reached)
    assert record.measurement.against == source.name
    assert record.deviation_reached <= 0.02
    assert (record.has_result, record.subdivision, record.shows_deviation) == (True, "ADAPTIVE", True)
    addon.measure(result, source, **settings)
    assert (record.deviation, record.deviation_reached) == alone
    # What Clear removes, it is still a result.
    addon.finish("clear", result)
    addon.measure(result, **settings)
    record = result.data.ccdepth
    assert (record.deviation, record.deviation_reached) == alone
    bpy.data.objects.remove(source)
    refuses("measure", "its source has been removed")


def test_results_are_measured_against_their_own_sources_together() -> None:
    """Whichever of them is active; another object is measured against the active one as before."""
    first, second = subdivided_cube(2), scene.add_object(meshes.torus(5, 4), "Ring")
    second.location.x = 10.0
    results = subdivide(first, second, tolerance=0.05)
    addon.measure(*results, tolerance=0.05, time_limit=5.0)
    assert {each.data.ccdepth.measurement.against for each in results} == {"Cube", "Ring"}
    assert all(each.data.ccdepth.measurement.verdict == "MET" for each in results)
    addon.select(*results)
    assert addon.module("ui.deviation_panel")._plan(bpy.context) == ("2 objects", "their sources")
    other = scene.add_object(meshes.cube(), "Other")
    addon.measure(results[0], results[1], other, tolerance=0.05, time_limit=0.1)
    assert other.data.ccdepth.has_deviation is False
    assert {each.data.ccdepth.measurement.against for each in results} == {"Cube", "Ring"}


def test_against_a_source_at_an_unknown_place_nothing_is_measured(tmp_path: Path) -> None:
    """Blender places no objects of excluded collections, and files hold no places."""
    source = subdivided_cube()
    source.location.x = 3.0
    [result] = subdivide(source, tolerance=0.02)
    addon.measure(result)
    scene.add_collection("Off", source, alone=True)
    bpy.context.view_layer.layer_collection.children["Off"].exclude = True
    scene.open_again(tmp_path)
    addon.examine_touched()
    result = bpy.data.objects["Cube Adaptive"]
    assert addon.module("state.out_of_date").noted(result.data).change == "“Cube” is not shown"
    refuses("measure", "its place in the scene is not known", result)


def test_what_was_measured_against_the_active_object_is_shown() -> None:
    """Although the active object was measured before, and is farther off."""
    source = subdivided_cube(1)
    addon.measure(source, time_limit=1.0)
    [result] = subdivide(source, tolerance=0.02)
    addon.measure(result, source, tolerance=0.02, time_limit=5.0)
    assert bpy.context.active_object == source
    shown = addon.module("state.still_holds").measured_to_show
    assert shown(bpy.context) == result
    bpy.ops.ccdepth.select_worst()
    assert scene.selected_faces(result) == [result.data.ccdepth.measurement.worst_face]
    addon.select(source)
    assert shown(bpy.context) == source


def test_the_heat_map_shows_what_was_done_last() -> None:
    holder, settings = subdivided_cube(), bpy.context.scene.ccdepth
    heat_map = addon.module("state.heat_map")
    for _ in range(2):
        addon.compute(holder, tolerance=0.1)
        assert (settings.heat_map, heat_map.last_kind(holder.data)) == ("DEPTH", heat_map.Shown.DEPTH)
        addon.measure(holder, time_limit=0.1)
        assert (settings.heat_map, heat_map.last_kind(holder.data)) == ("DEVIATION", heat_map.Shown.DEVIATION)
    assert {*addon.ATTRIBUTES, "ccdepth_deviation"} <= {*holder.data.attributes.keys()}
    settings.heat_map = "NONE"
    addon.measure(holder, time_limit=0.1)
    assert settings.heat_map == "NONE"


def view() -> bpy.types.RegionView3D:
    return next(area.spaces.active.region_3d for area in bpy.context.screen.areas if area.type == "VIEW_3D")


@in_both_modes
def test_the_worst_face_is_selected_and_framed(editing: bool) -> None:
    holder = scene.add_object(meshes.torus(5, 4))
    holder.location = (30.0, 0.0, 0.0)
    addon.measure(holder)
    found = holder.data.ccdepth.measurement
    with addon.edit_mode(holder, editing=editing):
        assert bpy.ops.ccdepth.select_worst(frame=True) == {"FINISHED"}
    with addon.edit_mode(holder):
        pass
    assert scene.selected_faces(holder) == [found.worst_face]
    np.testing.assert_allclose(view().view_location, found.worst_point, rtol=1e-6)
    holder.data.polygons[found.worst_face].hide = True
    assert bpy.ops.ccdepth.select_worst() == {"CANCELLED"}


def test_a_distance_within_the_tolerance_is_not_reported_as_more() -> None:
    """Rounded up to four digits it would be 3.465 mm, and the tolerance 3.464 mm."""
    met = addon.module("tasks.deviation_task").Verdict.MET
    facts = addon.module("ui.facts")
    texts = facts.deviation_texts(bpy.context.scene, 0.00346409, 0.001, 0.0034641, None)
    text = facts.deviation_text(*texts, met)
    assert text == "Deviation at most 0.0034641 m, at least 0.001 m: within the tolerance of 0.0034641 m"
    report = addon.module("command_line.report")
    entry = report.ObjectEntry("Cube", {}, 0.0034641, 6, proved=0.00346409)
    told = addon.module("command_line.report_page")._facts(entry)
    assert told["Tolerance"].startswith("3.4641 mm<")
    assert told["Proved distance, at most"].startswith("3.4641 mm<")
