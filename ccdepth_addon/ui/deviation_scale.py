# SPDX-License-Identifier: GPL-3.0-or-later
"""The scale of deviations: which numbers stand beside its colours, and where."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

import bpy

from ..state.deviation_results import color_top
from .lengths import Rounding, in_unit, number_text, unit_for

# The most steps of round numbers.
MOST_STEPS = 5


@dataclass(frozen=True)
class Mark:
    """A number beside the scale. Heights are parts of the scale's own.

    height: where it belongs; above 1, beyond the scale. label_height: where there is room for it. note: what it is.
    """

    height: float
    label_height: float
    number: str
    note: str = ""


@dataclass(frozen=True)
class Scale:
    """title: what is shown, with its unit. marks: from the lowest to the highest. has_beyond: whether there are
    deviations beyond the last colour."""

    title: str
    marks: list[Mark]
    has_beyond: bool


def deviation_scale(scene: bpy.types.Scene, record: bpy.types.PropertyGroup, gap: float) -> Scale:
    """The scale of the deviations on a mesh. gap: what a label takes, as a part of the scale's height."""
    color_range, found = scene.ccdepth.deviation_range, record.measurement
    unit = unit_for(scene, color_top(record, color_range))
    top, tolerance, largest = (
        in_unit(scene, length, unit)
        for length in (color_top(record, color_range), found.world_tolerance, found.largest_shown)
    )
    tolerance_text = number_text(tolerance, Rounding.NEAREST, 3)
    largest_text = number_text(largest, Rounding.UP, 3)
    if color_range == "TOLERANCE":
        marks = [Mark(1.0, 1.0, tolerance_text, "tolerance"), _other_mark(largest / top, largest_text, "largest", gap)]
    else:
        marks = [
            Mark(1.0, 1.0, largest_text, "largest"),
            _other_mark(tolerance / top, tolerance_text, "tolerance", gap),
        ]
    for number in round_numbers(top):
        height = float(number / top)
        if all(abs(height - mark.label_height) >= gap for mark in marks):
            marks.append(Mark(height, height, f"{number:f}"))
    title = f"Deviation ({unit.name})" if unit.name else "Deviation"
    return Scale(title, sorted(marks, key=lambda mark: mark.label_height), bool(largest > top))


def _other_mark(height: Decimal, number: str, note: str, gap: float) -> Mark:
    """A mark that shares the scale with the one at its end."""
    if height > 1:
        return Mark(float(height), 1.0 + 1.5 * gap, number, note)
    return Mark(float(height), min(float(height), 1.0 - gap), number, note)


def round_numbers(top: Decimal) -> list[Decimal]:
    """Few numbers from 0 to ``top``, in steps of 1, 2 or 5 times a power of ten."""
    magnitude = Decimal(1).scaleb((top / MOST_STEPS).adjusted())
    step = next(factor * magnitude for factor in (1, 2, 5, 10) if factor * magnitude * MOST_STEPS >= top)
    return [index * step for index in range(int(top / step) + 1)]
