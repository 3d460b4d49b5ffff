# SPDX-License-Identifier: GPL-3.0-or-later
"""The scale of distances: the numbers beside the colours, and their heights."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

from .lengths import number_text

# The most steps of round numbers.
MOST_STEPS = 5

TOLERANCE = "tolerance"


@dataclass(frozen=True)
class Mark:
    """A number beside the scale, at a part of the height, and what the number is."""

    height: float
    number: str
    note: str = ""


def distance_marks(top: Decimal, tolerance: Decimal, gap: float) -> list[Mark]:
    """The marks of a scale up to ``top``, from the lowest on. gap: what a number takes, as a part of the height."""
    wanted = [(tolerance, TOLERANCE)] if tolerance <= top else []
    wanted += [(top, ""), *((number, "") for number in round_numbers(top))]
    marks: list[Mark] = []
    for number, note in wanted:
        height = float(number / top)
        if all(abs(height - other.height) >= gap for other in marks):
            marks.append(Mark(height, number_text(number), note))
    return sorted(marks, key=lambda mark: mark.height)


def round_numbers(top: Decimal) -> list[Decimal]:
    """Few numbers from 0 to ``top``, in steps of 1, 2 or 5 times a power of ten."""
    magnitude = Decimal(1).scaleb((top / MOST_STEPS).adjusted())
    step = next(factor * magnitude for factor in (1, 2, 5, 10) if factor * magnitude * MOST_STEPS >= top)
    return [index * step for index in range(int(top / step) + 1)]
