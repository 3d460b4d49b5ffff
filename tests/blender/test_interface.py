# SPDX-License-Identifier: GPL-3.0-or-later
"""What the legend and the panel say, of which objects, and where the legend stands; numbers as they are written; work
in a thread; and that unregistering takes everything back out of Blender."""

import threading
from collections import Counter
from collections.abc import Callable, Generator, Mapping
from decimal import Decimal
from importlib import import_module
from itertools import pairwise
from time import process_time
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.blender.updating import move_vertex

contents = addon.module("ui.legend_contents")
heat_map = addon.module("state.heat_map")
selected = addon.module("ui.facts")


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
    addon.compute(holder)
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


def test_distances_have_a_scale_up_to_the_tolerance_or_to_a_distance_or_in_parts_of_several_tolerances() -> None:
    settings = bpy.context.scene.ccdepth
    [result] = subdivide(scene.add_object(meshes.cube()), tolerance=0.03)
    settings.heat_map = "DISTANCE"
    record = result.data.ccdepth
    legend = shown_legend()
    assert legend.title == "Proved Distance (m)"
    assert legend.notes[:2] == ["for 0.03 m", result.name]
    assert record.largest_bound <= float(legend.notes[2].split()[1]) <= 1.001 * record.largest_bound
    assert [(mark.number, mark.note) for mark in legend.marks][-1] == ("0.03", "tolerance")
    assert not legend.has_beyond
    # With four digits the largest distance would seem to exceed the tolerance.
    record.world_tolerance, record.largest_bound = 0.0375337, 0.0375332
    assert shown_legend().notes == ["for 0.037534 m", result.name, "Largest 0.037534 m"]
    assert shown_legend().marks[-1].number == "0.037534"
    settings.distance_range, settings.distance_top = "FIXED", 0.01
    legend = shown_legend()
    marks = legend.marks
    assert marks[-1].number == "0.01"
    assert legend.has_beyond
    assert not any(mark.note for mark in marks)
    # Tolerances that differ are told in parts.
    settings.distance_range = "TOLERANCE"
    sources = [scene.add_object(meshes.landscape(3, 3)), scene.add_object(meshes.cube(), "Cube")]
    addon.select(*subdivide(*sources, tolerance_mode="RELATIVE", tolerance=0.01))
    legend = shown_legend()
    assert legend.title == "Proved Distance (%)"
    assert [mark.number for mark in legend.marks] == ["0", "20", "40", "60", "80", "100"]


class Layout:
    """A layout that takes whatever is drawn."""

    def __getattr__(self, _name: str) -> Any:
        return self

    def __setattr__(self, _name: str, _value: object) -> None:
        pass

    def __call__(self, *_given: object, **_named: object) -> Any:
        return self

    def __iter__(self) -> Any:
        # The header and the body of a panel.
        return iter((self, self))


PANELS = ("CCDEPTH_PT_settings", "CCDEPTH_PT_analyse", "CCDEPTH_PT_make", "CCDEPTH_PT_check")


def test_a_draw_and_a_timer_take_no_time_among_many_objects_with_depths(monkeypatch: pytest.MonkeyPatch) -> None:
    """No draw and no timer may take more than 5 ms; here of processor time, and the best of five. One object of 3,000
    is selected, and has moved."""
    monkeypatch.setattr(addon.module("ui.panels"), "_swatch", lambda _color: 0)
    holder = scene.add_object(meshes.cube())
    addon.compute(holder, method="FIRST_ORDER")
    for _ in range(3000):
        scene.add("Other", holder.data.copy())
    addon.examine_touched()
    addon.select(holder)
    draws: list[Callable[[], object]] = [
        lambda panel=panel: getattr(bpy.types, panel).draw(SimpleNamespace(layout=Layout()), bpy.context)
        for panel in PANELS
    ]
    for act in (shown_legend, addon.module("state.watch").examine, *draws):
        times = []
        for step in range(5):
            holder.scale.x = 1.0 + step
            bpy.context.view_layer.update()
            started = process_time()
            act()
            times.append(process_time() - started)
        assert min(times) < 0.005, act


lengths = addon.module("ui.lengths")
job = addon.module("operators.mesh_operators")


def set_units(system: str, length_unit: str = "", scale: float = 1.0) -> None:
    units = bpy.context.scene.unit_settings
    units.system, units.scale_length = system, scale
    if length_unit:
        units.length_unit = length_unit


LENGTHS = (
    (("METRIC", "METERS"), {0.0123: "0.0123 m", 1.23e-5: "12.3 µm", 0.0: "0 m"}),
    (("METRIC", "MILLIMETERS"), {1.23e-5: "0.0123 mm"}),
    (("METRIC", "MILLIMETERS", 0.001), {0.0123: "0.0123 mm"}),
    (("METRIC", "MICROMETERS", 1.26e-6), {1.0: "1.26 µm"}),
    (("METRIC", "ADAPTIVE"), {0.0123: "1.23 cm", 1e-9: "0.001 µm"}),
    (("IMPERIAL", "INCHES"), {0.0254: "1 in"}),
    (("IMPERIAL", "FEET"), {2.54e-5: "1 thou"}),
    (("NONE",), {12345.678: "12350", 1.23456e-9: "1.235e-9"}),
)


def test_lengths() -> None:
    for units, texts in LENGTHS:
        set_units(*units)
        assert {length: lengths.length_text(bpy.context.scene, length) for length in texts} == texts


def test_a_bound_stays_one_and_is_written_within_the_tolerance_that_it_is_within() -> None:
    for length, up, down in ((0.12340001, "0.1235 m", "0.1234 m"), (0.12349999, "0.1235 m", "0.1234 m"),
                             (0.99999, "1 m", "0.9999 m")):  # fmt: skip
        assert lengths.length_text(bpy.context.scene, length, lengths.Rounding.UP) == up
        assert lengths.length_text(bpy.context.scene, length, lengths.Rounding.DOWN) == down
    set_units("METRIC")
    for bound, tolerance, texts in (
        # Rounded up to four digits it would seem to exceed the tolerance, which is rounded to the nearest.
        (377.52e-6, 377.53e-6, ("377.52 µm", "377.53 µm")),
        (377.31e-6, 377.53e-6, ("377.4 µm", "377.5 µm")),
        (377.54e-6, 377.53e-6, ("377.6 µm", "377.5 µm")),
        (1.00004, 1.0, ("1.001 m", "1 m")),
        (1.1, 1.1, ("1.1 m", "1.1 m")),
    ):
        for unit in (None, lengths.common_unit(bpy.context.scene, (bound, tolerance))):
            assert lengths.bound_texts(bpy.context.scene, bound, tolerance, unit) == texts


def test_neighbours_share_a_unit_that_serves_them_all() -> None:
    for length_unit, shown, texts in (
        # Alone, the one would be in metres and the other in micrometres.
        ("METERS", (0.00346, 0.00095), ["3.46 mm", "0.95 mm"]),
        ("METERS", (0.00095, 0.0), ["950 µm", "0 µm"]),
        ("METERS", (2.0, 0.00346), ["2 m", "0.00346 m"]),
        ("METERS", (2.0, 2e-6), ["2 m", "2 µm"]),
        ("MILLIMETERS", (2.0, 2e-6), ["2000 mm", "0.002 mm"]),
        ("ADAPTIVE", (0.0123, 0.00123), ["1.23 cm", "0.123 cm"]),
    ):
        set_units("METRIC", length_unit)
        for order in (1, -1):
            unit = lengths.common_unit(bpy.context.scene, shown[::order])
            assert [lengths.length_text(bpy.context.scene, each, unit=unit) for each in shown] == texts
    # So do the ends of a range.
    for found, system, text in (
        ([0.00364, 0.00346], "METRIC", "0.00346–0.00364 m"),
        ([0.00364, 0.00364], "METRIC", "0.00364 m"),
        ([0.00095, 0.00364], "METRIC", "0.95–3.64 mm"),
        ([2e-6, 2.0], "METRIC", "2 µm–2 m"),
        ([0.00095, 0.00364], "NONE", "0.00095–0.00364"),
    ):
        set_units(system)
        assert addon.module("ui.facts").lengths_text(bpy.context.scene, found) == text


def test_counts_and_shares() -> None:
    panels = addon.module("ui.panels")
    counts = {1234567: "1,234,567", 8452495638528: "8.45 × 10¹²", 4**200: "2.58 × 10¹²⁰"}
    assert {count: addon.module("ui.facts").short_count(count) for count in counts} == counts
    for faces, total, text in (
        (125_000, 125_003, "125,000  (99.9 %)"),
        (3, 125_003, "3  (< 0.1 %)"),
        (500, 500, "500  (100.0 %)"),
        (1, 3, "1  (33.3 %)"),
        (0, 3, "0  (0.0 %)"),
    ):
        assert panels.share_text(faces, total) == text
    record = bpy.data.meshes.new("Nearly all").ccdepth
    record.faces, record.exact_faces, record.method, record.vertices = 100_000, 99_999, "DISTANCE", "LIMIT"
    record.uniform_level, record.uniform_faces = 1, "400000"
    facts = addon.module("ui.facts").facts_of(bpy.context.scene, record)
    assert facts[-1].value == "99.9 % of faces"


def test_a_result_is_compared_with_the_level_that_is_enough_for_all_faces() -> None:
    def counts(made: bpy.types.Object) -> dict[str, str]:
        facts = addon.module("ui.facts")
        found = [*facts.facts_of(bpy.context.scene, made.data.ccdepth), *facts.counts_of(made.data, holder.data)]
        return {fact.name: fact.value for fact in found}

    holder = scene.add_suzanne()
    [result] = subdivide(holder, tolerance=0.01)
    faces, triangles = len(result.data.polygons), len(result.data.loop_triangles)
    assert counts(result)["Faces"] == f"{faces:,}"
    assert counts(result)["Triangles"] == f"{triangles:,}"
    addon.compute(holder, tolerance=0.01, method="DISTANCE")
    record = holder.data.ccdepth
    share = 100 * faces / int(record.uniform_faces)
    assert 1 < share < 100
    assert counts(result)[f"Of Level {record.uniform_level}"] == f"{share:.1f} %"
    addon.compute(holder, tolerance=0.02, method="DISTANCE")
    assert not any(name.startswith("Of Level") for name in counts(result))


@pytest.mark.parametrize("top", ["1", "0.0378", "2.5", "999", "4.9999", "1e-7"])
def test_round_numbers_are_few_and_reach_far(top: str) -> None:
    numbers = contents.round_numbers(Decimal(top))
    assert 2 <= len(numbers) <= 6
    assert numbers[0] == 0
    step = numbers[1]
    assert step.as_tuple().digits in {(1,), (2,), (5,), (1, 0)}
    assert numbers[-1] <= Decimal(top) < numbers[-1] + step


@pytest.mark.parametrize("top", ["0.5", "1", "1.02", "3", "40"])
def test_marks_have_room_and_the_tolerance_has_one_where_it_is_on_the_scale(top: str) -> None:
    marks = contents.distance_marks(Decimal(top), Decimal(1))
    heights = [mark.height for mark in marks]
    # Heights are rounded to double precision.
    assert all(later - earlier > contents.NUMBER_HEIGHT - 1e-9 for earlier, later in pairwise(heights))
    assert min(heights) == (0.0 if top != "40" else pytest.approx(0.025))
    tolerance = [mark.height for mark in marks if mark.note == "tolerance"]
    assert tolerance == ([] if top == "0.5" else [pytest.approx(1 / float(top))])


def begun(work: Callable[..., object], *, in_threads: bool = True, faults: list[BaseException] | None = None) -> Any:
    """A job that is this work alone. faults: gets what arrives in its steps."""

    def steps() -> Generator[Any, Any, object]:
        try:
            return (yield job.Work(work, "{:.2f} done".format, total=0.5))
        except BaseException as fault:
            (faults if faults is not None else []).append(fault)
            raise

    return job.Job(steps(), in_threads=in_threads)


def test_work_in_a_thread_tells_its_progress_and_returns() -> None:
    looked = threading.Event()

    def work(progress: Callable[[float], None]) -> threading.Thread:
        progress(0.25)
        looked.wait(20.0)
        return threading.current_thread()

    run = begun(work)
    while not run.run(0.01):
        if (run.text, run.fraction) == ("0.25 done", 0.5):
            looked.set()
    assert looked.is_set()
    assert run.answer not in (None, threading.current_thread())


@pytest.mark.parametrize("in_threads", [False, True])
def test_what_work_raises_arrives_in_the_steps_and_goes_on(in_threads: bool) -> None:
    faults: list[BaseException] = []
    with pytest.raises(MemoryError):
        begun(Mock(side_effect=MemoryError), in_threads=in_threads, faults=faults).run()
    assert [type(fault) for fault in faults] == [MemoryError]


@pytest.mark.parametrize("stop", ["give_up", "stop_all"])
def test_work_in_a_thread_can_be_stopped(stop: str) -> None:
    ended = []

    def work(progress: Callable[[float], None]) -> None:
        try:
            while True:
                progress(0.5)
        except job.Cancelled:
            ended.append(True)
            raise

    run = begun(work)
    while run.fraction != 1.0:
        assert not run.run(0.01)
    if stop == "give_up":
        run.give_up()
        for thread in threading.enumerate():
            if thread.name == "CC Depth":
                thread.join(20.0)
        assert ended == [True]
    job.stop_all()
    assert ended == [True]
    if stop == "stop_all":
        with pytest.raises(job.Cancelled):
            run.run()


HOLDERS = (bpy.types.Scene, bpy.types.Mesh, bpy.types.Object, bpy.types.View3DShading)
PACKAGE = bpy.types.CCDEPTH_OT_compute.__module__.rpartition(".operators.")[0]
MENUS = ("VIEW3D_MT_object", "VIEW3D_MT_edit_mesh")


def of_the_add_on() -> list[str]:
    """Handlers, by the names of their lists and their own, what menus draw, and classes."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    lists |= {menu: getattr(bpy.types, menu).draw._draw_funcs for menu in MENUS}
    return sorted(
        f"{name} {each.__module__}.{each.__name__}"
        for name, found in lists.items()
        if isinstance(found, list)
        for each in found
        if getattr(each, "__module__", "").startswith(f"{PACKAGE}.")
    ) + [name for name in dir(bpy.types) if name.startswith("CCDEPTH_")]


@pytest.mark.every_blender
def test_nothing_is_left_behind_and_everything_comes_back_once() -> None:
    package, before = import_module(PACKAGE), of_the_add_on()
    assert len(set(before)) == len(before) > 10
    assert all(sum(each.startswith(f"{menu} ") for each in before) == 1 for menu in MENUS)
    package.unregister()
    try:
        # Without a window nothing is drawn.
        for drawn in (import_module(f"{PACKAGE}.ui.{name}") for name in ("legend", "overlay")):
            drawn.register()
            handle = drawn._handle
            drawn.unregister()
            with pytest.raises(ValueError, match="removed"):
                bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")
        assert not of_the_add_on()
        assert not any(hasattr(holder, "ccdepth") for holder in HOLDERS)
    finally:
        package.register()
    assert of_the_add_on() == before


# The manual's sections of buttons and settings.
SECTIONS = {
    "bpy.ops.ccdepth.compute": "compute-depth",
    "bpy.ops.ccdepth.subdivide": "adaptive-subdivision",
    "bpy.ops.ccdepth.before_after": "results",
    "bpy.types.scenesettings.relative_tolerance": "tolerance",
    "bpy.types.scenesettings.heat_map": "heat-map-and-legend",
}


def test_the_menu_has_every_operator_that_people_start() -> None:
    entries = [entry[0] for entry in addon.module("ui.manual").ENTRIES if entry is not None]
    assert len(set(entries)) == len(entries)
    hidden = {"update_kept", "use_preset", "tolerance_preset_add", "copy_value", "open_manual", "cancel"}
    assert {name.partition(".")[2] for name in entries} == set(dir(bpy.ops.ccdepth)) - hidden


def test_tooltips_and_copies_of_values() -> None:
    operator = bpy.types.CCDEPTH_OT_copy_value
    properties = bpy.context.window_manager.operator_properties_last("ccdepth.copy_value")
    properties.meaning = "How many faces there are"
    assert operator.description(bpy.context, properties).startswith("How many faces there are.")
    assert bpy.ops.ccdepth.copy_value(value="5,800") == {"FINISHED"}


@pytest.mark.every_blender
def test_online_manual_of_a_button_is_our_own_and_has_every_section(monkeypatch: pytest.MonkeyPatch) -> None:
    manual, opened = addon.module("ui.manual"), []
    for button, section in SECTIONS.items():
        url = bpy.types.WM_OT_doc_view_manual._lookup_rna_url(button, verbose=False)
        assert url.startswith("file://")
        assert url.endswith(f"index.html#{section}")
    page = manual.PAGE.read_text(encoding="utf-8")
    assert all(f'id="{section}"' in page for _, section in manual.SECTIONS)
    monkeypatch.setattr("webbrowser.open", opened.append)
    assert bpy.ops.ccdepth.open_manual() == {"FINISHED"}
    assert opened == [manual.PAGE.as_uri()]
    assert "manual of CC Depth" in bpy.ops.ccdepth.open_manual.get_rna_type().description
    # The preferences belong to the add-on.
    assert PACKAGE.removesuffix(".ccdepth_addon") == manual.CCDEPTH_AP_preferences.bl_idname
