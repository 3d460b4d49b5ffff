# SPDX-License-Identifier: GPL-3.0-or-later
"""What the legend and the panel say, of which objects, and where it stands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations, product
from types import ModuleType
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.blender.updating import move_vertex

contents = addon.module("ui.legend_contents")
heat_map = addon.module("state.heat_map")
selected = addon.module("ui.selected_objects")


def shown_legend() -> Any:
    context = bpy.context
    kind = heat_map.shown(context.scene.ccdepth)
    return contents.legend(context.scene, kind, selected.colored_objects(context, kind))


def told() -> dict[int, int]:
    """The faces of each depth, as the legend has them."""
    return {int(row.label.removeprefix("≥ ")): row.faces for row in shown_legend().rows}


def as_told(histogram: Mapping[int, int]) -> dict[int, int]:
    """The same: all from depth 8 on together."""
    deep = sum(faces for depth, faces in histogram.items() if depth >= 8)
    return {depth: faces for depth, faces in histogram.items() if depth < 8} | ({8: deep} if deep else {})


def three_objects() -> list[bpy.types.Object]:
    holders = [scene.add_suzanne(), scene.add_object(meshes.cube(), "Cube"), scene.add_object(meshes.cube(), "Small")]
    holders[2].scale = (0.5, 0.5, 0.5)
    addon.compute(*holders, tolerance=0.005)
    return holders


def test_it_tells_title_tolerance_and_what_it_counts() -> None:
    holder, settings = scene.add_suzanne(), bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", 0.0125
    addon.select(holder)
    bpy.ops.ccdepth.compute()
    legend = shown_legend()
    assert (legend.title, legend.notes, legend.alert) == ("Levels Needed", ["for 0.0125 m", holder.name], "")
    bpy.context.scene.unit_settings.length_unit = "MILLIMETERS"
    assert shown_legend().notes[0] == "for 12.5 mm"
    assert told() == as_told(addon.histogram(holder))
    assert [*told()] == sorted(told(), reverse=True)


def test_depths_from_the_last_colour_on_share_a_row() -> None:
    holder = scene.add_object(meshes.cube())
    addon.compute(holder, tolerance=1e-5)
    deepest = max(addon.histogram(holder))
    assert deepest > 8
    [row] = shown_legend().rows
    assert (row.label, row.faces) == ("≥ 8", 6)
    assert row.color == pytest.approx(tuple(addon.module("state.colors").depth_colors([8])[0]))


def test_it_is_about_what_is_selected_whatever_is_active_or_about_the_active_one_or_all() -> None:
    holders = three_objects()
    others = scene.add_suzanne()
    addon.compute(others, tolerance=0.5)
    light = scene.add_light()
    for active in (light, None, others):
        addon.select(*holders, light)
        bpy.context.view_layer.objects.active = active
        together = sum((Counter(addon.histogram(holder)) for holder in holders), Counter())
        assert told() == as_told(together)
        assert shown_legend().notes == ["for 0.005 m", "3 objects"]
        assert selected.with_depths(bpy.context) == holders
    addon.select()
    bpy.context.view_layer.objects.active = holders[1]
    assert colored() == [holders[1]]
    addon.select(light)
    assert colored() == [*holders, others]
    holders[0].hide_set(True)
    assert colored() == [*holders[1:], others]
    # Clear goes by the selection too.
    addon.select(*holders[1:], light)
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert addon.is_untouched(holders[1:])


def colored() -> list[bpy.types.Object]:
    return selected.colored_objects(bpy.context, heat_map.Shown.DEPTH)


def test_a_mesh_of_several_objects_counts_once() -> None:
    cubes = [scene.add_object(meshes.cube()) for _ in range(8)]
    cubes.append(scene.add_mesh(cubes[0].data))
    addon.compute(*cubes)
    assert sum(row.faces for row in shown_legend().rows) == 8 * 6
    addon.compute(scene.add_object(meshes.cube(), "Cube with a very long name"))
    assert shown_legend().notes[1] == "Cube with a very lo…"


def test_it_says_when_results_are_out_of_date() -> None:
    holders = three_objects()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance = "ABSOLUTE", 0.005
    assert shown_legend().alert == ""
    move_vertex(holders[0].data)
    addon.examine_touched()
    assert shown_legend().alert == f"Out of date: {holders[0].name}"
    addon.select(holders[0])
    assert shown_legend().alert == f"Out of date: {holders[0].name}"
    move_vertex(holders[1].data)
    addon.examine_touched()
    addon.select(*holders)
    assert shown_legend().alert == "Out of date: 2 of 3"
    addon.select(*holders)
    settings.tolerance = 0.5
    assert shown_legend().alert == "Out of date: 3 of 3"


def test_distances_have_a_scale_up_to_the_tolerance_or_to_a_distance() -> None:
    settings = bpy.context.scene.ccdepth
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.03)
    record = result.data.ccdepth
    legend = shown_legend()
    assert legend.title == "Proved Distance (m)"
    assert legend.notes[:2] == ["for 0.03 m", result.name]
    assert float(legend.notes[2].split()[1]) == pytest.approx(record.largest_bound, rel=1e-3)
    assert [(mark.number, mark.note) for mark in legend.marks(0.1)][-1] == ("0.03", "tolerance")
    assert not legend.has_beyond
    settings.distance_range, settings.distance_top = "FIXED", 0.01
    legend = shown_legend()
    marks = legend.marks(0.1)
    assert marks[-1].number == "0.01"
    assert legend.has_beyond
    assert not any(mark.note for mark in marks)


def test_tolerances_that_differ_are_told_in_parts() -> None:
    sources = [scene.add_object(meshes.landscape(3, 3)), scene.add_object(meshes.cube(), "Cube")]
    addon.select(*subdivide(*sources, tolerance_mode="RELATIVE", tolerance=0.01))
    legend = shown_legend()
    assert legend.title == "Proved Distance (%)"
    assert [mark.number for mark in legend.marks(0.1)] == ["0", "20", "40", "60", "80", "100"]


# The layout, with texts as wide as letters of one width would be


layout: ModuleType = addon.module("ui.legend_layout")

LETTER = 0.55

TITLE, TOLERANCE = "Levels Needed", "for 3.64 mm"

# A viewport of the default window, one of a small screen, a quarter of each, a low one, and a narrow one.
REGIONS = [(1180, 786), (800, 500), (590, 393), (400, 250), (1180, 160), (260, 786)]

FACES = [3, 125_000, 14, 2_700, 1, 0, 40_000, 12, 7]


def width(text: str, size: float) -> float:
    return LETTER * size * len(text)


def depths(count: int = 9) -> Any:
    rows = [contents.Row(str(depth), FACES[depth], (depth / 9, 0.5, 0.5)) for depth in reversed(range(count))]
    return contents.Legend(TITLE, [TOLERANCE, "Suzanne"], "Out of date", rows)


def distances(*, beyond: bool = False) -> Any:
    mark = contents.Mark
    marks = [mark(0.0, "0.0"), mark(0.6, "0.3", "tolerance"), mark(1.0, "0.5")]
    return contents.Legend("Deviation (m)", [TOLERANCE, "Suzanne"], marks=lambda _gap: marks, has_beyond=beyond)


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
    return layout.placed(legend, region, obstacles(region, scale, *names), scale, width)


def extent(text: Any, size: float) -> tuple[float, float]:
    right = text.x if text.ends_there else text.x + width(text.text, size)
    return right - width(text.text, size), right


def is_inside(place: Any, width: float, height: float) -> bool:
    return 0 <= place.left < place.right <= width and 0 <= place.bottom < place.top <= height


LEGENDS = {"depths": depths(), "few": depths(2), "distances": distances(), "beyond": distances(beyond=True)}
HIDDEN_BY = [(), ("header", "gizmo", "tools"), ("header", "gizmo", "tools", "sidebar"), ("header", "tools", "adjust")]


@pytest.mark.parametrize("legend", LEGENDS.values(), ids=LEGENDS)
def test_everything_is_inside_and_nothing_is_over_anything_else(legend: Any) -> None:
    for region, scale, names in product(REGIONS, (1.0, 1.5, 2.0), HIDDEN_BY):
        answer = place(legend, region, scale, *names)
        if answer is None:
            continue
        found, where = answer
        assert (where.right - where.left, where.top - where.bottom) == pytest.approx((found.width, found.height))
        assert is_inside(where, *region)
        assert not any(where.overlaps(each) for each in obstacles(region, scale, *names))
        places = [each for each, _ in found.swatches]
        assert all(is_inside(each, found.width, found.height) for each in places)
        assert not any(one.overlaps(other) for one, other in combinations(places, 2))
        written = [(text, extent(text, found.font_size)) for text in found.texts if text.text]
        for text, (left, right) in written:
            assert left >= 0
            # Widths are sums in another order.
            assert right <= found.width + 1e-9
            assert 0 <= text.y <= found.height - found.font_size
            beside = [each for each in places if each.bottom <= text.y < each.top]
            assert all(right <= swatch.left or left >= swatch.right for swatch in beside), text
        for (one, ends), (other, others) in combinations(written, 2):
            if abs(one.y - other.y) < found.font_size:
                assert ends[1] <= others[0] or others[1] <= ends[0], (one, other)


def test_with_room_it_is_in_the_corner_with_everything_and_grows_with_the_interface() -> None:
    found, where = place(depths(), (1180, 786))
    assert (where.right, where.bottom) == (1180 - layout.MARGIN, layout.MARGIN)
    assert {TITLE, TOLERANCE, "Suzanne", "Out of date", "Depth", "Faces"} <= {text.text for text in found.texts}
    rows = {row.color: row for row in depths().rows}
    assert len(found.swatches) == len(rows)
    for swatch, color in found.swatches:
        beside = [text for text in found.texts if swatch.bottom <= text.y < swatch.top]
        assert [text.text for text in sorted(beside)] == sorted([rows[color].label, f"{rows[color].faces:,}"])
    # Lengths are rounded to pixels.
    two = place(depths(), (2400, 1600), 2.0)[0]
    assert (two.width, two.height) == pytest.approx((2 * found.width, 2 * found.height), rel=0.02)


def test_with_less_room_it_shrinks_then_leaves_out_its_notes_and_then_is_not_there() -> None:
    # The views of Quad View have all depths.
    for region, size in (((590, 393), 1.0), ((400, 300), 1.0), ((1180, 786), 2.0)):
        found, _ = place(depths(), region, size)
        assert len(found.swatches) == 9
        assert TOLERANCE in {text.text for text in found.texts}
    sizes = {found[0].height for up in range(150, 500, 10) if (found := place(depths(), (700, up)))}
    assert len(sizes) == 4
    assert place(depths(), (60, 40)) is None
