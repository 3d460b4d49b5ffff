# SPDX-License-Identifier: GPL-3.0-or-later
"""Lengths in the units of the scene, the scale of the legend, and work in a thread."""

from __future__ import annotations

import threading
from decimal import Decimal
from itertools import pairwise

import bpy
import pytest

from tests.blender import addon


@pytest.fixture
def units() -> bpy.types.UnitSettings:
    return bpy.context.scene.unit_settings


@pytest.mark.parametrize(
    ("system", "length_unit", "scale", "length", "text"),
    [
        ("METRIC", "METERS", 1.0, 0.0123, "0.0123 m"),
        ("METRIC", "METERS", 1.0, 1.23e-5, "12.3 µm"),
        ("METRIC", "MILLIMETERS", 1.0, 1.23e-5, "0.0123 mm"),
        ("METRIC", "MILLIMETERS", 0.001, 0.0123, "0.0123 mm"),
        ("METRIC", "ADAPTIVE", 1.0, 0.0123, "1.23 cm"),
        ("METRIC", "ADAPTIVE", 1.0, 1e-9, "0.001 µm"),
        ("METRIC", "METERS", 1.0, 0.0, "0 m"),
        ("IMPERIAL", "INCHES", 1.0, 0.0254, "1 in"),
        ("IMPERIAL", "FEET", 1.0, 2.54e-5, "1 thou"),
        ("NONE", "", 1.0, 12345.678, "12350"),
        ("NONE", "", 1.0, 1.23456e-9, "1.235e-9"),
    ],
)
def test_lengths(
    units: bpy.types.UnitSettings, system: str, length_unit: str, scale: float, length: float, text: str
) -> None:
    units.system, units.scale_length = system, scale
    if length_unit:
        units.length_unit = length_unit
    assert addon.module("ui.lengths").length_text(bpy.context.scene, length) == text


def test_rounding_keeps_a_bound_a_bound() -> None:
    lengths = addon.module("ui.lengths")
    texts = [
        lengths.length_text(bpy.context.scene, length, rounding)
        for length in (0.12340001, 0.12349999, 0.99999)
        for rounding in (lengths.Rounding.UP, lengths.Rounding.DOWN)
    ]
    assert texts == ["0.1235 m", "0.1234 m", "0.1235 m", "0.1234 m", "1 m", "0.9999 m"]


@pytest.mark.parametrize(
    ("length_unit", "lengths", "texts"),
    [
        # Alone, the one would be in metres and the other in micrometres.
        ("METERS", (0.00346, 0.00095), ["3.46 mm", "0.95 mm"]),
        ("METERS", (0.00095, 0.0), ["950 µm", "0 µm"]),
        ("METERS", (2.0, 0.00346), ["2 m", "0.00346 m"]),
        ("METERS", (2.0, 2e-6), ["2 m", "2 µm"]),
        ("MILLIMETERS", (2.0, 2e-6), ["2000 mm", "0.002 mm"]),
        ("ADAPTIVE", (0.0123, 0.00123), ["1.23 cm", "0.123 cm"]),
    ],
)
def test_neighbours_share_a_unit_that_serves_them_all(
    units: bpy.types.UnitSettings, length_unit: str, lengths: tuple[float, ...], texts: list[str]
) -> None:
    units.system, units.length_unit = "METRIC", length_unit
    module = addon.module("ui.lengths")
    for order in (1, -1):
        unit = module.common_unit(bpy.context.scene, lengths[::order])
        assert [module.length_text(bpy.context.scene, each, unit=unit) for each in lengths] == texts


@pytest.mark.parametrize("top", ["1", "0.0378", "2.5", "999", "4.9999", "1e-7"])
def test_round_numbers_are_few_and_reach_far(top: str) -> None:
    numbers = addon.module("ui.distance_scale").round_numbers(Decimal(top))
    assert 2 <= len(numbers) <= 6
    assert numbers[0] == 0
    step = numbers[1]
    assert step.as_tuple().digits in {(1,), (2,), (5,), (1, 0)}
    assert numbers[-1] <= Decimal(top) < numbers[-1] + step


@pytest.mark.parametrize("color_range", ["LARGEST", "TOLERANCE"])
@pytest.mark.parametrize("largest", [0.5, 1.0, 1.01, 2.0, 30.0])
def test_marks_have_room(color_range: str, largest: float) -> None:
    gap, module = 0.1, addon.module("ui.distance_scale")
    top = 1.0 if color_range == "TOLERANCE" else largest
    shown = module.distances(bpy.context.scene, top, 1.0, largest, color_range.lower())
    scale = module.distance_scale("Deviation", shown, gap)
    assert scale.title == "Deviation (m)"
    heights = [mark.label_height for mark in scale.marks]
    assert all(later - earlier > gap - 1e-9 for earlier, later in pairwise(heights))
    assert {mark.note for mark in scale.marks} >= {"tolerance", "largest"}
    assert scale.has_beyond == (color_range == "TOLERANCE" and largest > 1.0)
    (tolerance,) = (mark for mark in scale.marks if mark.note == "tolerance")
    assert tolerance.number == "1"
    assert tolerance.height == pytest.approx(1.0 if color_range == "TOLERANCE" else 1.0 / largest)


@pytest.mark.parametrize("color_range", ["LARGEST", "TOLERANCE", "FIXED"])
def test_what_is_within_the_tolerance_is_not_written_as_more(color_range: str) -> None:
    module = addon.module("ui.distance_scale")
    for tolerance, largest in ((0.011326, 0.011318), (0.0036389, 0.0036389), (0.5, 0.49999), (0.1, 0.10001)):
        top = {"LARGEST": largest, "TOLERANCE": tolerance, "FIXED": 1.0}[color_range]
        end = {"FIXED": ""}.get(color_range, color_range.lower())
        shown = module.distances(bpy.context.scene, top, tolerance, largest, end)
        scale = module.distance_scale("Proved Distance", shown, 0.05)
        written = {mark.note: Decimal(mark.number) for mark in scale.marks if mark.note}
        if len(written) == 2:
            assert (written["largest"] <= written["tolerance"]) == (largest <= tolerance)
        assert len(written) == 2 or color_range == "FIXED"


def test_work_in_a_thread_tells_its_progress_and_returns() -> None:
    worker, looked = addon.module("operators.worker"), threading.Event()

    def work(progress: object) -> str:
        progress(0.25)
        looked.wait(20.0)
        return threading.current_thread().name

    steps = worker.in_thread(work)
    fraction = next(steps)
    while fraction != 0.25:
        fraction = next(steps)
    looked.set()
    with pytest.raises(StopIteration) as ended:
        next(step for step in iter(lambda: next(steps), None) if step is None)
    assert ended.value.value != threading.current_thread().name


def test_what_work_in_a_thread_raises_arrives() -> None:
    def work(_progress: object) -> None:
        raise MemoryError

    with pytest.raises(MemoryError):
        list(addon.module("operators.worker").in_thread(work))


@pytest.mark.parametrize("stop", ["close", "stop_all"])
def test_work_in_a_thread_can_be_stopped(stop: str) -> None:
    worker, ended = addon.module("operators.worker"), []

    def work(progress: object) -> None:
        try:
            while True:
                progress(0.5)
        except worker.Cancelled:
            ended.append(True)
            raise

    steps = worker.in_thread(work)
    next(steps)
    if stop == "close":
        steps.close()
    worker.stop_all()
    assert ended == [True]
    if stop == "stop_all":
        with pytest.raises(worker.Cancelled):
            list(steps)


@pytest.mark.parametrize(
    ("bound", "tolerance", "text"),
    [
        # Rounded up it would seem to exceed the tolerance, which is rounded to the nearest.
        (377.52e-6, 377.53e-6, "377.5 µm"),
        (377.31e-6, 377.53e-6, "377.4 µm"),
        (377.54e-6, 377.53e-6, "377.6 µm"),
        (1.00004, 1.0, "1.001 m"),
    ],
)
def test_a_bound_within_the_tolerance_is_written_within_it(bound: float, tolerance: float, text: str) -> None:
    bpy.context.scene.unit_settings.system = "METRIC"
    module = addon.module("ui.lengths")
    unit = module.common_unit(bpy.context.scene, (bound, tolerance))
    assert module.bound_text(bpy.context.scene, bound, tolerance) == text
    assert module.bound_text(bpy.context.scene, bound, tolerance, unit) == text
