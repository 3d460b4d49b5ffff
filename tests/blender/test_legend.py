# SPDX-License-Identifier: GPL-3.0-or-later
"""What the legend and the panel say, of which objects, and where it stands."""

from __future__ import annotations

from collections import Counter
from itertools import combinations, product
from types import ModuleType
from typing import Any

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
    light = scene.add_light()
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
    # Clear goes by the selection too.
    addon.select(*holders[1:], light)
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert addon.is_untouched(holders[1:])


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
    addon.module("state.watch").examine()
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


# The layout, with texts as wide as letters of one width would be


layout: ModuleType = addon.module("ui.legend_layout")
distance_scale: ModuleType = addon.module("ui.distance_scale")

LETTER = 0.55

TITLE, TOLERANCE = "Levels Needed", "for 3.64 mm"

# A viewport of the default window, one of a small screen, a quarter of each, a low one, and a narrow one.
REGIONS = [(1180, 786), (800, 500), (590, 393), (400, 250), (1180, 160), (260, 786)]

BEYOND = (1.0, 0.0, 0.0, 1.0)

FACES = [3, 125_000, 14, 2_700, 1, 0, 40_000, 12, 7]


def width(text: str, size: float) -> float:
    return LETTER * size * len(text)


def depths(count: int = 9, objects: int = 0) -> Any:
    rows = [layout.Row(str(depth), FACES[depth], (depth / 9, 0.5, 0.5)) for depth in reversed(range(count))]
    listed = [(f"Suzanne.{number:03}", "1,968") for number in range(objects)]
    return layout.Legend(TITLE, TOLERANCE, ["Suzanne"], "Out of date", rows, objects=listed)


def distances(largest: float = 0.5) -> Any:
    has_beyond = largest > 0.5
    return layout.Legend(
        "Deviation",
        notes=["Faces 7,730"],
        scale=lambda gap: distance_scale.Scale(
            "Deviation (m)",
            [
                distance_scale.Mark(0.0, 0.0, "0.0"),
                distance_scale.Mark(0.6, 0.6, "0.3", "tolerance"),
                distance_scale.Mark(1.0, 1.0, "0.5"),
                *([distance_scale.Mark(2.0, 1.0 + 1.5 * gap, "1.0", "largest")] if has_beyond else []),
            ],
            has_beyond,
        ),
    )


def obstacles(region: tuple[int, int], scale: float, *names: str) -> list[Any]:
    """The sidebar, the header, the gizmo and the panel Adjust Last Operation, where Blender has them."""
    across, up = region
    places = {
        "sidebar": layout.Rectangle(across - 260 * scale, 0, across, up),
        "header": layout.Rectangle(0, up - 54 * scale, across, up),
        "gizmo": layout.Rectangle(across - 100 * scale, up - 250 * scale, across, up),
        "adjust": layout.Rectangle(60 * scale, 0, 360 * scale, 200 * scale),
        "tools": layout.Rectangle(0, 0, 58 * scale, up),
    }
    return [places[name] for name in names]


def place(legend: Any, region: tuple[int, int], scale: float = 1.0, *names: str) -> Any:
    room = layout.Room(region, obstacles(region, scale, *names))
    return layout.placed(legend, room, scale, width, BEYOND)


def texts(found: Any) -> list[str]:
    return [text.text for text in found.texts]


def extent(text: Any, size: float) -> tuple[float, float]:
    right = text.x if text.ends_there else text.x + width(text.text, size)
    return right - width(text.text, size), right


LEGENDS = {
    "depths": depths(),
    "few depths": depths(2),
    "objects": depths(5, objects=4),
    "distances": distances(),
    "distances beyond": distances(1.0),
}
HIDDEN_BY = [(), ("header", "gizmo", "tools"), ("header", "gizmo", "tools", "sidebar"), ("header", "tools", "adjust")]


@pytest.mark.parametrize("legend", LEGENDS.values(), ids=LEGENDS)
def test_everything_is_inside_and_nothing_is_over_anything_else(legend: Any) -> None:
    above_the_panel = product(product(range(420, 1200, 120), range(300, 800, 100)), (1.0,), (("adjust",),))
    for region, scale, names in (*product(REGIONS, (1.0, 1.5, 2.0), HIDDEN_BY), *above_the_panel):
        answer = place(legend, region, scale, *names)
        if answer is None:
            continue
        found, where = answer
        assert (where.right - where.left, where.top - where.bottom) == pytest.approx((found.width, found.height))
        assert is_inside(where, *region)
        assert not any(where.overlaps(each) for each in obstacles(region, scale, *names))
        places = [each for each, _ in found.swatches] + ([] if found.ramp is None else [found.ramp])
        assert all(is_inside(each, found.width, found.height) for each in places)
        assert not any(one.overlaps(other) for one, other in combinations(places, 2))
        written = [(text, extent(text, found.font_size)) for text in found.texts if text.text]
        for text, (left, right) in written:
            assert left >= 0
            # Widths are sums in another order.
            assert right <= found.width + 1e-9
            assert 0 <= text.y <= found.height - found.font_size
            beside = [swatch for swatch, _ in found.swatches if swatch.bottom <= text.y < swatch.top]
            assert all(right <= swatch.left or left >= swatch.right for swatch in beside), text
        for (one, ends), (other, others) in combinations(written, 2):
            if abs(one.y - other.y) < found.font_size:
                assert ends[1] <= others[0] or others[1] <= ends[0], (one, other)
    assert place(legend, (700, 500), 1.0, "adjust") is not None


def is_inside(place: Any, width: float, height: float) -> bool:
    return 0 <= place.left < place.right <= width and 0 <= place.bottom < place.top <= height


def test_with_room_it_is_a_column_in_the_corner_with_everything() -> None:
    found, where = place(LEGENDS["objects"], (1180, 786))
    assert (where.right, where.bottom) == (1180 - layout.MARGIN, layout.MARGIN)
    assert found.font_size == layout.FONT_SIZE
    assert {TITLE, TOLERANCE, "Suzanne", "Out of date", "Depth", "Faces", "Suzanne.003"} <= {*texts(found)}
    assert [color for _, color in found.swatches] == [row.color for row in reversed(depths(5).rows)]
    # It grows with the interface; lengths are rounded to pixels.
    one, two = (place(depths(), (2400, 1600), scale)[0] for scale in (1.0, 2.0))
    assert two.font_size == 2 * one.font_size
    assert (two.width, two.height) == pytest.approx((2 * one.width, 2 * one.height), rel=0.02)


def test_colours_stand_beside_their_depths() -> None:
    """In a column on the same line; in a strip directly to the left."""
    for region in ((1180, 786), (1180, 160)):
        found, _ = place(depths(), region)
        rows = {row.color: row for row in depths().rows}
        assert len(found.swatches) == len(rows)
        for swatch, color in found.swatches:
            beside = [text for text in found.texts if swatch.bottom <= text.y < swatch.top and text.x > swatch.right]
            label = min(beside, key=lambda text: extent(text, found.font_size)[0])
            assert label.text == rows[color].label


def test_as_room_gets_less_it_lies_down_then_leaves_out_the_objects_and_then_is_not_there() -> None:
    found, _ = place(depths(), (1180, 160))
    assert found.width > 2 * found.height
    assert len(found.swatches) == 9
    scale, _ = place(distances(), (1180, 160))
    assert scale.ramp.right - scale.ramp.left > scale.ramp.top - scale.ramp.bottom
    without, _ = place(depths(5, objects=5), (1180, 250))
    assert len(without.swatches) == 5
    assert "Suzanne.000" not in texts(without)
    # The views of Quad View, the first at two interface scales, have all depths.
    for region, size in (((590, 393), 2.0), ((590, 393), 1.0), ((400, 250), 1.0)):
        assert {str(depth) for depth in range(9)} <= {*texts(place(depths(), region, size)[0])}
    assert place(depths(), (60, 40)) is None


def test_something_that_is_only_avoided_is_covered_before_a_row_goes() -> None:
    region, text = (260, 300), layout.Rectangle(0, 80, 260, 300)
    free, covering = (
        layout.placed(legend, layout.Room(region, [], [text]), 1.0, width, BEYOND) for legend in (depths(2), depths(9))
    )
    assert not free[1].overlaps(text)
    assert covering[1].overlaps(text)
    assert len(covering[0].swatches) == 9


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_however_little_room_there_is_the_tolerance_stays_and_rows_that_go_are_those_of_fewest_faces(
    scale: float,
) -> None:
    """Depths have it after their title, a scale of distances beside its colours or, as a strip, in its title. No row
    goes to make room for one line that counts the rest."""
    shapes, kept_counts = set(), set()
    for *region, legend in product(range(80, 700, 20), range(60, 500, 20), (depths(), distances(), distances(1.0))):
        answer = place(legend, tuple(region), scale)
        if answer is None:
            continue
        shapes.add((bool(legend.rows), answer[0].width > answer[0].height))
        told = [TOLERANCE] if legend.rows else ["tolerance", "Tolerance 0.3"]
        assert any(each in text for text in texts(answer[0]) for each in told)
        # Swatches are in the rows' colours, and depths have different ones.
        colors = [color for _, color in answer[0].swatches]
        kept = [row.faces for row in legend.rows if row.color in colors]
        left_out = [row.faces for row in legend.rows if row.color not in colors]
        kept_counts.add(len(kept))
        assert len(left_out) != 1
        assert not left_out or (min(kept) >= max(left_out) and f"{sum(left_out):,}" in texts(answer[0]))
    assert len(shapes) == 4
    assert len(kept_counts) > 5
