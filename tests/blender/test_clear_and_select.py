# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear leaves a mesh as it was, and Select by Depth finds the faces of a depth, in both modes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene


def attributes_of(mesh: bpy.types.Mesh) -> list[tuple[str, str, str]]:
    return sorted((attribute.name, attribute.data_type, attribute.domain) for attribute in mesh.attributes)


def displayed_and_rendered(mesh: bpy.types.Mesh) -> tuple[str, str]:
    return mesh.attributes.active_color_name, mesh.attributes.default_color_name


@pytest.mark.parametrize("colors", [(), ("Paint",), ("Base", "Paint")])
@pytest.mark.parametrize("editing", [False, True])
def test_clear_leaves_the_mesh_as_it_was(colors: tuple[str, ...], editing: bool) -> None:
    holder = scene.add_object(meshes.creased_cube())
    mesh = holder.data
    for name in colors:
        mesh.attributes.new(name, "BYTE_COLOR", "CORNER")
    if colors:
        mesh.attributes.active_color_name, mesh.attributes.default_color_name = colors[-1], colors[0]
    before = attributes_of(mesh), displayed_and_rendered(mesh)
    addon.select(holder)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.compute()
    assert displayed_and_rendered(mesh) == ("ccdepth_color", before[1][1])
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    if editing:
        bpy.ops.object.mode_set(mode="OBJECT")
    assert (attributes_of(mesh), displayed_and_rendered(mesh)) == before
    record = mesh.ccdepth
    assert not record.has_result
    assert not record.rows
    assert not record.contributors
    assert record.uniform_faces == ""


def test_colours_chosen_since_are_left_alone() -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    holder.data.attributes.new("Other", "BYTE_COLOR", "CORNER")
    addon.compute(holder)
    holder.data.attributes.active_color_name = "Other"
    bpy.ops.ccdepth.clear()
    assert holder.data.attributes.active_color_name == "Other"


def test_colours_removed_since_do_not_come_back() -> None:
    holder = scene.add_suzanne()
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    addon.compute(holder)
    holder.data.attributes.remove(holder.data.attributes["Paint"])
    bpy.ops.ccdepth.clear()
    assert holder.data.attributes.active_color_name == ""


def test_clear_works_on_all_selected() -> None:
    first, second, other = scene.add_suzanne(), scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(first, second, other)
    addon.select(first, second)
    bpy.ops.ccdepth.clear()
    assert addon.is_untouched([first, second])
    assert other.data.ccdepth.has_result


def test_clear_with_nothing_to_clear() -> None:
    addon.select(scene.add_suzanne())
    assert bpy.ops.ccdepth.clear() == {"CANCELLED"}


def test_clear_removes_attributes_without_a_record() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    holder.data.property_unset("ccdepth")
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert addon.is_untouched([holder])


def test_undo_brings_a_cleared_result_back() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    name, rows = holder.name, addon.histogram(holder)
    bpy.ops.ed.undo_push(message="Compute Depth")
    bpy.ops.ccdepth.clear()
    bpy.ops.ed.undo_push(message="Clear")
    bpy.ops.ed.undo()
    holder = bpy.data.objects[name]
    assert holder.data.ccdepth.has_result
    assert addon.histogram(holder) == rows
    assert "ccdepth" in holder.data.attributes


def selected(mesh: bpy.types.Mesh) -> np.ndarray:
    faces = np.empty(len(mesh.polygons), dtype=bool)
    mesh.polygons.foreach_get("select", faces)
    return faces


@pytest.mark.parametrize(
    ("comparison", "compare"), [("EQUAL", np.equal), ("AT_LEAST", np.greater_equal), ("AT_MOST", np.less_equal)]
)
@pytest.mark.parametrize("editing", [False, True])
def test_select(comparison: str, compare: np.ufunc, editing: bool) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    depths = addon.depths(holder)
    depth = int(np.median(depths))
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.select(depth=depth, comparison=comparison)
    # Whatever mode it ran in, Edit Mode must show this selection and no more.
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(selected(holder.data), compare(depths, depth))


@pytest.mark.parametrize("editing", [False, True])
def test_select_can_extend(editing: bool) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    depths = addon.depths(holder)
    least, deepest = int(depths.min()), int(depths.max())
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.select(depth=least)
    bpy.ops.ccdepth.select(depth=deepest, extend=True)
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(selected(holder.data), (depths == least) | (depths == deepest))


def test_select_starts_from_the_deepest() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    bpy.ops.ccdepth.select()
    np.testing.assert_array_equal(selected(holder.data), addon.depths(holder) == addon.depths(holder).max())


@pytest.mark.parametrize("editing", [False, True])
def test_hidden_faces_are_not_selected(editing: bool) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    hidden = np.zeros(len(holder.data.polygons), dtype=bool)
    hidden[::2] = True
    holder.data.polygons.foreach_set("hide", hidden)
    if editing:
        bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.ccdepth.select(depth=0, comparison="AT_LEAST")
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(selected(holder.data), ~hidden)


def test_select_needs_a_result() -> None:
    addon.select(scene.add_suzanne())
    with pytest.raises(RuntimeError, match="Compute Depth first"):
        bpy.ops.ccdepth.select(depth=1)
