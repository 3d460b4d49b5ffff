# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours, and the viewports that are switched to show them and put back."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene

# Machado, Oliveira and Fernandes 2009, severity 1, for linear RGB: red- and green-blindness.
PROTANOPIA = [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
DEUTERANOPIA = [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]


def shadings() -> list[bpy.types.View3DShading]:
    spaces = [space for screen in bpy.data.screens for area in screen.areas for space in area.spaces]
    return [space.shading for space in spaces if space.type == "VIEW_3D"]


def color_types() -> list[str]:
    return [shading.color_type for shading in shadings()]


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
    addon.select(second)
    bpy.ops.ccdepth.clear()
    assert color_types() == before
    assert [shading.type for shading in shadings()] == types


def test_a_viewport_changed_since_is_left_alone() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    shadings()[0].color_type = "OBJECT"
    addon.compute(holder)
    assert color_types()[0] == "OBJECT"
    bpy.ops.ccdepth.clear()
    assert color_types()[0] == "OBJECT"


def test_a_viewport_that_shows_attributes_anyway_goes_on() -> None:
    shadings()[0].color_type = "VERTEX"
    addon.compute(scene.add_suzanne())
    bpy.ops.ccdepth.clear()
    assert color_types()[0] == "VERTEX"


def test_hidden_results_do_not_keep_the_viewports() -> None:
    before = color_types()
    first, second = scene.add_suzanne(), scene.add_object(meshes.cube())
    addon.compute(first, second)
    second.hide_set(True)
    addon.select(first)
    bpy.ops.ccdepth.clear()
    assert color_types() == before


def test_viewports_are_restored_when_the_addon_goes() -> None:
    before = color_types()
    addon.compute(scene.add_suzanne())
    module = addon.module("state.viewports")
    module.unregister()
    try:
        assert color_types() == before
    finally:
        module.register()


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


def test_undo_and_redo_take_the_viewports_along() -> None:
    before = color_types()
    addon.select(scene.add_suzanne())
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.ccdepth.compute()
    bpy.ops.ed.undo_push(message="Compute Depth")
    bpy.ops.ed.undo()
    assert color_types() == before
    bpy.ops.ed.redo()
    assert set(color_types()) == {"VERTEX"}


def test_a_saved_file_remembers_what_to_restore(tmp_path: object) -> None:
    before = color_types()
    holder = scene.add_suzanne()
    addon.compute(holder)
    path = f"{tmp_path}/saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=True)
    bpy.ops.ccdepth.clear()
    assert color_types() == before


def test_one_colour_for_each_depth_and_for_all_corners_of_a_face() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.cube())
    addon.compute(first, second)
    module = addon.module("state.colors")
    everything = np.concatenate([addon.depths(first), addon.depths(second)])
    least, deepest = everything.min(), everything.max()
    for holder in (first, second):
        sizes = [polygon.loop_total for polygon in holder.data.polygons]
        linear = module.to_linear(np.array(module.palette(int(least), int(deepest))))
        expected = np.repeat(linear[addon.depths(holder) - least], sizes, axis=0)
        np.testing.assert_allclose(addon.colors(holder)[:, :3], expected, atol=1e-6)
        np.testing.assert_array_equal(addon.colors(holder)[:, 3], 1.0)


def oklab(linear: np.ndarray) -> np.ndarray:
    """(N, 3): Björn Ottosson's Oklab, in which distances are differences as they are seen."""
    cones = linear @ np.array(
        [[0.4122214708, 0.5363325363, 0.0514459929], [0.2119034982, 0.6806995451, 0.1073969566],
         [0.0883024619, 0.2817188376, 0.6299787005]]
    ).T  # fmt: skip
    return np.cbrt(cones) @ np.array(
        [[0.2104542553, 0.7936177850, -0.0040720468], [1.9779984951, -2.4285922050, 0.4505937099],
         [0.0259040371, 0.7827717662, -0.8086757660]]
    ).T  # fmt: skip


@pytest.mark.parametrize("simulation", [np.eye(3), PROTANOPIA, DEUTERANOPIA])
@pytest.mark.parametrize("count", [4, 8, 16])
def test_colours_are_evenly_apart_for_every_eye(simulation: np.ndarray, count: int) -> None:
    module = addon.module("state.colors")
    linear = module.to_linear(np.array(module.palette(0, count - 1)))
    seen = oklab(np.clip(linear @ np.array(simulation).T, 0.0, 1.0))
    assert np.all(np.diff(seen[:, 0]) > 0.0), "each deeper colour is lighter"
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    assert steps.max() < 2.5 * steps.min()


def test_a_single_depth_has_a_colour() -> None:
    assert len(addon.module("state.colors").palette(7, 7)) == 1


def test_legend_rows_count_what_does_not_fit() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    legend = addon.module("ui.legend")
    record = holder.data.ccdepth
    everything = legend.legend_rows(record, 100)
    assert [(row.depth, row.faces) for row in everything] == [
        (str(row.depth), f"{row.faces:,}") for row in reversed(record.rows)
    ]
    short = legend.legend_rows(record, 4)
    assert short[:3] == everything[:3]
    assert short[3].faces == f"{sum(row.faces for row in list(record.rows)[:-3]):,}"


def test_large_counts_stay_short() -> None:
    sidebar_count = addon.module("ui.panels").sidebar_count
    assert sidebar_count(1234567) == "1,234,567"
    assert sidebar_count(8452495638528) == "8.45 × 10¹²"
    assert sidebar_count(4**200) == "2.58 × 10¹²⁰"
