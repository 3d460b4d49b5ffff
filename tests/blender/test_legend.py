# SPDX-License-Identifier: GPL-3.0-or-later
"""What the legend and the panel say, and of which objects."""

from __future__ import annotations

from collections import Counter

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide

contents = addon.module("ui.legend_contents")
selected = addon.module("ui.selected_results")


def legends() -> list[object]:
    context = bpy.context
    return contents.legends(context.scene, selected.colored_objects(context))


def three_objects() -> list[bpy.types.Object]:
    holders = [scene.add_suzanne(), scene.add_object(meshes.cube(), "Cube"), scene.add_object(meshes.cube(), "Small")]
    holders[2].scale = (0.5, 0.5, 0.5)
    # A row for each depth.
    bpy.context.scene.ccdepth.last_color_depth = 20
    addon.compute(*holders, tolerance=0.005)
    return holders


def test_it_tells_title_tolerance_and_what_it_counts() -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.last_color_depth = "ABSOLUTE", 0.0125, 20
    addon.select(holder)
    bpy.ops.ccdepth.compute()
    [legend] = legends()
    assert (legend.title, legend.tolerance, legend.alert) == ("Levels Needed", "for 0.0125 m", "")
    assert legend.notes == [holder.name]
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    [legend] = legends()
    assert legend.tolerance == "for 12.5 mm"
    rows = {int(row.label): row.faces for row in legend.rows}
    assert rows == addon.histogram(holder)
    assert [*rows] == sorted(rows, reverse=True)


def test_depths_that_share_a_colour_share_a_row() -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    settings.first_color_depth, settings.last_color_depth = 4, 9
    addon.compute(holder, tolerance=1e-3)
    counts = addon.histogram(holder)
    assert min(counts) < 4
    assert max(counts) > 9
    [legend] = legends()
    assert (legend.rows[0].label, legend.rows[-1].label) == ("≥ 9", "≤ 4")
    assert sum(row.faces for row in legend.rows) == 500
    assert legend.rows[0].faces == sum(faces for depth, faces in counts.items() if depth >= 9)
    assert legend.rows[-1].faces == sum(faces for depth, faces in counts.items() if depth <= 4)
    settings.last_color_depth = max(counts)
    [legend] = legends()
    assert legend.rows[0].label == str(max(counts))


def test_it_is_about_what_is_selected_whatever_is_active_or_about_the_active_one_or_all() -> None:
    holders = three_objects()
    others = scene.add_suzanne()
    addon.compute(others, tolerance=0.5)
    light = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "POINT"))
    bpy.context.scene.collection.objects.link(light)
    for active in (light, None, others):
        addon.select(*holders, light)
        bpy.context.view_layer.objects.active = active
        [legend] = legends()
        together = sum((Counter(addon.histogram(holder)) for holder in holders), Counter())
        assert {int(row.label): row.faces for row in legend.rows} == together
        assert legend.objects == [("Suzanne", "500"), ("Cube", "6"), ("Small", "6")]
        assert bpy.types.CCDEPTH_PT_results.poll(bpy.context)
        assert selected.selected_results(bpy.context) == holders
    addon.select()
    bpy.context.view_layer.objects.active = holders[1]
    assert selected.colored_objects(bpy.context) == [holders[1]]
    addon.select(light)
    assert selected.colored_objects(bpy.context) == [*holders, others]
    assert not bpy.types.CCDEPTH_PT_results.poll(bpy.context)
    holders[0].hide_set(True)
    assert selected.colored_objects(bpy.context) == [*holders[1:], others]


def test_many_objects_are_counted_and_few_listed() -> None:
    """A mesh of several objects counts once."""
    cubes = [scene.add_object(meshes.cube(), f"Cube with a very long name {number}") for number in range(8)]
    cubes.append(scene.add_mesh(cubes[0].data))
    addon.compute(*cubes)
    [legend] = legends()
    assert sum(row.faces for row in legend.rows) == 8 * 6
    assert len(legend.objects) == contents.MOST_OBJECTS
    assert legend.objects[-1] == ("5 more", "")
    assert all(len(name) <= 20 for name, _ in legend.objects)


def test_it_says_when_results_are_out_of_date() -> None:
    holders = three_objects()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", 0.005
    assert legends()[0].alert == ""
    holders[0].data.vertices[0].co.x += 1.0
    holders[0].data.update_tag()
    bpy.context.view_layer.update()
    addon.module("state.staleness").check_touched()
    assert legends()[0].alert == "Out of date: 1 of 3"
    addon.select(holders[0])
    assert legends()[0].alert == "Out of date"
    addon.select(*holders)
    settings.tolerance = 0.5
    assert legends()[0].alert == "Out of date: 3 of 3"


def test_each_thing_that_is_shown_has_a_legend() -> None:
    source, cube = scene.add_suzanne(), scene.add_object(meshes.cube(), "Cube")
    addon.compute(cube)
    [result] = subdivide(source, tolerance=0.03)
    addon.select(cube, result)
    assert {legend.title for legend in legends()} == {"Levels Needed", "Proved Distance"}
    addon.select(result)
    [legend] = legends()
    marks = {mark.note: mark for mark in legend.scale(0.1).marks}
    record = result.data.ccdepth
    assert float(marks["largest"].number) == pytest.approx(record.largest_bound, rel=0.01)
    assert float(marks["tolerance"].number) == pytest.approx(record.world_tolerance, rel=0.01)
    assert legend.notes == [result.name, f"Faces {len(result.data.polygons):,}"]


def test_scales_of_their_own_are_told_in_parts_and_a_fixed_one_in_lengths() -> None:
    sources = [scene.add_suzanne(), scene.add_object(meshes.cube(), "Cube")]
    results = subdivide(*sources, tolerance_mode="RELATIVE", tolerance=0.01)
    addon.select(*results)
    [legend] = legends()
    assert [mark.number for mark in legend.scale(0.1).marks] == ["0 %", "20 %", "40 %", "60 %", "80 %", "100 %"]
    assert legend.scale(0.1).marks[-1].note == "largest"
    settings = bpy.context.scene.ccdepth
    settings.distance_range, settings.distance_top = "FIXED", 0.01
    [legend] = legends()
    scale = legend.scale(0.1)
    assert scale.title == "Proved Distance (m)"
    assert "0.01" in [mark.number for mark in scale.marks]
    assert scale.has_beyond
    # One distance has one colour on both.
    module = addon.module("state.colors")
    for result in results:
        expected = module.to_linear(module.scale_colors(addon.bounds(result).astype(float) / 0.01))
        sizes = [polygon.loop_total for polygon in result.data.polygons]
        assert addon.colors(result)[:, :3] == pytest.approx(np.repeat(expected, sizes, axis=0), abs=1e-5)
