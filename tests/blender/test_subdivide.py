# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision on selected objects: where its result goes, what it is, and what is refused.

How near to the surface the result is, and that nothing on the mesh is lost, is tested elsewhere.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from tests import meshes
from tests.blender import addon, scene
from tests.steps import result_of

TOLERANCE = 0.01


def subdivide(*objects: bpy.types.Object, **settings: object) -> list[bpy.types.Object]:
    """Select the objects and subdivide them; the objects selected then, in the order of their names."""
    addon.select(*objects)
    settings.setdefault("tolerance", TOLERANCE)
    settings.setdefault("tolerance_mode", "ABSOLUTE")
    assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
    return sorted(bpy.context.selected_objects, key=lambda obj: obj.name)


def faces(holder: bpy.types.Object) -> int:
    return len(holder.data.polygons)


def everything_in_the_file() -> dict[str, tuple[object, ...]]:
    """What there is, with what a subdivision could change of it."""
    found: dict[str, tuple[object, ...]] = {item.name_full: () for item in bpy.data.user_map()}
    for obj in bpy.data.objects:
        found[obj.name_full] = (
            obj.data.name_full,
            obj.hide_get(),
            obj.hide_render,
            obj.select_get(),
            [modifier.name for modifier in obj.modifiers],
        )
    for mesh in bpy.data.meshes:
        coordinates = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        mesh.vertices.foreach_get("co", coordinates)
        names = [name for name in mesh.attributes.keys() if not name.startswith(".select")]  # noqa: SIM118
        found[mesh.name_full] = (len(mesh.polygons), coordinates.tobytes(), mesh.users, sorted(names))
    return found


def refused(*objects: bpy.types.Object, match: str, **settings: object) -> None:
    """The operator reports an error, and nothing is changed."""
    addon.select(*objects)
    settings.setdefault("tolerance", TOLERANCE)
    settings.setdefault("tolerance_mode", "ABSOLUTE")
    before = everything_in_the_file()
    with pytest.raises(RuntimeError, match=match):
        bpy.ops.ccdepth.subdivide(**settings)
    assert everything_in_the_file() == before


def shape(holder: bpy.types.Object) -> np.ndarray:
    """(V, 3): where the object's vertices are in the scene."""
    bpy.context.view_layer.update()
    positions = np.empty(3 * len(holder.data.vertices), dtype=np.float32)
    holder.data.vertices.foreach_get("co", positions)
    world = np.array(holder.matrix_world)
    return positions.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3]


# What is made, and where.


def test_the_result_is_a_new_object_beside_the_hidden_original() -> None:
    holder = scene.add_suzanne()
    collection = bpy.data.collections.new("Heads")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(holder)
    parent = bpy.data.objects.new("Parent", None)
    collection.objects.link(parent)
    holder.parent, parent.location = parent, (1.0, 2.0, 3.0)
    before = faces(holder)
    [result] = subdivide(holder)
    bpy.context.view_layer.update()
    assert result != holder
    assert result.matrix_world == holder.matrix_world
    assert set(result.users_collection) == set(holder.users_collection)
    assert result.parent == parent
    assert bpy.context.active_object == result
    assert (holder.hide_get(), holder.hide_render, result.visible_get(), result.hide_render) == (
        True,
        True,
        True,
        False,
    )
    assert faces(holder) == before
    assert faces(result) > before
    assert addon.is_untouched([holder])


def test_the_result_can_take_the_place_of_the_mesh() -> None:
    holder = scene.add_suzanne()
    name = holder.data.name
    [result] = subdivide(holder, output="IN_PLACE")
    assert result == holder
    assert (holder.data.name, [mesh.name for mesh in bpy.data.meshes]) == (name, [name])
    assert faces(holder) > 500
    assert holder.visible_get()


def test_the_attributes_tell_depths_and_proved_distances() -> None:
    [result] = subdivide(scene.add_suzanne())
    kinds = {name: result.data.attributes[name] for name in ("ccdepth", "ccdepth_bound")}
    assert {name: (kind.domain, kind.data_type) for name, kind in kinds.items()} == {
        "ccdepth": ("FACE", "INT"),
        "ccdepth_bound": ("FACE", "FLOAT"),
    }
    assert "ccdepth_color" not in result.data.attributes
    assert 0 < addon.bounds(result).max() <= np.float32(TOLERANCE)
    assert addon.depths(result).min() >= 0


def test_the_record_tells_what_was_made_and_is_not_out_of_date() -> None:
    holder = scene.add_suzanne()
    scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS")
    [result] = subdivide(holder, mode="PER_FACE")
    record = result.data.ccdepth
    depths = addon.depths(result)
    assert (record.subdivision, record.faces, record.base_faces) == ("PER_FACE", len(depths), 500)
    assert record.world_tolerance == pytest.approx(TOLERANCE)
    assert record.largest_bound == addon.bounds(result).max()
    assert addon.histogram(result) == dict(zip(*np.unique(depths, return_counts=True), strict=True))
    addon.module("state.staleness").check_touched()
    assert addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, result.data) == ""
    result.data.vertices[0].co.x += 1.0
    result.data.update()
    bpy.context.view_layer.update()
    addon.module("state.staleness").check_touched()
    assert "mesh changed" in addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, result.data)


def test_an_earlier_result_stays_with_the_original_alone() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    [result] = subdivide(holder)
    assert "ccdepth_color" in holder.data.attributes
    assert "ccdepth_color" not in result.data.attributes
    assert result.data.attributes.active_color_name != "ccdepth_color"


def test_each_mode_and_transition_makes_another_mesh() -> None:
    holder = scene.add_suzanne()
    sizes, corners = {}, {}
    for mode in ("ADAPTIVE", "PER_FACE"):
        for transitions in ("TRIANGLES", "NGONS"):
            holder.hide_set(False)
            [result] = subdivide(holder, mode=mode, transitions=transitions)
            sizes[mode, transitions] = faces(result)
            corners[mode, transitions] = max(polygon.loop_total for polygon in result.data.polygons)
    assert sizes["ADAPTIVE", "TRIANGLES"] < sizes["PER_FACE", "TRIANGLES"]
    assert len(set(sizes.values())) == 4
    for mode in ("ADAPTIVE", "PER_FACE"):
        assert corners[mode, "TRIANGLES"] <= 4 < corners[mode, "NGONS"]


def test_exact_normals_are_custom_normals() -> None:
    holder = scene.add_suzanne()
    [plain] = subdivide(holder)
    holder.hide_set(False)
    [exact] = subdivide(holder, exact_normals=True)
    assert not plain.data.has_custom_normals
    assert exact.data.has_custom_normals


# Tolerance.


@pytest.mark.parametrize("scale", [(2.0, 2.0, 2.0), (1.0, 4.0, 0.3), (-2.0, 1.0, 1.0)])
def test_scale_is_counted_in(scale: tuple[float, float, float]) -> None:
    holder = scene.add_suzanne()
    holder.scale = scale
    holder.location = (100.0, 0.0, 0.0)
    [scaled] = subdivide(holder)
    applied = scene.add_suzanne()
    applied.data.transform(Matrix.Diagonal((*scale, 1.0)))
    [same] = subdivide(applied)
    assert abs(faces(scaled) - faces(same)) <= 0.002 * faces(same)
    assert scaled.scale[:] == pytest.approx(scale)
    assert addon.bounds(scaled).max() <= np.float32(TOLERANCE)


def test_a_relative_tolerance_is_a_part_of_the_diagonal() -> None:
    holder = scene.add_suzanne()
    diagonal = holder.dimensions.length
    [relative] = subdivide(holder, tolerance=0.004, tolerance_mode="RELATIVE")
    assert relative.data.ccdepth.world_tolerance == pytest.approx(0.004 * diagonal)
    holder.hide_set(False)
    [absolute] = subdivide(holder, tolerance=0.004 * diagonal)
    assert faces(relative) == faces(absolute)


def test_settings_come_from_the_scene_unless_given() -> None:
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
    settings.output, settings.transitions = "IN_PLACE", "NGONS"
    first, second = scene.add_suzanne(), scene.add_suzanne()
    addon.select(first)
    assert bpy.ops.ccdepth.subdivide() == {"FINISHED"}
    subdivide(second, output="IN_PLACE", transitions="NGONS")
    assert faces(first) == faces(second)


def test_the_result_has_the_shape_of_the_surface() -> None:
    holder = scene.add_suzanne()
    [result] = subdivide(holder)
    scene.add_subdivision(holder, 4).use_limit_surface = True
    surface = scene.evaluated_mesh_data(holder).positions
    found = shape(result)
    nearest = [np.linalg.norm(surface - point, axis=1).min() for point in found[:: len(found) // 100]]
    assert max(nearest) < 5 * TOLERANCE


# Faces counted beforehand.


def test_the_count_is_what_is_made() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.creased_cube())
    scene.add_subdivision(first, 1)
    before = everything_in_the_file()
    for mode in ("ADAPTIVE", "PER_FACE"):
        for transitions in ("TRIANGLES", "NGONS"):
            for obj in (first, second):
                obj.hide_set(False)
            addon.select(first, second)
            settings = bpy.context.scene.ccdepth
            settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
            settings.mode, settings.transitions = mode, transitions
            assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
            counts = [known_count(obj).faces for obj in (second, first)]
            results = subdivide(first, second, mode=mode, transitions=transitions)
            assert [faces(result) for result in results] == counts
            bpy.data.batch_remove([result.data for result in results])
    assert set(everything_in_the_file()) == set(before)


def known_count(holder: bpy.types.Object) -> object:
    settings = bpy.context.scene.ccdepth
    asked = addon.module("tasks.adaptive_task").subdivision_settings(settings, settings.tolerance)
    return addon.module("state.face_counts").known_count(holder, asked)


def test_counting_changes_nothing() -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Mirror", "MIRROR")
    addon.select(holder)
    before = everything_in_the_file()
    assert bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE) == {"FINISHED"}
    assert everything_in_the_file() == before


@pytest.mark.parametrize("change", ["mesh", "scale", "settings"])
def test_a_count_is_forgotten_when_something_changes(change: str) -> None:
    holder = scene.add_suzanne()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", TOLERANCE
    addon.select(holder)
    bpy.ops.ccdepth.count_faces()
    bpy.context.view_layer.update()
    assert known_count(holder) is not None
    if change == "mesh":
        holder.data.vertices[0].co.x += 1.0
        holder.data.update()
    elif change == "scale":
        holder.scale.x = 2.0
    else:
        settings.tolerance *= 2
    bpy.context.view_layer.update()
    assert known_count(holder) is None


@pytest.mark.parametrize("tolerance_mode", ["ABSOLUTE", "RELATIVE"])
def test_too_many_faces_are_refused_with_a_tolerance_that_fits(tolerance_mode: str) -> None:
    holder = scene.add_suzanne()
    holder.scale = (3.0, 3.0, 3.0)
    asked = {"tolerance": 0.0005, "tolerance_mode": tolerance_mode, "max_faces": 3000}
    refused(holder, match="Suzanne: the result would have about .* 3,000 are allowed", **asked)
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.ccdepth.subdivide(**asked)
    words = str(caught.value).partition("a tolerance of ")[2].split()
    assert ("of the diagonal" in str(caught.value)) == (tolerance_mode == "RELATIVE")
    [result] = subdivide(holder, **{**asked, "tolerance": float(words[0])})
    assert faces(result) <= 3000


def named_tolerance(*objects: bpy.types.Object, **settings: object) -> float:
    """That which the refusal says would fit."""
    addon.select(*objects)
    with pytest.raises(RuntimeError, match="would fit") as caught:
        bpy.ops.ccdepth.subdivide(tolerance_mode="RELATIVE", **settings)
    return float(str(caught.value).partition("a tolerance of ")[2].split()[0])


@pytest.mark.parametrize("mode", ["ADAPTIVE", "PER_FACE"])
@pytest.mark.parametrize("name", ["cylinder", "pole", "Suzanne"])
def test_the_tolerance_named_fits_large_results_too(name: str, mode: str) -> None:
    """These are too large to be tried from the start; a pole may be as deep as its whole face."""
    data = {"cylinder": lambda: meshes.cylinder(32), "pole": lambda: meshes.fan(12, 2)}
    holder = scene.add_object(data[name]()) if name in data else scene.add_suzanne()
    asked = {"mode": mode, "max_faces": 60_000}
    tolerance = named_tolerance(holder, tolerance=1e-6, **asked)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", **asked)
    assert faces(result) <= 60_000


def test_no_tolerance_fits_where_the_mesh_itself_has_too_many_faces() -> None:
    refused(scene.add_suzanne(), match="no tolerance would fit", max_faces=100)


@pytest.mark.parametrize("max_faces", [500, 600])
def test_a_tolerance_fits_where_the_mesh_itself_has_hardly_fewer_faces(max_faces: int) -> None:
    """Suzanne has 500."""
    holder = scene.add_suzanne()
    tolerance = named_tolerance(holder, tolerance=1e-4, max_faces=max_faces)
    [result] = subdivide(holder, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=max_faces)
    assert faces(result) <= max_faces


def test_the_limit_is_for_all_objects_together() -> None:
    objects = [scene.add_suzanne(), scene.add_suzanne()]
    [alone] = subdivide(objects[0])
    objects[0].hide_set(False)
    refused(*objects, match="The 2 results together .* are allowed", max_faces=int(1.5 * faces(alone)))


@pytest.mark.parametrize("max_faces", [1100, 2000, 3000])
def test_the_tolerance_named_fits_all_objects_together(max_faces: int) -> None:
    objects = [scene.add_suzanne(), scene.add_suzanne()]
    objects[1].scale = (2.0, 2.0, 2.0)
    tolerance = named_tolerance(*objects, tolerance=0.002, max_faces=max_faces)
    results = subdivide(*objects, tolerance=tolerance, tolerance_mode="RELATIVE", max_faces=max_faces)
    assert sum(map(faces, results)) <= max_faces


def test_counting_tells_when_all_objects_together_have_too_many_faces(capfd: pytest.CaptureFixture[str]) -> None:
    objects = [scene.add_suzanne(), scene.add_suzanne()]
    [alone] = subdivide(objects[0])
    objects[0].hide_set(False)
    addon.select(*objects)
    bpy.ops.ccdepth.count_faces(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE", max_faces=int(1.5 * faces(alone)))
    assert f"The 2 results together would have about {2 * faces(alone):,} faces" in capfd.readouterr().out


# Names, and numbers that are none.


@pytest.mark.parametrize("name", ["UVMap", "Paint", "sharp_face", "ccdepth_weights_0"])
def test_a_vertex_group_may_have_the_name_of_an_attribute(name: str) -> None:
    holder = scene.add_suzanne()
    mesh = holder.data
    mesh.uv_layers.new(name="UVMap")
    mesh.attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    if "sharp_face" not in mesh.attributes:
        mesh.attributes.new("sharp_face", "BOOLEAN", "FACE")
    mesh.attributes.active = mesh.attributes["Paint"]
    for group in (name, "Other"):
        holder.vertex_groups.new(name=group).add([*range(100)], 0.5, "REPLACE")
    [result] = subdivide(holder)
    assert [group.name for group in result.vertex_groups] == [name, "Other"]
    assert {"UVMap", "Paint", "sharp_face"} <= {*result.data.attributes.keys()}
    assert not any(attribute.name.startswith("ccdepth_weights") for attribute in result.data.attributes)
    assert holder.data.attributes.active.name == result.data.attributes.active.name == "Paint"
    assert [round(entry.weight, 5) for entry in result.data.vertices[0].groups] == [0.5, 0.5]


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_shape_keys_at_no_finite_position_are_refused(value: float) -> None:
    """Even where they are not mixed in."""
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Odd")
    key.value = 0.0
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))
    refused(holder, match="Suzanne: the shape key “Odd” has a vertex at no finite position")


@pytest.mark.parametrize(("name", "domain"), [("crease_edge", "EDGE"), ("crease_vert", "POINT")])
def test_creases_that_are_no_numbers_are_refused(name: str, domain: str) -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new(name, "FLOAT", domain).data[5].value = np.nan
    refused(holder, match=r"1 (edge|vertex) with a crease that is no number \(first: (edge|vertex) 5\)")
    with pytest.raises(RuntimeError, match="with a crease that is no number"):
        bpy.ops.ccdepth.compute()


def test_loose_vertices_may_be_anywhere() -> None:
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.5), (np.nan, 0, 0)], [], [(0, 1, 2, 3)])
    [result] = subdivide(scene.add_mesh(mesh))
    assert np.count_nonzero(np.isnan(shape(result)[:, 0])) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e38])
@pytest.mark.parametrize("data_type", ["FLOAT", "FLOAT2", "FLOAT_COLOR", "QUATERNION", "FLOAT4X4"])
def test_attributes_may_have_any_values(data_type: str, value: float) -> None:
    """None of the warnings of numpy are printed, which pytest would take for errors."""
    holder = scene.add_suzanne()
    for domain in ("POINT", "CORNER"):
        kind = addon.module("exchange.attributes").TYPES[data_type]
        items = holder.data.attributes.new(f"{data_type} {domain}", data_type, domain).data
        values = np.zeros(len(items) * kind.width, dtype=np.float32)
        values[[3, 50]] = value
        items.foreach_set(kind.value, values)
    subdivide(holder)


# Several objects, and Edit Mode.


def test_several_objects_get_a_result_each() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.landscape(5, 5), "Land")
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.scene.collection.objects.link(light)
    results = subdivide(light, first, second)
    assert [result.name for result in results] == ["Land Adaptive", "Light", "Suzanne Adaptive"]
    assert bpy.context.active_object == results[0]


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_objects_that_share_a_mesh_share_the_result(output: str) -> None:
    first = scene.add_suzanne()
    second, large = scene.add_mesh(first.data), scene.add_mesh(first.data)
    second.rotation_euler = (0.1, 0.2, 0.3)
    large.scale = (3.0, 3.0, 3.0)
    other = scene.add_mesh(first.data)
    results = subdivide(first, second, large, output=output)
    assert len({result.data for result in results}) == 1
    assert other.data not in {result.data for result in results}
    assert faces(other) == 500
    assert addon.bounds(large if output == "IN_PLACE" else results[0]).max() <= np.float32(TOLERANCE)


def test_objects_that_share_a_mesh_but_not_the_surface_get_results_of_their_own() -> None:
    first = scene.add_suzanne()
    bent, wide = scene.add_mesh(first.data), scene.add_mesh(first.data)
    bent.modifiers.new("Bend", "SIMPLE_DEFORM").angle = 1.0
    wide.scale = (3.0, 0.5, 0.5)
    results = subdivide(first, bent, wide)
    assert len({result.data for result in results}) == 3


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_edit_mode_is_left_and_entered_again(output: str) -> None:
    import bmesh

    first, second = scene.add_suzanne(), scene.add_object(meshes.creased_cube())
    with addon.edit_mode(first, second):
        edited = bmesh.from_edit_mesh(first.data)
        edited.verts.ensure_lookup_table()
        edited.verts[3].co.z += 0.5
        bmesh.update_edit_mesh(first.data)
        settings = {"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE", "output": output}
        assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
        assert bpy.context.mode == "EDIT_MESH"
        assert len(bpy.context.objects_in_mode) == 2
        results = sorted(bpy.context.objects_in_mode, key=lambda obj: obj.name)
    names = ["Mesh", "Suzanne"] if output == "IN_PLACE" else ["Mesh Adaptive", "Suzanne Adaptive"]
    assert [result.name for result in results] == names
    assert all(addon.depths(result).max() > 0 for result in results)
    assert shape(results[1]).max() > 1.2


def test_edit_mode_stays_when_something_is_refused() -> None:
    holder = scene.add_suzanne()
    with addon.edit_mode(holder):
        with pytest.raises(RuntimeError, match="greater than zero"):
            bpy.ops.ccdepth.subdivide(tolerance=0.0)
        assert bpy.context.mode == "EDIT_MESH"


# All results are placed, or none.


def made_meshes(objects: list[bpy.types.Object]) -> tuple[object, object]:
    """Their results before they are placed, and the settings."""
    task, made = addon.module("tasks.adaptive_task"), addon.module("exchange.result_objects")
    settings = task.SubdivisionSettings(TOLERANCE, "ABSOLUTE", True, "ADAPTIVE", "TRIANGLES", 5_000_000)
    tasks = result_of(task.prepare_subdivision(bpy.context, objects, settings))
    answers = result_of(task.subdivide_stepwise(tasks, settings))
    return result_of(made.make_meshes(bpy.context, answers, settings, exact_normals=False)), settings


def three_objects() -> list[bpy.types.Object]:
    """Two of them share a mesh, one is not selected, and all have modifiers."""
    first = scene.add_object(meshes.cube())
    objects = [first, scene.add_mesh(first.data), scene.add_object(meshes.cube())]
    for holder, name in zip(objects, ("First", "Second", "Third"), strict=True):
        holder.name = name
    objects[1].scale = (3.0, 0.5, 1.0)
    for holder in objects:
        scene.add_subdivision(holder, 1)
    objects[2].hide_render = True
    addon.select(*objects[:2])
    return objects


@pytest.mark.parametrize("output", ["IN_PLACE", "NEW_OBJECT"])
def test_all_is_placed(output: str) -> None:
    objects = three_objects()
    made, settings = made_meshes(objects)
    place = addon.module("exchange.result_objects").place_meshes
    placed = place(bpy.context, made, settings, in_place=output == "IN_PLACE")
    assert len(placed) == 3
    assert not any(holder.modifiers for holder in placed)
    assert all(holder.data.ccdepth.subdivision for holder in placed)


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_objects_that_cannot_be_placed_beside_leave_all_as_they_were(failing: int) -> None:
    """One has left the view layer meanwhile, which may be the first, or come after others."""
    objects = three_objects()
    before = everything_in_the_file()
    collection = bpy.data.collections.new("Left out")
    made, settings = made_meshes(objects)
    bpy.context.scene.collection.children.link(collection)
    active = bpy.context.view_layer.objects.active
    collection.objects.link(objects[failing])
    bpy.context.scene.collection.objects.unlink(objects[failing])
    bpy.context.view_layer.layer_collection.children["Left out"].exclude = True
    result_objects, surfaces = addon.module("exchange.result_objects"), addon.module("tasks.surfaces")
    with pytest.raises(surfaces.ComputeError, match="nothing was written"):
        result_objects.place_meshes(bpy.context, made, settings, in_place=False)
    bpy.context.scene.collection.objects.link(objects[failing])
    bpy.data.collections.remove(collection)
    bpy.context.view_layer.update()
    objects[failing].select_set(before[objects[failing].name][3])
    assert everything_in_the_file() == before
    if failing != 1:
        assert bpy.context.view_layer.objects.active == active


@pytest.mark.parametrize("failing", [1, 2, 3])
def test_whatever_goes_wrong_beside_leaves_all_as_it_was(failing: int, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = three_objects()
    before, active = everything_in_the_file(), bpy.context.view_layer.objects.active
    made, settings = made_meshes(objects)
    result_objects = addon.module("exchange.result_objects")
    link, calls = result_objects._link_beside, []

    def odd(*arguments: object) -> None:
        calls.append(arguments)
        if len(calls) == failing:
            raise LookupError("odd")
        link(*arguments)

    monkeypatch.setattr(result_objects, "_link_beside", odd)
    with pytest.raises(LookupError, match="odd"):
        result_objects.place_meshes(bpy.context, made, settings, in_place=False)
    assert everything_in_the_file() == before
    assert bpy.context.view_layer.objects.active == active


def test_objects_whose_mesh_cannot_be_replaced_leave_all_as_they_were() -> None:
    """The last is in Edit Mode, where Blender drops the new mesh and says nothing."""
    objects = three_objects()
    before = everything_in_the_file()
    made, settings = made_meshes(objects)
    result_objects, surfaces = addon.module("exchange.result_objects"), addon.module("tasks.surfaces")
    with addon.edit_mode(objects[2]), pytest.raises(surfaces.ComputeError, match="nothing was written"):
        result_objects.place_meshes(bpy.context, made, settings, in_place=True)
    addon.select(*objects[:2])
    assert everything_in_the_file() == before


# Modifiers and shape keys.


@pytest.mark.parametrize(
    ("operator", "name"),
    [
        ("subdivide", "prepare_subdivision"),
        ("subdivide", "subdivide_stepwise"),
        ("subdivide", "make_meshes"),
        ("subdivide", "place_meshes"),
        ("count_faces", "count_text"),
    ],
)
def test_edit_mode_stays_whatever_goes_wrong(operator: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    bpy.ops.object.mode_set(mode="EDIT")

    def failing(*_: object, **__: object) -> None:
        raise LookupError("odd")

    monkeypatch.setattr(addon.module("operators.adaptive_operators"), name, failing)
    with pytest.raises(RuntimeError, match="odd"):
        getattr(bpy.ops.ccdepth, operator)(tolerance=TOLERANCE)
    assert bpy.context.mode == "EDIT_MESH"


@pytest.mark.parametrize("operator", ["subdivide", "count_faces", "compute"])
def test_an_operator_that_has_run_keeps_nothing_of_its_work(operator: str) -> None:
    """Blender keeps the last operators, with all they hold."""
    addon.select(scene.add_suzanne())
    work = addon.module("operators.stepwise").Stepwise
    assert getattr(bpy.ops.ccdepth, operator)("EXEC_DEFAULT", True, tolerance=TOLERANCE) == {"FINISHED"}
    gc.collect()
    assert not [kept for kept in gc.get_objects() if isinstance(kept, work)]


def test_what_was_counted_in_is_taken_off_the_result() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    holder.modifiers.new("Mirror", "MIRROR")
    holder.modifiers.new("Off", "DISPLACE").show_viewport = False
    scene.add_subdivision(holder, 2)
    holder.modifiers.new("Bend", "SIMPLE_DEFORM")
    [counted] = subdivide(holder)
    assert [modifier.name for modifier in counted.modifiers] == ["Off", "Bend"]
    assert counted.data.ccdepth.base_faces == 2 * faces(holder)
    holder.hide_set(False)
    [left_out] = subdivide(holder, use_modifiers=False)
    assert [modifier.name for modifier in left_out.modifiers] == ["Mirror", "Off", "Bend"]
    assert left_out.data.ccdepth.base_faces == faces(holder)
    assert [modifier.name for modifier in holder.modifiers] == ["Mirror", "Off", "Subdivision", "Bend"]


def test_what_modifiers_make_is_carried_over() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    holder.data.uv_layers.new(name="Map")
    holder.data.materials.append(bpy.data.materials.new("Red"))
    holder.vertex_groups.new(name="Group").add(range(8), 0.5, "REPLACE")
    holder.modifiers.new("Mirror", "MIRROR")
    [result] = subdivide(holder, output="IN_PLACE")
    assert result == holder
    assert [layer.name for layer in result.data.uv_layers] == ["Map"]
    assert [slot.material.name for slot in result.material_slots] == ["Red"]
    assert [group.name for group in result.vertex_groups] == ["Group"]
    weighted = [vertex for vertex in result.data.vertices if vertex.groups]
    assert 0 < len(weighted) < len(result.data.vertices)
    assert len(bpy.data.meshes) == 1


def test_modifiers_that_merge_faces_can_be_counted_in() -> None:
    holder = scene.add_suzanne()
    remesh = holder.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.3
    [result] = subdivide(holder)
    assert not result.modifiers
    assert faces(result) > 100


def test_materials_of_the_object_stay_with_it() -> None:
    holder = scene.add_suzanne()
    holder.data.materials.append(bpy.data.materials.new("Red"))
    holder.material_slots[0].link = "OBJECT"
    holder.material_slots[0].material = bpy.data.materials.new("Blue")
    [result] = subdivide(holder)
    assert [(slot.link, slot.material.name) for slot in result.material_slots] == [("OBJECT", "Blue")]


def test_particles_are_kept() -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Hair", "PARTICLE_SYSTEM")
    [result] = subdivide(holder)
    assert [modifier.name for modifier in result.modifiers] == ["Hair"]


def test_shape_keys_stay_and_their_mix_is_measured() -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Long")
    for point in key.points:
        point.co.z *= 3.0
    key.value = 1.0
    [result] = subdivide(holder)
    long = scene.add_suzanne()
    long.data.transform(Matrix.Diagonal((1.0, 1.0, 3.0, 1.0)))
    [same] = subdivide(long)
    assert [block.name for block in result.data.shape_keys.key_blocks] == ["Basis", "Long"]
    assert abs(faces(result) - faces(same)) <= 0.01 * faces(same)
    assert addon.bounds(result).max() <= np.float32(TOLERANCE)


def test_shape_keys_are_applied_with_modifiers_and_that_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    holder.shape_key_add(name="Other").value = 0.5
    holder.modifiers.new("Bend", "SIMPLE_DEFORM")
    [result] = subdivide(holder)
    assert result.data.shape_keys is None
    assert "Suzanne: its shape keys are applied" in capfd.readouterr().out


# Undo and redo.


@pytest.mark.parametrize("editing", [False, True])
@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_undo_takes_everything_back(editing: bool, output: str) -> None:
    holder = scene.add_suzanne()
    scene.add_subdivision(holder, 1)
    addon.select(holder)
    bpy.ops.ed.undo_push(message="before")
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.ed.undo_push(message="Edit Mode")
    assert bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, output=output) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Apply Adaptive Subdivision")
    bpy.ops.ed.undo()
    assert bpy.context.mode == ("EDIT_MESH" if editing else "OBJECT")
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    [holder] = bpy.data.objects
    assert (faces(holder), holder.visible_get(), holder.hide_render) == (500, True, False)
    assert [modifier.name for modifier in holder.modifiers] == ["Subdivision"]
    assert len(bpy.data.meshes) == 1


@pytest.mark.parametrize("editing", [False, True])
@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
def test_done_again_with_another_tolerance_it_is_as_if_done_so_at_once(editing: bool, output: str) -> None:
    """As Adjust Last Operation does it: undone, and executed anew. The window's test presses on from there."""
    found = []
    for tolerances in ([0.1], [TOLERANCE, 0.003, 0.1]):
        scene.clear()
        holder = scene.add_suzanne()
        scene.add_subdivision(holder, 1)
        addon.select(holder)
        bpy.ops.ed.undo_push(message="before")
        if editing:
            bpy.ops.object.mode_set(mode="EDIT")
            bpy.ops.ed.undo_push(message="Edit Mode")
        for again, tolerance in enumerate(tolerances):
            if again:
                bpy.ops.ed.undo()
                assert (len(bpy.data.objects), len(bpy.data.meshes)) == (1, 1)
            settings = {"tolerance": tolerance, "tolerance_mode": "ABSOLUTE", "output": output}
            assert bpy.ops.ccdepth.subdivide(**settings) == {"FINISHED"}
            bpy.ops.ed.undo_push(message="Apply Adaptive Subdivision")
        assert bpy.context.active_object.data.ccdepth.tolerance == pytest.approx(0.1)
        if bpy.context.mode == "EDIT_MESH":
            bpy.ops.object.mode_set(mode="OBJECT")
        found.append(everything_in_the_file())
    assert found[0] == found[1]


def test_it_can_be_undone_and_repeated() -> None:
    assert bpy.types.CCDEPTH_OT_subdivide.bl_options >= {"REGISTER", "UNDO"}
    assert "UNDO" not in bpy.types.CCDEPTH_OT_count_faces.bl_options


# What is refused.


def no_faces() -> bpy.types.Object:
    return scene.add_mesh(bpy.data.meshes.new("Empty"))


def not_finite() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.data.vertices[0].co.x = np.nan
    return holder


def simulated() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.modifiers.new("Cloth", "CLOTH")
    return holder


def with_attribute_of_the_same_name() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.data.attributes.new("ccdepth", "FLOAT", "POINT")
    return holder


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (no_faces, "the mesh has no faces"),
        (not_finite, "1 vertex"),
        (simulated, "“Cloth” is a simulation"),
        (with_attribute_of_the_same_name, "called “ccdepth”"),
    ],
)
def test_bad_meshes_are_refused(make: Callable[[], bpy.types.Object], message: str) -> None:
    good, bad = scene.add_object(meshes.cube(), "Good"), make()
    refused(good, bad, match=f"{bad.name}: .*{message}")


@pytest.mark.parametrize(
    ("tolerance", "message"),
    [
        (0.0, "greater than zero"),
        (-1.0, "greater than zero"),
        (float("nan"), "not a finite number"),
        (1e-12, "Suzanne: the tolerance 1e-12 is finer than the mesh's single-precision coordinates can show"),
    ],
)
def test_bad_tolerances_are_refused(tolerance: float, message: str) -> None:
    refused(scene.add_suzanne(), match=message, tolerance=tolerance)


def test_flattened_objects_are_refused() -> None:
    holder = scene.add_suzanne()
    holder.scale = (1.0, 1.0, 0.0)
    refused(holder, match="Suzanne: 4 faces with zero area")


def test_hidden_objects_are_refused() -> None:
    shown, hidden = scene.add_object(meshes.cube(), "Shown"), scene.add_suzanne()
    addon.select(shown)
    hidden.hide_set(True)
    with (
        bpy.context.temp_override(selected_objects=[shown, hidden], active_object=shown),
        pytest.raises(RuntimeError, match="Suzanne: the object is hidden; show it first"),
    ):
        bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE)
    assert len(bpy.data.objects) == 2


def test_linked_objects_are_refused(tmp_path: Path) -> None:
    holder = scene.add_suzanne()
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {holder})
    scene.clear()
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (source, target):
        target.objects = list(source.objects)
    [linked] = target.objects
    bpy.context.scene.collection.objects.link(linked)
    refused(linked, match="Suzanne: the object is linked from another file")


def test_without_a_mesh_object_it_is_not_offered() -> None:
    addon.select()
    assert not bpy.ops.ccdepth.subdivide.poll()
    assert not bpy.ops.ccdepth.count_faces.poll()


# Long runs.


def test_giving_up_leaves_everything_as_it_was() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    subdivision = addon.module("tasks.adaptive_task")
    before = everything_in_the_file()
    settings = subdivision.SubdivisionSettings(1e-5, "RELATIVE", True, "ADAPTIVE", "TRIANGLES", 5_000_000)
    tasks = result_of(subdivision.prepare_subdivision(bpy.context, [holder], settings))
    run = addon.module("operators.stepwise").Stepwise(subdivision.subdivide_stepwise(tasks, settings))
    assert not run.work(0.05)
    assert run.progress > 0
    run.give_up()
    assert everything_in_the_file() == before


# Objects of uneven scale.


def folded_unless_flattened(data: meshes.MeshData, name: str = "Mesh") -> bpy.types.Object:
    """Flattened, the object is smooth where its mesh is folded, and Blender triangulates the mesh."""
    holder = scene.add_object(replace(data, positions=data.positions * (1.0, 1.0, 200.0)), name)
    holder.scale = (1.0, 1.0, 0.005)
    return holder


def test_quads_are_drawn_along_the_diagonal_that_was_proved_on_a_flattened_object() -> None:
    holder = folded_unless_flattened(meshes.bumpy(meshes.torus(9, 6), 0.2))
    [result] = subdivide(holder, tolerance=0.05)
    assert_quads_are_drawn_along_their_first_diagonal(result.data)


def assert_quads_are_drawn_along_their_first_diagonal(mesh: bpy.types.Mesh) -> None:
    assert any(polygon.loop_total == 4 for polygon in mesh.polygons)
    mesh.calc_loop_triangles()
    for triangle in mesh.loop_triangles:
        polygon = mesh.polygons[triangle.polygon_index]
        if polygon.loop_total == 4:
            places = sorted(loop - polygon.loop_start for loop in triangle.loops)
            assert places in ([0, 1, 2], [0, 2, 3])


@pytest.mark.parametrize("transitions", ["TRIANGLES", "NGONS"])
def test_faces_of_uneven_objects_are_counted_as_they_are_made(transitions: str) -> None:
    landscape = folded_unless_flattened(meshes.landscape(6, 5), "Landscape")
    fan = folded_unless_flattened(meshes.fan(5, 2), "Fan")
    sheared = scene.add_object(meshes.bumpy(meshes.cylinder(7), 0.2), "Sheared")
    holders = landscape, fan, sheared
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (10.0, 1.0, 0.1)
    sheared.parent = parent
    sheared.rotation_euler = (0.5, 0.6, 0.7)
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.transitions = "ABSOLUTE", 0.1, transitions
    addon.select(*holders)
    assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    counts = {holder.name: known_count(holder).faces for holder in holders}
    results = subdivide(*holders, tolerance=0.1, transitions=transitions)
    assert {result.name.removesuffix(" Adaptive"): faces(result) for result in results} == counts


@pytest.mark.parametrize("scale", [(1.0, 1.0, 0.0), (1.0, 1.0, -1e-12)])
def test_objects_scaled_to_nothing_are_drawn_as_they_are_proved(scale: tuple[float, float, float]) -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.scale = scale
    addon.select(holder)
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.transitions = "ABSOLUTE", TOLERANCE, "NGONS"
    assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    count = known_count(holder).faces
    [result] = subdivide(holder, transitions="NGONS")
    assert faces(result) == count
    assert addon.bounds(result).max() <= TOLERANCE
    assert_quads_are_drawn_along_their_first_diagonal(result.data)
