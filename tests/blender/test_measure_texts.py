# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers as the interface writes them, the scale of the legend, and work in a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from decimal import Decimal
from itertools import pairwise
from typing import Any

import bpy
import pytest

from tests.blender import addon

lengths = addon.module("ui.lengths")
contents = addon.module("ui.legend_contents")
job = addon.module("operators.job")


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


def test_rounding_keeps_a_bound_a_bound() -> None:
    texts = [
        lengths.length_text(bpy.context.scene, length, rounding)
        for length in (0.12340001, 0.12349999, 0.99999)
        for rounding in (lengths.Rounding.UP, lengths.Rounding.DOWN)
    ]
    assert texts == ["0.1235 m", "0.1234 m", "0.1235 m", "0.1234 m", "1 m", "0.9999 m"]


def test_a_bound_within_the_tolerance_is_written_within_it() -> None:
    set_units("METRIC")
    for bound, tolerance, text in (
        # Rounded up it would seem to exceed the tolerance, which is rounded to the nearest.
        (377.52e-6, 377.53e-6, "377.5 µm"),
        (377.31e-6, 377.53e-6, "377.4 µm"),
        (377.54e-6, 377.53e-6, "377.6 µm"),
        (1.00004, 1.0, "1.001 m"),
    ):
        for unit in (None, lengths.common_unit(bpy.context.scene, (bound, tolerance))):
            assert lengths.bound_text(bpy.context.scene, bound, tolerance, unit) == text


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


def test_a_range_of_lengths_has_one_unit_where_one_serves() -> None:
    for found, system, text in (
        ([0.00364, 0.00346], "METRIC", "0.00346–0.00364 m"),
        ([0.00364, 0.00364], "METRIC", "0.00364 m"),
        ([0.00095, 0.00364], "METRIC", "0.95–3.64 mm"),
        ([2e-6, 2.0], "METRIC", "2 µm–2 m"),
        ([0.00095, 0.00364], "NONE", "0.00095–0.00364"),
    ):
        set_units(system)
        assert addon.module("ui.selected_objects").lengths_text(bpy.context.scene, found) == text


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


# The scale of the legend.


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
    gap = 0.1
    marks = contents.distance_marks(Decimal(top), Decimal(1), gap)
    heights = [mark.height for mark in marks]
    # Heights are rounded to double precision.
    assert all(later - earlier > gap - 1e-9 for earlier, later in pairwise(heights))
    assert min(heights) == (0.0 if top != "40" else pytest.approx(0.025))
    tolerance = [mark.height for mark in marks if mark.note == "tolerance"]
    assert tolerance == ([] if top == "0.5" else [pytest.approx(1 / float(top))])


# Work in a thread.


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
    def work(_progress: object) -> None:
        raise MemoryError

    faults: list[BaseException] = []
    with pytest.raises(MemoryError):
        begun(work, in_threads=in_threads, faults=faults).run()
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
