# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map is shown by making its colours the mesh's active ones, which is what Sculpt Mode, Vertex Paint and
Texture Paint paint on. There the user's own colours have to be the active ones again."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.blender.test_heat_map import color_types, shadings
from tests.thorough import combinations, each

pytestmark = pytest.mark.every_blender

COLOR = "ccdepth_color"
MODES = ["SCULPT", "VERTEX_PAINT", "TEXTURE_PAINT"]


def computed(*colors: str) -> bpy.types.Object:
    """A cube with these colour attributes, the last of them active, and with a heat map that is shown."""
    holder = scene.add_object(meshes.cube(), "Cube")
    for name in colors:
        holder.data.attributes.new(name, "BYTE_COLOR", "CORNER")
    holder.data.attributes.active_color_name = colors[-1] if colors else ""
    holder.data.attributes.default_color_name = colors[0] if colors else ""
    addon.compute(holder)
    assert active(holder) == COLOR
    return holder


def active(holder: bpy.types.Object) -> str:
    return holder.data.attributes.active_color_name


def rendered(holder: bpy.types.Object) -> str:
    return holder.data.attributes.default_color_name


def enter(mode: str) -> None:
    assert bpy.ops.object.mode_set(mode=mode) == {"FINISHED"}


@pytest.mark.parametrize(("mode", "colors"), combinations(MODES, [(), ("Paint",), ("First", "Second")]))
def test_colours_are_put_back_for_painting_and_shown_again_afterwards(mode: str, colors: tuple[str, ...]) -> None:
    holder = computed(*colors)
    enter(mode)
    assert active(holder) == (colors[-1] if colors else "")
    results = addon.module("state.results")
    assert results.has_heat_map(holder.data)
    assert not results.shows_heat_map(holder.data)
    assert {*addon.ATTRIBUTES} <= {*holder.data.attributes.keys()}
    enter("OBJECT")
    assert active(holder) == COLOR
    assert results.shows_heat_map(holder.data)
    assert rendered(holder) == (colors[0] if colors else "")
    if colors == ("Paint",):
        # They are put back under a new name.
        colors = ("Painted",)
        holder.data.attributes["Paint"].name = "Painted"
    bpy.ops.ccdepth.clear()
    assert active(holder) == (colors[-1] if colors else "")
    assert rendered(holder) == (colors[0] if colors else "")


@pytest.mark.skipif(bpy.app.version < (4, 5), reason="Blender 4.2 and 4.3 crash when they paint without a brush")
@pytest.mark.parametrize("colors", [(), ("Paint",)])
def test_what_is_painted_is_not_the_heat_map(colors: tuple[str, ...]) -> None:
    holder = computed(*colors)
    before = addon.colors(holder)
    enter("VERTEX_PAINT")
    if not active(holder):
        # As the first stroke does.
        bpy.ops.geometry.color_attribute_add(name="Paint", domain="CORNER", data_type="BYTE_COLOR")
    bpy.ops.paint.vertex_color_set()
    enter("OBJECT")
    np.testing.assert_array_equal(addon.colors(holder), before)
    bpy.ops.ccdepth.clear()
    assert active(holder) == "Paint"
    assert [attribute.name for attribute in holder.data.color_attributes] == ["Paint"]


@pytest.mark.parametrize("mode", MODES)
def test_whatever_happens_while_painting_the_user_s_colours_stay(tmp_path: Path, mode: str) -> None:
    """Other modes, the switch of the heat map, a choice of its colours, and other users of the mesh."""
    holder, settings = computed("Paint"), bpy.context.scene.ccdepth
    other = scene.add_mesh(holder.data)
    for painting in (mode, *MODES, mode):
        enter(painting)
        assert active(holder) == "Paint"
    enter("EDIT")
    assert active(holder) == COLOR
    enter(mode)
    for shown in (False, True):
        settings.show_heat_map = shown
        assert active(holder) == "Paint"
    holder.data.attributes.active_color_name = COLOR
    holder.data.update_tag()
    bpy.context.view_layer.update()
    assert active(holder) == "Paint"
    other.location.x = 3.0
    bpy.context.view_layer.update()
    assert active(holder) == "Paint"
    enter("OBJECT")
    assert active(holder) == COLOR
    enter(mode)
    settings.show_heat_map = False
    enter("OBJECT")
    assert active(holder) == "Paint"
    # A file that was saved while painting shows the heat map afterwards.
    settings.show_heat_map = True
    enter(mode)
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    holder = bpy.data.objects["Cube"]
    assert active(holder) == ("Paint" if holder.mode == mode else COLOR)
    enter("OBJECT")
    bpy.context.view_layer.update()
    assert active(holder) == COLOR


@pytest.mark.parametrize("mode", MODES)
def test_colours_that_go_while_painting_do_not_make_way_for_the_heat_map(mode: str) -> None:
    """Before Blender 5.2, another one becomes active when the active one is removed."""
    holder = computed("First", "Second")
    enter(mode)
    for name in ("Second", "First"):
        holder.data.attributes.remove(holder.data.attributes[name])
        bpy.context.view_layer.update()
        assert active(holder) != COLOR
    enter("OBJECT")
    assert active(holder) == COLOR


@pytest.mark.parametrize("mode", each(MODES, MODES[:1]))
def test_viewports_are_put_back_meanwhile_unless_they_show_other_heat_maps(mode: str) -> None:
    before = color_types()
    holder = computed("Paint")
    enter(mode)
    assert color_types() == before
    enter("OBJECT")
    assert set(color_types()) == {"VERTEX"}
    second = scene.add_suzanne()
    addon.compute(second)
    addon.select(holder)
    enter(mode)
    assert (active(holder), active(second)) == ("Paint", COLOR)
    assert set(color_types()) == {"VERTEX"}
    enter("OBJECT")
    bpy.data.objects.remove(second)
    shadings()[0].color_type = "OBJECT"
    enter(mode)
    enter("OBJECT")
    assert color_types()[0] == "OBJECT"
    bpy.ops.ccdepth.clear()
    assert color_types()[0] == "OBJECT"


@pytest.mark.parametrize("mode", MODES)
def test_undo_and_redo_leave_the_user_s_colours_for_painting(mode: str) -> None:
    holder = scene.add_object(meshes.cube(), "Cube")
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    holder.data.attributes.active_color_name = "Paint"
    addon.select(holder)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.ccdepth.compute()
    bpy.ops.ed.undo_push(message="Compute Depth")
    enter(mode)
    bpy.ops.ed.undo_push(message="mode")
    for _ in range(2):
        bpy.ops.ed.undo()
        shown = bpy.context.object
        assert (active(shown), shown.mode) in ((COLOR, "OBJECT"), ("Paint", mode), ("Paint", "OBJECT"))
    for _ in range(2):
        bpy.ops.ed.redo()
        shown = bpy.context.object
        assert active(shown) == (COLOR if shown.mode == "OBJECT" else "Paint")


# Results.


# Each two of these, in the short suite.
HALF = [(False, False, "NEW_OBJECT"), (False, True, "IN_PLACE"), (True, False, "IN_PLACE"), (True, True, "NEW_OBJECT")]


@pytest.mark.parametrize("names", each([(), ("Paint",), ("First", "Second")], [(), ("First", "Second")]))
@pytest.mark.parametrize("way", each(product([False, True], [False, True], ["NEW_OBJECT", "IN_PLACE"]), HALF))
def test_a_result_names_no_colours_it_does_not_have(names: tuple[str, ...], way: tuple[bool, bool, str]) -> None:
    """Whether the heat map is displayed by its switch, or because the user chose it."""
    holder, (switched, modifier, output) = computed(*names), way
    if modifier:
        holder.modifiers.new("Bevel", "BEVEL")
    if not switched:
        bpy.context.scene.ccdepth.show_heat_map = False
        holder.data.attributes.active_color_name = COLOR
    holder.data.attributes.default_color_name = COLOR
    [result] = subdivide(holder, output=output)
    if switched:
        assert active(result) == COLOR
        assert rendered(result) != COLOR
        addon.select(result)
        bpy.ops.ccdepth.clear()
    assert [attribute.name for attribute in result.data.color_attributes] == list(names)
    assert active(result) in names or (not names and active(result) == "")
    assert rendered(result) in names or (not names and rendered(result) == "")
    if switched and names:
        assert active(result) == names[-1]


def test_a_result_of_a_mesh_without_active_colours_has_none() -> None:
    holder = scene.add_object(meshes.cube(), "Cube")
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    holder.data.attributes.active_color_name = holder.data.attributes.default_color_name = ""
    [result] = subdivide(holder)
    assert (active(result), rendered(result)) == (COLOR, "")
    addon.select(result)
    bpy.ops.ccdepth.clear()
    assert (active(result), rendered(result)) == ("", "")
