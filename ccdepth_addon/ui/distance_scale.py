# SPDX-License-Identifier: GPL-3.0-or-later
"""The scale of distances: which numbers stand beside its colours, and where."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

import bpy

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
    distances beyond the last colour."""

    title: str
    marks: list[Mark]
    has_beyond: bool


@dataclass(frozen=True)
class Distances:
    """What a scale is about, in this unit.

    end: which of the others has the last colour, ``tolerance`` or ``largest``, or neither.
    """

    top: Decimal
    tolerance: Decimal
    largest: Decimal
    end: str
    unit: str = ""


def distances(scene: bpy.types.Scene, top: float, tolerance: float, largest: float, end: str) -> Distances:
    """Distances of the scene in a unit that suits them."""
    unit = unit_for(scene, top)
    in_it = [in_unit(scene, each, unit) for each in (top, tolerance, largest)]
    return Distances(in_it[0], in_it[1], in_it[2], end, unit.name)


def distance_scale(title: str, shown: Distances, gap: float) -> Scale:
    """The scale of distances on a mesh. gap: what a label takes, as a part of the scale's height."""
    top, tolerance, largest = shown.top, shown.tolerance, shown.largest
    texts = _texts(tolerance, largest)
    numbers = {"tolerance": (tolerance, texts[0]), "largest": (largest, texts[1])}
    end = numbers[shown.end][1] if shown.end in numbers else number_text(top, Rounding.NEAREST, 3)
    marks = [Mark(1.0, 1.0, end, shown.end)]
    for note, (length, text) in numbers.items():
        if note != shown.end:
            _add_where_there_is_room(marks, _other_mark(length / top, text, note, gap), gap)
    for number in round_numbers(top):
        _add_where_there_is_room(marks, Mark(float(number / top), float(number / top), f"{number:f}"), gap)
    return Scale(
        f"{title} ({shown.unit})" if shown.unit else title,
        sorted(marks, key=lambda mark: mark.label_height),
        bool(largest > top),
    )


def _texts(tolerance: Decimal, largest: Decimal) -> tuple[str, str]:
    """The two numbers, the second rounded up, with enough digits that rounding does not put it above the first."""
    for digits in range(3, 9):
        texts = number_text(tolerance, Rounding.NEAREST, digits), number_text(largest, Rounding.UP, digits)
        if (largest <= tolerance) == (Decimal(texts[1]) <= Decimal(texts[0])):
            break
    return texts


def relative_scale(title: str, end: str, gap: float, *, has_beyond: bool) -> Scale:
    """The scale of distances on meshes with scales of their own: in parts of what has the last colour on each."""
    marks = [Mark(1.0, 1.0, "100 %", end)]
    for percent in (0, 20, 40, 60, 80):
        _add_where_there_is_room(marks, Mark(percent / 100, percent / 100, f"{percent} %"), gap)
    return Scale(title, sorted(marks, key=lambda mark: mark.label_height), has_beyond)


def _add_where_there_is_room(marks: list[Mark], mark: Mark, gap: float) -> None:
    # A mark may be moved by just the gap.
    if all(abs(mark.label_height - other.label_height) >= gap * (1 - 1e-9) for other in marks):
        marks.append(mark)


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
