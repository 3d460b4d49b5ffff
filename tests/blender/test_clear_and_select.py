# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear leaves a mesh as it was, and Select by Depth finds the faces of a depth, in both modes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene

pytestmark = pytest.mark.every_blender


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


def test_colours_chosen_or_removed_since_are_left_alone() -> None:
    for displayed in ("Other", ""):
        holder = scene.add_object(meshes.cube())
        attributes = holder.data.attributes
        for name in ("Paint", "Other"):
            attributes.new(name, "BYTE_COLOR", "CORNER")
        attributes.active_color_name = "Paint"
        addon.compute(holder)
        if displayed:
            attributes.active_color_name = displayed
        else:
            attributes.remove(attributes["Other"])
            attributes.remove(attributes["Paint"])
        bpy.ops.ccdepth.clear()
        assert attributes.active_color_name == displayed


def test_clear_works_on_all_selected() -> None:
    first, second, other = scene.add_suzanne(), scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(first, second, other)
    # Attributes without a record are cleared as well.
    second.data.property_unset("ccdepth")
    addon.select(first, second)
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert addon.is_untouched([first, second])
    assert other.data.ccdepth.has_result
    assert bpy.ops.ccdepth.clear() == {"CANCELLED"}


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


@pytest.mark.parametrize("editing", [False, True])
def test_select(editing: bool) -> None:
    """Each time what was selected before is no longer, unless it is extended."""
    holder = scene.add_suzanne()
    addon.compute(holder)
    depths = addon.depths(holder)
    least, middle, deepest = int(depths.min()), int(np.median(depths)), int(depths.max())
    assert least < middle < deepest

    def faces() -> np.ndarray:
        found = np.empty(len(holder.data.polygons), dtype=bool)
        holder.data.polygons.foreach_get("select", found)
        return found

    def selected(*calls: dict[str, object]) -> np.ndarray:
        if editing:
            bpy.ops.object.mode_set(mode="EDIT")
        for call in calls:
            assert bpy.ops.ccdepth.select(**call) == {"FINISHED"}
        bpy.ops.object.mode_set(mode="OBJECT")
        at_once = faces()
        # Whatever mode it ran in, Edit Mode must show this selection and no more.
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.object.mode_set(mode="OBJECT")
        assert_equal(faces(), at_once)
        return at_once

    assert_equal, visible = np.testing.assert_array_equal, np.arange(len(depths)) % 2 == 1
    for comparison, compare in (("EQUAL", np.equal), ("AT_LEAST", np.greater_equal), ("AT_MOST", np.less_equal)):
        assert_equal(selected({"depth": middle, "comparison": comparison}), compare(depths, middle))
    # It starts from the deepest.
    assert_equal(selected({}), depths == deepest)
    extended = selected({"depth": least}, {"depth": deepest, "extend": True})
    assert_equal(extended, (depths == least) | (depths == deepest))
    holder.data.polygons.foreach_set("hide", ~visible)
    assert_equal(selected({"depth": 0, "comparison": "AT_LEAST"}), visible)


def test_select_needs_a_result() -> None:
    addon.select(scene.add_suzanne())
    with pytest.raises(RuntimeError, match="Compute Depth first"):
        bpy.ops.ccdepth.select(depth=1)


@pytest.mark.parametrize("name", [".select_vert", ".select_edge", ".select_poly"])
def test_attribute_where_blender_keeps_the_selection(name: str) -> None:
    """It is named and kept: Blender itself crashes when a selection is written over it."""
    for data_type, domain in (("BOOLEAN", "CORNER"), ("FLOAT", "FACE")):
        holder = scene.add_object(meshes.cube(), "Cube")
        addon.compute(holder)
        if name in holder.data.attributes:
            holder.data.attributes.remove(holder.data.attributes[name])
        holder.data.attributes.new(name, data_type, domain)
        with pytest.raises(RuntimeError, match=f"Cube.*: .* “{name}” that is not a selection"):
            bpy.ops.ccdepth.select(depth=0)
        assert holder.data.attributes[name].data_type == data_type
