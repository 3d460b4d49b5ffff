# SPDX-License-Identifier: GPL-3.0-or-later
"""Bad input gets a clear report, and changes nothing, not even on the good objects selected with it; faces
without area are faces like others."""

from __future__ import annotations

from collections.abc import Callable

import bmesh
import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.updating import refuses
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender

each_operator = pytest.mark.parametrize("operator", ["compute", "subdivide", "count_faces"])


def refused(operator: str, *objects: bpy.types.Object, match: str, **settings: object) -> None:
    """The operator on these objects and a good one is refused with this report, and changes nothing."""
    addon.select(scene.add_object(meshes.cube(), "Good"), *objects)
    refuses(operator, match, **settings)


@pytest.mark.parametrize(
    ("tolerance", "match"),
    [
        (0.0, "greater than zero"),
        (-0.1, "greater than zero"),
        (float("nan"), "not a finite number"),
        (1e-12, "Suzanne: the tolerance .* is finer than the mesh's single-precision coordinates can show"),
    ],
)
@each_operator
def test_tolerance(operator: str, tolerance: float, match: str) -> None:
    holder = scene.add_suzanne()
    for mode in ("ABSOLUTE", "RELATIVE"):
        refused(operator, holder, match=match, tolerance=tolerance, tolerance_mode=mode)
    bpy.context.scene.ccdepth.relative_tolerance = tolerance
    if tolerance == 0.0:
        refused(operator, holder, match=match)


def exclude(holder: bpy.types.Object) -> None:
    collection = bpy.data.collections.new("Excluded")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(holder)
    bpy.context.scene.collection.objects.unlink(holder)
    addon.select(holder)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True


@pytest.mark.parametrize(
    ("put", "match"),
    [
        (lambda holder: addon.select(), "Select a mesh object"),
        (lambda holder: addon.select(scene.add_light()), "Select a mesh object"),
        (lambda holder: bpy.ops.object.mode_set(mode="SCULPT"), "Object Mode and in Edit Mode"),
        (lambda holder: holder.hide_set(True), "Suzanne: the object is hidden; show it first"),
        (lambda holder: setattr(holder, "hide_viewport", True), "Suzanne: the object is hidden|Select a mesh object"),
        (exclude, "Select a mesh object"),
    ],
)
@each_operator
def test_objects_out_of_reach(operator: str, put: Callable[[bpy.types.Object], object], match: str) -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    put(holder)
    refuses(operator, match)


def test_hidden_objects_that_a_script_names() -> None:
    shown, hidden = scene.add_object(meshes.cube(), "Shown"), scene.add_suzanne()
    addon.select(shown)
    hidden.hide_set(True)
    with bpy.context.temp_override(selected_objects=[shown, hidden], active_object=shown):
        refuses("subdivide", "Suzanne: the object is hidden; show it first")


def test_other_objects_among_the_selected_are_skipped() -> None:
    light, holder = scene.add_light(), scene.add_suzanne()
    addon.compute(holder, light)
    assert holder.data.ccdepth.has_result


def add_wire() -> bpy.types.Object:
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    return scene.add_mesh(mesh)


def with_a_vertex_at(value: float) -> bpy.types.Object:
    holder = scene.add_suzanne()
    # Blender's own access to vertices turns infinity into the largest number.
    positions = holder.data.attributes["position"].data
    values = np.empty(3 * len(positions), dtype=np.float32)
    positions.foreach_get("vector", values)
    values[16] = value
    positions.foreach_set("vector", values)
    return holder


def with_a_repeated_vertex() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube(), "Repeated")
    holder.data.loops[1].vertex_index = holder.data.loops[0].vertex_index
    return holder


def scaled_to_a_point() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.scale = (0.0, 0.0, 0.0)
    return holder


def with_a_group() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.vertex_groups.new(name="ccdepth")
    return holder


def with_odd(name: str, domain: str) -> bpy.types.Object:
    """With a fifth value that is no number."""
    holder = scene.add_suzanne()
    holder.data.attributes.new(name, "FLOAT", domain).data[5].value = np.nan
    return holder


def with_cloth() -> bpy.types.Object:
    holder = scene.add_suzanne()
    holder.modifiers.new("Cloth", "CLOTH")
    return holder


BAD_MESHES: tuple[tuple[Callable[[], bpy.types.Object], str], ...] = (
    (lambda: scene.add_mesh(bpy.data.meshes.new("Empty")), "Empty: the mesh has no faces"),
    (add_wire, "Wire: the mesh has no faces"),
    (lambda: with_a_vertex_at(float("nan")), "Suzanne: 1 vertex at no finite position"),
    (lambda: with_a_vertex_at(float("inf")), "Suzanne: 1 vertex at no finite position"),
    (with_a_repeated_vertex, "Repeated: 1 face with a repeated vertex"),
    (scaled_to_a_point, "Suzanne: all its faces are at one point"),
    (with_a_group, "Suzanne: .*called “ccdepth”"),
    (lambda: with_odd("ccdepth", "POINT"), "Suzanne: .*called “ccdepth”"),
    (with_cloth, "Suzanne: .*“Cloth” is a simulation"),
    (lambda: with_odd("crease_edge", "EDGE"), r"Suzanne: 1 edge with a crease that is not a number \(first: edge 5\)"),
    (lambda: with_odd("crease_vert", "POINT"), r"Suzanne: 1 vertex .* not a number \(first: vertex 5\)"),
)


@pytest.mark.parametrize(("make", "match"), BAD_MESHES)
@each_operator
def test_bad_meshes(operator: str, make: Callable[[], bpy.types.Object], match: str) -> None:
    refused(operator, make(), match=match)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_shape_keys_are_looked_at_though_they_are_not_mixed_in(value: float) -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Odd")
    key.value = 0.0
    key.data.foreach_set("co", np.full(3 * len(key.data), value, dtype=np.float32))
    refused("subdivide", holder, match="Suzanne: .*the shape key “Odd” has a vertex at no finite position")


def test_every_bad_object_is_named() -> None:
    first, second = with_a_vertex_at(float("nan")), scene.add_mesh(bpy.data.meshes.new("Empty"))
    refused("compute", first, second, match=r"(?s)Suzanne: 1 vertex.*Empty: the mesh has no faces")


def linked_suzanne(tmp_path: object) -> bpy.types.Object:
    name = scene.add_suzanne().name
    path = f"{tmp_path}/library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.objects = [name]
    (linked,) = wanted.objects
    bpy.context.scene.collection.objects.link(linked)
    return linked


@pytest.mark.parametrize("override", [False, True])
def test_linked_mesh(tmp_path: object, override: bool) -> None:
    linked = linked_suzanne(tmp_path)
    holder = linked.override_create(remap_local_usages=True) if override else linked
    refused("compute", holder, match="Suzanne: the mesh is linked from another file")


def test_bad_mesh_in_edit_mode() -> None:
    import bmesh

    holder = scene.add_suzanne()
    with addon.edit_mode(holder):
        edited = bmesh.from_edit_mesh(holder.data)
        bmesh.ops.delete(edited, geom=edited.faces[:], context="FACES_ONLY")
        refuses("compute", "Suzanne: the mesh has no faces")


def test_a_bad_run_leaves_an_earlier_result_alone() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    refused("compute", holder, match="greater than zero", tolerance=0.0)
    assert holder.data.ccdepth.has_result


@each_operator
def test_meshes_without_extent_that_several_objects_use(operator: str) -> None:
    """With a relative tolerance theirs is none at all, and no warning of a division by it is printed."""
    mesh = scene.add_object(meshes.cube(), "Point").data
    mesh.vertices.foreach_set("co", np.ones(3 * len(mesh.vertices), dtype=np.float32))
    addon.select(scene.add_mesh(mesh), scene.add_mesh(mesh))
    refuses(operator, r"Point.*all its faces are at one point", tolerance=0.1, tolerance_mode="RELATIVE")


# Faces that have no surface are named, and found by Select Invalid Faces


def with_repeated_vertices(*faces: int) -> bpy.types.Object:
    """A landscape some of whose faces visit a vertex twice."""
    holder = scene.add_object(meshes.landscape(4, 3), "Scan")
    for face in faces:
        first = holder.data.polygons[face].loop_start
        holder.data.loops[first + 1].vertex_index = holder.data.loops[first].vertex_index
    return holder


def put_nowhere(holder: bpy.types.Object, vertex: int) -> None:
    positions = np.empty(3 * len(holder.data.vertices), dtype=np.float32)
    holder.data.attributes["position"].data.foreach_get("vector", positions)
    positions[3 * vertex] = np.nan
    holder.data.attributes["position"].data.foreach_set("vector", positions)


def selected(holder: bpy.types.Object) -> list[int]:
    return [face.index for face in holder.data.polygons if face.select]


def compute_refused(match: str, *objects: bpy.types.Object) -> None:
    addon.select(*objects)
    refuses("compute", match)


@pytest.mark.parametrize(("output", "reduce"), combinations(["NEW_OBJECT", "IN_PLACE"], [False, True]))
def test_faces_without_area_are_subdivided(output: str, reduce: bool) -> None:
    holder = scene.add_object(meshes.with_collapsed_faces(meshes.landscape(5, 4)))
    addon.compute(holder, tolerance=0.01)
    assert addon.bounds(holder).max() <= 0.01
    assert bpy.ops.ccdepth.subdivide(
        tolerance=0.01, tolerance_mode="ABSOLUTE", output=output, reduce=reduce, exact_normals=True
    ) == {"FINISHED"}
    result = bpy.context.active_object
    assert result.data.validate() is False
    assert np.isfinite(scene.mesh_data(result.data).positions).all()


@pytest.mark.parametrize("scale", [(1.0, 1.0, 0.0), (1.0, 0.0, 0.0)])
def test_flattened_objects(scale: tuple[float, float, float]) -> None:
    holder = scene.add_object(meshes.torus(8, 6), "Flat")
    holder.scale = scale
    addon.compute(holder, tolerance=0.1)
    addon.measure(holder, tolerance=0.1)
    assert bpy.ops.ccdepth.subdivide(tolerance=0.1, tolerance_mode="ABSOLUTE") == {"FINISHED"}
    result = bpy.context.active_object
    holder.hide_set(False)
    addon.measure(result, holder, tolerance=0.1)
    assert result.data.ccdepth.deviation_reached <= 0.1


def test_the_report_names_the_remedy_which_selects_what_was_refused() -> None:
    holder = with_repeated_vertices(2, 7)
    put_nowhere(holder, 19)
    compute_refused(
        r"(?s)Scan: 1 vertex at no finite position \(first: vertex 19\), 2 faces with a repeated vertex "
        r"\(first: face 2\).*Select Invalid Faces.*Repair Mesh",
        holder,
    )
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert selected(holder) == [2, 7, 11]
    assert tuple(bpy.context.scene.tool_settings.mesh_select_mode) == (False, False, True)


def test_selects_in_edit_mode_and_what_is_left_is_accepted() -> None:
    holder = scene.add_object(meshes.landscape(4, 3))
    put_nowhere(holder, 6)
    with addon.edit_mode(holder):
        refuses("compute", "1 vertex at no finite position")
        assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
        edited = bmesh.from_edit_mesh(holder.data)
        assert [face.index for face in edited.faces if face.select] == [0, 1, 4, 5]
        bpy.ops.mesh.delete(type="FACE")
        assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    assert holder.data.ccdepth.faces == 8


def test_selects_on_several_objects_and_leaves_the_others_alone() -> None:
    first, second = with_repeated_vertices(3), with_repeated_vertices(0, 5)
    good = scene.add_object(meshes.cube(), "Good")
    before = selected(good)
    # Another object that uses the mesh is no other mesh.
    compute_refused(r"(?s)Scan: 1 face.*Scan\.001: 2 faces", first, scene.add_mesh(first.data), second, good)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert (selected(first), selected(second), selected(good)) == ([3], [0, 5], before)


def test_faces_that_modifiers_repeat() -> None:
    holder = with_repeated_vertices(3)
    holder.modifiers.new("Array", "ARRAY").count = 3
    compute_refused("3 faces with a repeated vertex", holder)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert selected(holder) == [3]


def test_hidden_faces_stay_hidden() -> None:
    holder = with_repeated_vertices(2, 7)
    for face in holder.data.polygons:
        face.hide = face.index == 2
    addon.select(holder)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert selected(holder) == [7]
    holder.data.polygons[7].hide = True
    assert bpy.ops.ccdepth.select_invalid() == {"CANCELLED"}
    assert holder.data.polygons[2].hide


def test_nothing_is_invalid() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    before = selected(holder)
    for operator in (bpy.ops.ccdepth.select_invalid, bpy.ops.ccdepth.repair):
        assert operator() == {"CANCELLED"}
        assert selected(holder) == before


def test_meshes_without_faces_are_named() -> None:
    addon.select(scene.add_mesh(bpy.data.meshes.new("Empty")))
    refuses("select_invalid", "Empty: the mesh has no faces")


def test_the_panel_knows_until_a_run_goes_well() -> None:
    refusals = addon.module("state.refusals")
    holder = with_repeated_vertices(2, 7)
    compute_refused("Scan", holder)
    assert refusals.faces_at_fault(holder.data) == 2
    bpy.ops.ccdepth.select_invalid()
    addon.compute(scene.add_suzanne())
    assert refusals.faces_at_fault(holder.data) == 0


def test_repaired_meshes_are_accepted_and_keep_their_attributes() -> None:
    holder, good = with_repeated_vertices(2, 7), scene.add_object(meshes.pillow(4), "Good")
    put_nowhere(holder, 0)
    numbers = holder.data.attributes.new("number", "INT", "FACE").data
    numbers.foreach_set("value", range(12))
    compute_refused("Scan", holder, good)
    assert bpy.ops.ccdepth.repair() == {"FINISHED"}
    kept = [value.value for value in holder.data.attributes["number"].data]
    assert kept == [0, 1, 3, 4, 5, 6, 8, 9, 10, 11]
    # Blender takes one of two equal faces for a fault; meshes without one of ours stay as they are.
    assert len(good.data.polygons) == 2
    addon.compute(holder, good)


def test_repair_works_in_object_mode() -> None:
    with addon.edit_mode(with_repeated_vertices(2)), pytest.raises(RuntimeError, match="Object Mode"):
        bpy.ops.ccdepth.repair()


def test_an_object_that_could_not_be_edited_again_stays_in_edit_mode() -> None:
    hidden, other = scene.add_object(meshes.cube(), "Hidden"), scene.add_object(meshes.cube(), "Other")
    with addon.edit_mode(hidden, other):
        hidden.hide_viewport = True
        with pytest.raises(RuntimeError, match="Hidden: it is edited while it is hidden"):
            bpy.ops.ccdepth.count_faces()
        assert (hidden.mode, other.mode) == ("EDIT", "EDIT")
        hidden.hide_viewport = False
