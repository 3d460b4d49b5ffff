# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces that have no surface are named, found by Select Invalid Faces and taken away by Repair Mesh; faces without area
are faces like others."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.updating import refuses
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender


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
    assert bpy.ops.ccdepth.edit_faces() == {"FINISHED"}
    assert tuple(bpy.context.scene.tool_settings.mesh_select_mode) == (False, False, True)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert selected(holder) == [2, 7, 11]


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


def mask_all_but(holder: bpy.types.Object, face: int) -> None:
    holder.vertex_groups.new(name=f"Face {face}").add([*holder.data.polygons[face].vertices], 1.0, "REPLACE")
    holder.modifiers.new("Mask", "MASK").vertex_group = f"Face {face}"


def test_faces_that_lose_an_edge_to_a_modifier_are_named() -> None:
    """Blender takes away the edge that the repeated vertex had."""
    holder = with_repeated_vertices(0)
    mask_all_but(holder, 0)
    compute_refused("1 face with a repeated vertex", holder)


def test_selects_what_is_invalid_in_any_object_of_a_mesh() -> None:
    """Of each all faces but one are masked."""
    first = scene.add_object(meshes.landscape(4, 3))
    holders = [first, scene.add_mesh(first.data)]
    for holder, face, vertex in zip(holders, (0, 11), (0, 19), strict=True):
        mask_all_but(holder, face)
        put_nowhere(first, vertex)
    compute_refused("1 vertex at no finite position", *holders)
    assert bpy.ops.ccdepth.select_invalid() == {"FINISHED"}
    assert selected(first) == [0, 11]


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


def test_corners_at_no_vertex_are_refused() -> None:
    """As files have them that were written wrongly."""
    holder = scene.add_object(meshes.landscape(4, 3))
    for loop in holder.data.loops[:2]:
        loop.vertex_index = 1000
    compute_refused("2 corners of faces at vertices that the mesh does not have", holder)


def test_the_panel_knows_until_a_run_goes_well() -> None:
    known = addon.module("state.known")
    holder = with_repeated_vertices(2, 7)
    compute_refused("Scan", holder)
    assert known.faces_at_fault(holder.data) == 2
    bpy.ops.ccdepth.select_invalid()
    addon.compute(scene.add_suzanne())
    assert known.faces_at_fault(holder.data) == 0


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
