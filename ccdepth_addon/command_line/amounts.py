# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances, units and numbers as typed."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Callable
from dataclasses import dataclass
from math import inf, nan, nextafter, radians

from ..ui.lengths import IMPERIAL, METRIC

# The length of each unit in metres, by its symbol.
UNITS = {unit.name: float(unit.length) for unit in (*METRIC.values(), *IMPERIAL.values())}
UNITS["um"] = UNITS["µm"]

# Blender's integers have 32 bits.
LARGEST_FACE_COUNT = 2**31 - 1

# The least number greater than zero.
LEAST = nextafter(0.0, inf)

MULTIPLES = {"": 1, "k": 1_000, "m": 1_000_000}

# The longest symbols first: "mm" is not "m".
_WITH_UNIT = re.compile(rf"(.*?)\s*({'|'.join(sorted(UNITS, key=len, reverse=True))}|%|px)")


@dataclass(frozen=True)
class TypedTolerance:
    """A tolerance as typed. text: as typed. value: the number, for percents a fraction. unit: in metres, if the
    tolerance has one. mode: ABSOLUTE, RELATIVE or PIXELS if the text says so."""

    text: str
    value: float
    unit: float | None = None
    mode: str | None = None

    def __str__(self) -> str:
        return self.text

    def in_scene(self, metres_per_unit: float) -> float:
        """The number for a scene with a given length of the unit."""
        return self.value if self.unit is None else self.value * self.unit / metres_per_unit


def typed_tolerance(text: str) -> TypedTolerance:
    """A tolerance from 0.1mm, 0.01in, 0.1%, 0.5px or a bare number. Raises ArgumentTypeError."""
    found = _WITH_UNIT.fullmatch(text.strip())
    number, unit = found.groups() if found else (text, None)
    try:
        value = float(number)
    except ValueError as fault:
        raise ArgumentTypeError(
            f"“{text}” is not a tolerance: give a number, a length like 0.1mm or 0.01in, a part like 0.1%, or "
            "pixels like 0.5px"
        ) from fault
    if not 0 < value < inf:
        raise ArgumentTypeError(f"a tolerance is a finite number greater than zero, and “{text}” is not")
    if unit is None:
        return TypedTolerance(text, value)
    if unit == "%":
        return TypedTolerance(text, value / 100, mode="RELATIVE")
    if unit == "px":
        return TypedTolerance(text, value, mode="PIXELS")
    return TypedTolerance(text, value, UNITS[unit], "ABSOLUTE")


def face_limit(text: str) -> int:
    """A number of faces that Blender can hold. Raises ValueError and ArgumentTypeError."""
    limit = int(text)
    if not 1 <= limit <= LARGEST_FACE_COUNT:
        raise ArgumentTypeError(f"{limit} is not between 1 and {LARGEST_FACE_COUNT:,}")
    return limit


def face_budget(text: str) -> int:
    """A number of faces from 50k, 1.5M or 50000. Raises ArgumentTypeError."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([km]?)", text.strip().lower())
    faces = float(found[1]) * MULTIPLES[found[2]] if found else 0.0
    if not 1 <= faces <= LARGEST_FACE_COUNT:
        raise ArgumentTypeError(f"“{text}” is not a number of faces: give one like 50000, 50k or 1.5M")
    return round(faces)


def angle(text: str) -> float:
    """An angle in radians, from degrees. Raises ArgumentTypeError."""
    degrees = number_from("of degrees", 0.0)(text)
    if degrees >= 90:
        raise ArgumentTypeError(f"an angle must be less than 90°, and “{text}” is not")
    return radians(degrees)


def whole_number(text: str) -> int:
    """A whole number, such as a number of processes. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise ArgumentTypeError(f"“{text}” is not a whole number of at least 1")
    return int(text)


def number_from(kind: str, least: float) -> Callable[[str], float]:
    """A reader of finite numbers of at least a least one; refusals call the number by a name."""

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = nan
        if not least <= value < inf:
            raise ArgumentTypeError(f"“{text}” is not a number {kind}")
        return value

    return number
