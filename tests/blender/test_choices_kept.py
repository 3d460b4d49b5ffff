# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user has chosen stays: the active attribute and colours, whatever CC Depth puts on the mesh or takes off it;
and the objects in Edit Mode, which operators leave for their work, whatever else is selected."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

pytestmark = pytest.mark.every_blender

# In the order in which Blender lists attributes some come before ours and some after.
NAMES = (None, "point", "face", "corner", "UVMap")


def holder_with_attributes() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube())
    for name, domain in (("point", "POINT"), ("face", "FACE"), ("corner", "CORNER")):
        holder.data.attributes.new(name, "FLOAT", domain)
    holder.data.uv_layers.new(name="UVMap")
    addon.select(holder)
    return holder


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_active_attribute_and_rendered_colour(mode: str) -> None:
    attributes = holder_with_attributes().data.attributes
    bpy.ops.object.mode_set(mode=mode)
    for name in NAMES:
        attributes.active = None if name is None else attributes[name]
        for operator in (bpy.ops.ccdepth.compute, bpy.ops.ccdepth.compute, bpy.ops.ccdepth.clear):
            assert operator() == {"FINISHED"}
            assert (attributes.active and attributes.active.name) == name
    # Colours that are chosen since are not left without an attribute.
    assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    attributes.default_color_name = "ccdepth_color"
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert attributes.default_color_name == ""
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("domain", ["POINT", "EDGE", "FACE", "CORNER"])
def test_displayed_colours_of_any_domain(domain: str) -> None:
    """Blender displays the first colours that are made, also where it does not list them among the colours."""
    holder = scene.add_object(meshes.cube())
    attributes = holder.data.attributes
    attributes.new("Paint", "FLOAT_COLOR", domain)
    attributes.active_color_name = attributes.default_color_name = "Paint"
    addon.compute(holder)
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert (attributes.active_color_name, attributes.default_color_name) == ("Paint", "Paint")


# Edit Mode.


def edit_others_than_selected() -> tuple[bpy.types.Object, bpy.types.Object, bpy.types.Object]:
    """Two objects in Edit Mode, only the second of them selected, and another one, which is selected as well.

    Objects are chosen when Edit Mode begins; in it the Outliner and scripts may select others.
    """
    first, second, other = (scene.add_object(meshes.cube(), text) for text in ("First", "Second", "Other"))
    addon.select(first, second)
    bpy.ops.object.mode_set(mode="EDIT")
    first.select_set(False)
    other.select_set(True)
    return first, second, other


@pytest.mark.parametrize("refused", [False, True])
def test_objects_that_are_edited_without_being_selected(refused: bool) -> None:
    _, second, _ = edit_others_than_selected()
    if refused:
        with pytest.raises(RuntimeError, match="would have about"):
            bpy.ops.ccdepth.subdivide(tolerance=0.001, max_faces=1)
    else:
        assert bpy.ops.ccdepth.count_faces(tolerance=0.1) == {"FINISHED"}
    assert {each.name for each in bpy.context.objects_in_mode} == {"First", "Second"}
    assert {each.name for each in bpy.context.selected_objects} == {"Second", "Other"}
    assert bpy.context.view_layer.objects.active == second
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(("output", "suffix"), [("NEW_OBJECT", " Adaptive"), ("IN_PLACE", "")])
def test_results_are_edited_in_their_stead(output: str, suffix: str) -> None:
    _, _, other = edit_others_than_selected()
    assert bpy.ops.ccdepth.subdivide(tolerance=0.5, tolerance_mode="ABSOLUTE", output=output) == {"FINISHED"}
    assert {each.name for each in bpy.context.objects_in_mode} == {f"First{suffix}", f"Second{suffix}"}
    assert other.mode == "OBJECT"
    bpy.ops.object.mode_set(mode="OBJECT")


def test_objects_that_are_hidden_while_they_are_edited() -> None:
    """Another object that uses the mesh can be seen, so there is something to work on."""
    hidden = scene.add_object(meshes.cube(), "Hidden")
    user = scene.add_mesh(hidden.data)
    addon.select(hidden)
    bpy.ops.object.mode_set(mode="EDIT")
    user.select_set(True)
    hidden.hide_set(True)
    assert bpy.ops.ccdepth.count_faces(tolerance=0.1) == {"FINISHED"}
    assert (hidden.mode, user.mode) == ("EDIT", "OBJECT")
    assert hidden.hide_get()
    assert user.select_get()
    hidden.hide_set(False)
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("output", ["NEW_OBJECT", "IN_PLACE"])
@pytest.mark.parametrize("hidden", [False, True])
def test_an_object_that_is_edited_while_another_is_active(output: str, hidden: bool) -> None:
    """With Lock Object Modes off, another object may become the active one while one is edited."""
    edited, active = (scene.add_object(meshes.cube(), text) for text in ("Edited", "Active"))
    other_user = scene.add_mesh(edited.data)
    edited.data.attributes.new("Paint", "FLOAT_COLOR", "POINT")
    edited.data.attributes.active_color_name = "Paint"
    addon.select(edited)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.context.view_layer.objects.active = active
    active.select_set(True)
    if hidden:
        other_user.select_set(True)
        edited.hide_set(True)
    assert bpy.ops.ccdepth.subdivide(tolerance=0.5, tolerance_mode="ABSOLUTE", output=output) == {"FINISHED"}
    user = other_user if hidden else edited
    result = user if output == "IN_PLACE" else bpy.data.objects[f"{user.name} Adaptive"]
    assert "Paint" in result.data.attributes
    bpy.context.scene.ccdepth.show_heat_map = False
    assert result.data.attributes.active_color_name == "Paint"
    assert [each.name for each in bpy.data.objects if each.mode == "EDIT"] == ["Edited"]
    edited.hide_set(False)
    bpy.context.view_layer.objects.active = edited
    bpy.ops.object.mode_set(mode="OBJECT")
