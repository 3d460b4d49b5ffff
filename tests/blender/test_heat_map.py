# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours, and the viewports that are switched to show them and put back."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.thorough import combinations, each

pytestmark = pytest.mark.every_blender

# Viridis without its darkest quarter, evenly spaced: lighter and lighter in steps as they are seen, whatever is colour
# blind, and never nearly the background of the dark theme.
VIRIDIS = "3b528b 33638d 2c728e 26818e 21908c 1f9f88 28ae80 3ebc74 5dc963 82d34c abdc32 d5e21a fde725"


def views() -> list[bpy.types.SpaceView3D]:
    spaces = [space for screen in bpy.data.screens for area in screen.areas for space in area.spaces]
    return [space for space in spaces if space.type == "VIEW_3D"]


def shadings() -> list[bpy.types.View3DShading]:
    return [view.shading for view in views()]


def color_types() -> list[str]:
    return [shading.color_type for shading in shadings()]


def appearances() -> list[dict[str, object]]:
    """Of every 3D View, all settings of its shading and of its overlays."""
    return [
        {f"{part}.{name}": value for part in ("shading", "overlay") for name, value in settings(getattr(view, part))}
        for view in views()
    ]


def settings(holder: bpy.types.bpy_struct) -> Iterator[tuple[str, object]]:
    for item in holder.bl_rna.properties:
        if item.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"} and not item.is_readonly:
            value = getattr(holder, item.identifier)
            yield item.identifier, tuple(value) if getattr(item, "is_array", False) else value


def test_viewports_are_switched_once_and_restored() -> None:
    shadings()[0].color_type = "RANDOM"
    before, types = color_types(), [shading.type for shading in shadings()]
    first, second = scene.add_suzanne(), scene.add_object(meshes.cube())
    addon.compute(first, second)
    assert set(color_types()) == {"VERTEX"}
    addon.compute(first)
    addon.select(first)
    bpy.ops.ccdepth.clear()
    assert set(color_types()) == {"VERTEX"}
    # Hidden results do not keep the viewports.
    addon.compute(first)
    second.hide_set(True)
    bpy.ops.ccdepth.clear()
    assert color_types() == before
    second.hide_set(False)
    addon.compute(second)
    bpy.ops.ccdepth.clear()
    assert color_types() == before
    assert [shading.type for shading in shadings()] == types


def test_what_was_changed_since_is_left_alone() -> None:
    """And a viewport that shows colour attributes anyway goes on."""
    views()[0].shading.color_type = "VERTEX"
    opacity = views()[2].overlay.wireframe_opacity
    addon.compute(scene.add_suzanne())
    assert views()[2].overlay.wireframe_opacity != opacity
    views()[1].shading.color_type, views()[2].shading.light = "OBJECT", "MATCAP"
    bpy.context.scene.ccdepth.show_legend = False
    for again in (bpy.ops.ccdepth.compute, bpy.ops.ccdepth.clear):
        again()
        assert color_types()[:2] == ["VERTEX", "OBJECT"]
        assert views()[2].shading.light == "MATCAP"
    overlay = views()[2].overlay
    assert (overlay.show_wireframes, overlay.wireframe_opacity) == (False, opacity)


def test_removed_results_do_not_keep_the_viewports() -> None:
    """A timer puts them back, which Blender does not call in the background."""
    before, synchronise = appearances(), addon.module("ui.heat_map")._synchronise
    first, second = scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(first, second)
    for gone in (first, second):
        assert set(color_types()) == {"VERTEX"}
        bpy.data.batch_remove([gone, gone.data])
        bpy.context.view_layer.update()
        assert bpy.app.timers.is_registered(synchronise)
        synchronise()
    assert appearances() == before


def test_the_heat_map_can_be_switched_off_and_on() -> None:
    before = color_types()
    holder = scene.add_suzanne()
    holder.data.attributes.new("Paint", "BYTE_COLOR", "CORNER")
    addon.compute(holder)
    bpy.context.scene.ccdepth.show_heat_map = False
    assert color_types() == before
    assert holder.data.attributes.active_color_name == "Paint"
    addon.compute(holder)
    assert color_types() == before
    bpy.context.scene.ccdepth.show_heat_map = True
    assert set(color_types()) == {"VERTEX"}
    assert holder.data.attributes.active_color_name == "ccdepth_color"


def test_one_colour_for_each_depth_and_for_all_corners_of_a_face() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.cube())
    addon.compute(first)
    addon.compute(second, tolerance=1e-4)
    assert addon.depths(first).max() < addon.depths(second).min(), "the meshes have ranges of their own"
    for holder in (first, second):
        assert_colored(holder, 0, 8)


def test_corners_that_are_not_as_many_as_when_they_were_read() -> None:
    """Somebody may edit a mesh while its depths are being computed."""
    written = np.random.default_rng(7).random((6, 4)).astype(np.float32)
    attributes = addon.module("exchange.result_attributes")
    for starts in (None, 4 * np.arange(7), 3 * np.arange(7)):
        mesh = scene.add_object(meshes.cube()).data
        attributes.write_face_values(mesh, {attributes.COLOR_KIND: written}, face_starts=starts)
        found = [item.color[:] for item in mesh.attributes["ccdepth_color"].data]
        np.testing.assert_array_equal(found, np.repeat(written, 4, axis=0))


def test_the_colours_are_those_of_viridis() -> None:
    expected = np.array([[*bytes.fromhex(color)] for color in VIRIDIS.split()]) / 255
    found = addon.module("state.colors").depth_colors(range(-1, 14), 0, 12)
    np.testing.assert_allclose(found, [expected[0], *expected, expected[-1]], atol=1e-12)


def assert_colored(holder: bpy.types.Object, first: int, last: int) -> None:
    """The faces have the colours of their depths between these two."""
    sizes, colors = [polygon.loop_total for polygon in holder.data.polygons], addon.colors(holder)
    srgb = np.where(colors <= 0.0031308, 12.92 * colors, 1.055 * np.abs(colors) ** (1 / 2.4) - 0.055)[:, :3]
    expected = addon.module("state.colors").depth_colors(addon.depths(holder), first, last)
    # Colours are in single precision.
    np.testing.assert_allclose(srgb, np.repeat(expected, sizes, axis=0), atol=1e-5)
    np.testing.assert_array_equal(colors[:, 3], 1.0)


def test_the_range_of_colours_is_the_scene_s_and_remembered(tmp_path: Path) -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    addon.compute(holder, tolerance=0.001)
    before = addon.colors(holder)
    settings.first_color_depth, settings.last_color_depth = 1, 4
    assert_colored(holder, 1, 4)
    addon.compute(holder, tolerance=0.001)
    assert_colored(holder, 1, 4)
    # Colours of a heat map that is off change when it is on again.
    settings.show_heat_map = False
    settings.last_color_depth = 5
    settings.show_heat_map = True
    assert_colored(holder, 1, 5)
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    settings, holder = bpy.context.scene.ccdepth, bpy.data.objects["Suzanne"]
    assert (settings.first_color_depth, settings.last_color_depth) == (1, 5)
    settings.first_color_depth, settings.last_color_depth = 0, 8
    np.testing.assert_array_equal(addon.colors(holder), before)
    # It is never empty.
    settings.first_color_depth = 12
    assert (settings.first_color_depth, settings.last_color_depth) == (12, 13)
    settings.last_color_depth = 3
    assert (settings.first_color_depth, settings.last_color_depth) == (2, 3)


def test_colours_the_user_took_away_stay_away() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    holder.data.attributes.remove(holder.data.attributes["ccdepth_color"])
    addon.compute(scene.add_object(meshes.cube()))
    assert "ccdepth_color" not in holder.data.attributes
    addon.compute(holder)
    assert "ccdepth_color" in holder.data.attributes


def test_an_adaptive_mesh_shows_its_distances_while_the_heat_map_is_on() -> None:
    bpy.context.scene.ccdepth.show_heat_map = False
    [holder] = subdivide(scene.add_suzanne(), tolerance=0.03)
    assert "ccdepth_color" not in holder.data.attributes
    assert "VERTEX" not in color_types()
    bpy.context.scene.ccdepth.show_heat_map = True
    assert set(color_types()) == {"VERTEX"}
    assert holder.data.attributes.active_color_name == "ccdepth_color"
    module, bounds = addon.module("state.colors"), addon.bounds(holder).astype(np.float64)
    sizes = [polygon.loop_total for polygon in holder.data.polygons]
    record = holder.data.ccdepth
    for color_range, top in (("TOLERANCE", record.world_tolerance), ("LARGEST", bounds.max())):
        bpy.context.scene.ccdepth.distance_range = color_range
        expected = np.repeat(module.to_linear(module.scale_colors(bounds / top)), sizes, axis=0)
        # Colours are in single precision.
        np.testing.assert_allclose(addon.colors(holder)[:, :3], expected, atol=1e-6)
    addon.select(holder)
    bpy.ops.ccdepth.clear()
    assert addon.is_untouched([holder])


USERS = (
    {},
    {"shading.light": "MATCAP", "shading.show_cavity": True, "overlay.show_wireframes": True},
    {"shading.light": "FLAT", "shading.show_shadows": True, "overlay.wireframe_opacity": 0.8},
    {"shading.light": "STUDIO", "shading.color_type": "RANDOM", "overlay.wireframe_threshold": 0.3},
)


def give_users_settings() -> None:
    """Every 3D View has others of these."""
    for index, view in enumerate(views()):
        view.shading.type = "SOLID"
        for path, value in USERS[index % len(USERS)].items():
            part, name = path.split(".")
            setattr(getattr(view, part), name, value)


def assert_colors_are_true() -> None:
    for appearance in appearances():
        assert (appearance["shading.light"], appearance["shading.color_type"]) == ("FLAT", "VERTEX")
        assert (appearance["shading.show_shadows"], appearance["shading.show_cavity"]) == (False, False)
    solid = [each for each in appearances() if each["shading.type"] == "SOLID"]
    assert solid
    assert all(each["overlay.show_wireframes"] for each in solid)


@pytest.mark.parametrize("way", ["CLEAR", "SWITCH", "SAVE", "UNREGISTER", "PAINT"])
def test_every_setting_of_every_viewport_is_restored(tmp_path: Path, way: str) -> None:
    give_users_settings()
    before, module = appearances(), addon.module("state.viewports")
    assert len(before) > 4
    addon.compute(scene.add_suzanne())
    assert_colors_are_true()
    if way == "SAVE":
        path = str(tmp_path / "saved.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
        assert_colors_are_true()
    if way in {"CLEAR", "SAVE"}:
        bpy.ops.ccdepth.clear()
    elif way == "SWITCH":
        bpy.context.scene.ccdepth.show_heat_map = False
    elif way == "PAINT":
        bpy.ops.object.mode_set(mode="SCULPT")
    else:
        module.unregister()
    try:
        assert appearances() == before
    finally:
        if way == "UNREGISTER":
            module.register()


def test_edges_are_drawn_in_solid_shading_and_of_few_faces_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    viewports, heat_map = addon.module("state.viewports"), addon.module("ui.heat_map")
    space = next(space for space in viewports.spaces() if space.shading.type == "SOLID")
    assert not viewports.is_amiss(space)
    for shading_type, has_edges in (("MATERIAL", False), ("SOLID", True)):
        space.shading.type = shading_type
        assert viewports.is_amiss(space)
        # As the viewport's drawing asks for.
        heat_map.synchronise(bpy.context)
        assert not viewports.is_amiss(space)
        assert space.overlay.show_wireframes == has_edges
    # Nor when the user has chosen other colours.
    space.shading.color_type = "OBJECT"
    heat_map.synchronise(bpy.context)
    assert (space.shading.color_type, space.shading.light) == ("OBJECT", "STUDIO")
    assert not space.overlay.show_wireframes
    # Nor when there are very many faces on all meshes together.
    monkeypatch.setattr(heat_map, "LARGEST_FACE_COUNT_WITH_EDGES", 505)
    addon.compute(holder)
    assert any(each["overlay.show_wireframes"] for each in appearances())
    addon.compute(scene.add_object(meshes.cube()))
    assert not any(each["overlay.show_wireframes"] for each in appearances())
    assert color_types().count("VERTEX") == len(color_types()) - 1


# Modes in which the active colours are painted on, where the user's own are active again


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
