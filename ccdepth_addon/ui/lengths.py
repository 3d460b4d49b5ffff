# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts: lengths in the scene's units, with few digits, rounded so that bounds stay bounds; and names for terminals.

Names may hold anything, and a terminal obeys control characters.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from enum import Enum
from math import pi
from typing import NamedTuple

import bpy

from ..tasks.surfaces import shortest_decimal

DIGITS = 4

# A number below this fraction of the scene's unit is easier to read in a smaller one.
LEAST_IN_UNIT = Decimal("0.001")


class Rounding(Enum):
    """The side to round to: a proved distance is rounded up, a reached distance down."""

    NEAREST = ROUND_HALF_EVEN
    UP = ROUND_CEILING
    DOWN = ROUND_FLOOR


class Unit(NamedTuple):
    """The symbol of a unit, and its length in metres; the scene's own unit has no symbol."""

    name: str
    length: Decimal


PLAIN = Unit("", Decimal(1))

# For angles in radians, which have no scale.
DEGREES = Unit("°", Decimal(pi) / 180)

# Each from the largest to the smallest.
METRIC = {
    "KILOMETERS": Unit("km", Decimal(1000)),
    "METERS": Unit("m", Decimal(1)),
    "CENTIMETERS": Unit("cm", Decimal("0.01")),
    "MILLIMETERS": Unit("mm", Decimal("0.001")),
    "MICROMETERS": Unit("µm", Decimal("0.000001")),
}
IMPERIAL = {
    "MILES": Unit("mi", Decimal("1609.344")),
    "FEET": Unit("ft", Decimal("0.3048")),
    "INCHES": Unit("in", Decimal("0.0254")),
    "THOU": Unit("thou", Decimal("0.0000254")),
}
SYSTEMS = {"METRIC": METRIC, "IMPERIAL": IMPERIAL}


def unit_for(scene: bpy.types.Scene, length: float) -> Unit:
    """The unit for a length of the scene: the scene's unit, or a smaller unit to avoid a row of zeros."""
    units = SYSTEMS.get(scene.unit_settings.system)
    if units is None:
        return PLAIN
    wanted = units.get(scene.unit_settings.length_unit)
    return wanted if wanted is not None and _is_readable(scene, length, wanted) else _natural_unit(scene, length, units)


def common_unit(scene: bpy.types.Scene, lengths: Iterable[float]) -> Unit | None:
    """One unit for lengths beside each other; None if each needs its own, as one of them would be a row of zeros."""
    units, found = SYSTEMS.get(scene.unit_settings.system), [*lengths]
    if units is None:
        return PLAIN
    largest = max(found)
    for unit in (unit_for(scene, largest), _natural_unit(scene, largest, units)):
        if all(_is_readable(scene, each, unit) for each in found):
            return unit
    return None


def _is_readable(scene: bpy.types.Scene, length: float, unit: Unit) -> bool:
    return not length or in_unit(scene, length, unit) >= LEAST_IN_UNIT


def _natural_unit(scene: bpy.types.Scene, length: float, units: dict[str, Unit]) -> Unit:
    """The largest unit that goes into the length, or else the smallest."""
    *others, smallest = units.values()
    return next((unit for unit in others if _metres(scene, length) >= unit.length), smallest)


def length_text(
    scene: bpy.types.Scene,
    length: float,
    rounding: Rounding = Rounding.NEAREST,
    digits: int = DIGITS,
    unit: Unit | None = None,
) -> str:
    """A length of the scene with its unit, to some significant digits. unit: None for the unit that suits the
    length."""
    chosen = unit or unit_for(scene, length)
    number = number_text(in_unit(scene, length, chosen), rounding, digits)
    return f"{number}{'' if chosen in (PLAIN, DEGREES) else ' '}{chosen.name}"


def bound_texts(scene: bpy.types.Scene, bound: float, tolerance: float, unit: Unit | None = None) -> tuple[str, str]:
    """A proved distance, rounded up, and the tolerance; a distance within the tolerance is never written as more than
    the tolerance."""
    digits = digits_within(scene, bound, tolerance, unit)
    return length_text(scene, bound, Rounding.UP, digits, unit), length_text(scene, tolerance, digits=digits, unit=unit)


def digits_within(scene: bpy.types.Scene, bound: float, tolerance: float, unit: Unit | None = None) -> int:
    """``enough_digits`` of lengths in the scene. unit: None for the unit that suits the tolerance."""
    compared = unit or unit_for(scene, tolerance)
    return enough_digits(in_unit(scene, bound, compared), in_unit(scene, tolerance, compared))


def enough_digits(bound: Decimal, tolerance: Decimal) -> int:
    """The significant digits with which a bound within the tolerance, rounded up, is not more than the tolerance."""
    digits = DIGITS
    while bound <= tolerance and Decimal(number_text(bound, Rounding.UP, digits)) > Decimal(
        number_text(tolerance, digits=digits)
    ):
        digits += 1
    return digits


def in_unit(scene: bpy.types.Scene, length: float, unit: Unit) -> Decimal:
    """A length of the scene as a multiple of the unit."""
    return Decimal(str(length)) / unit.length if unit in (PLAIN, DEGREES) else _metres(scene, length) / unit.length


def number_text(number: Decimal, rounding: Rounding = Rounding.NEAREST, digits: int = DIGITS) -> str:
    """A number as text, to some significant digits."""
    if not number:
        return "0"
    rounded = number.quantize(Decimal(1).scaleb(number.adjusted() - digits + 1), rounding=rounding.value)
    if not -5 <= rounded.adjusted() <= 9:
        return f"{rounded.normalize():e}"
    text = f"{rounded:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _metres(scene: bpy.types.Scene, length: float) -> Decimal:
    # Blender keeps the scale in single precision.
    return Decimal(str(length)) * Decimal(str(shortest_decimal(scene.unit_settings.scale_length)))


def count_text(number: int, one: str, many: str) -> str:
    return f"{number:,} {one if number == 1 else many}"


# Controls, invisible marks that reorder text, halves of characters, and separators of lines and paragraphs.
ESCAPED_CATEGORIES = {"Cc", "Cf", "Cs", "Zl", "Zp"}

# The characters that join the parts of letters and pictures.
JOINERS = {"\u200c", "\u200d"}


def printable(text: str) -> str:
    """The text with every control character as its escape sequence in Python."""
    return "".join(map(_printable, text))


def printable_lines(text: str) -> str:
    """A text of several lines with every control character in a line as its escape sequence."""
    return "\n".join(map(printable, text.split("\n")))


def _printable(character: str) -> str:
    if unicodedata.category(character) not in ESCAPED_CATEGORIES or character in JOINERS:
        return character
    return character.encode("unicode_escape", errors="backslashreplace").decode()
