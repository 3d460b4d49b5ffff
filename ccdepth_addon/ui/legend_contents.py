# SPDX-License-Identifier: GPL-3.0-or-later
"""The contents of the legend, without references to Blender's data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal

import bpy

from ..state.colors import LAST_DEPTH, depth_colors
from ..state.heat_map import Shown, tolerance_of, top
from . import deviation_panel, panels
from .facts import faces_by_depth, lengths_text
from .lengths import DEGREES, DIGITS, Rounding, digits_within, in_unit, length_text, number_text, unit_for

Color = tuple[float, ...]

# Longer names are cut.
LONGEST_NAME = 20

# The height of a number beside a scale, as a part of the scale's.
NUMBER_HEIGHT = 0.1

# The most steps of round numbers beside a scale.
MOST_STEPS = 5

TOLERANCE = "tolerance"


@dataclass(frozen=True)
class Row:
    """A depth: its label, its number of faces, and its sRGB colour."""

    label: str
    faces: int
    color: Color


@dataclass(frozen=True)
class Mark:
    """A number beside the scale, at a part of the height, and what the number is."""

    height: float
    number: str
    note: str = ""


@dataclass(frozen=True)
class Legend:
    """notes: lines below the title. alert: a line in red. rows: the deepest depths first. marks: of a scale of
    distances. has_beyond: whether there are distances beyond the last colour."""

    title: str
    notes: list[str]
    alert: str = ""
    rows: list[Row] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)
    has_beyond: bool = False


def legend(scene: bpy.types.Scene, kind: Shown, objects: Sequence[bpy.types.Object]) -> Legend:
    """The legend of objects with values of a kind."""
    # The largest values by their tolerances.
    found: dict[float, float] = {}
    for mesh in {each.data for each in objects}:
        tolerance = tolerance_of(mesh, kind)
        found[tolerance] = max(found.get(tolerance, 0.0), _largest(mesh, kind))
    name = short_name(objects[0].name) if len(objects) == 1 else f"{len(objects):,} objects"
    alert = _alert(scene.ccdepth, kind, objects)
    if kind is Shown.DEPTH:
        notes = [f"for {lengths_text(scene, found)}", name]
        return Legend(kind.title, notes, alert, rows=depth_rows(objects))
    return _distances(scene, kind, found, Legend(kind.title, [name], alert))


def short_name(name: str) -> str:
    """The name, cut if long."""
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…"


def depth_rows(objects: Sequence[bpy.types.Object]) -> list[Row]:
    """A row for each colour of the objects' depths, the deepest first."""
    counts, faces = faces_by_depth(objects), dict[int, int]()
    for depth, number in counts.items():
        shown = min(depth, LAST_DEPTH)
        faces[shown] = faces.get(shown, 0) + number
    depths = sorted(faces, reverse=True)
    labels = [f"≥ {depth}" if depth == LAST_DEPTH < max(counts) else str(depth) for depth in depths]
    colors = map(tuple, depth_colors(depths).tolist())
    return [Row(label, faces[depth], color) for label, depth, color in zip(labels, depths, colors, strict=True)]


def _distances(scene: bpy.types.Scene, kind: Shown, found: Mapping[float, float], plain: Legend) -> Legend:
    """The legend with a scale, in parts of the tolerances if they differ and end the scale. found: by the tolerance,
    the largest distance."""
    largest = max(found.values())
    tops = {top(kind, tolerance, scene.ccdepth) for tolerance in found}
    fixed = DEGREES if kind is Shown.ANGLE else None
    unit = fixed or unit_for(scene, max(tops))
    digits = digits_within(scene, largest, max(found), unit)
    notes = [f"for {lengths_text(scene, found, digits, fixed)}", *plain.notes]
    if largest:
        notes.append(f"Largest {length_text(scene, largest, Rounding.UP, digits, fixed)}")
    if len(tops) == 1:
        [last] = tops
        ends, name = (in_unit(scene, last, unit), in_unit(scene, min(found), unit)), unit.name
    else:
        ends, name = (Decimal(100), Decimal(100)), "%"
    return Legend(
        f"{plain.title} ({name})" if name else plain.title,
        notes,
        plain.alert,
        marks=distance_marks(*ends, digits),
        has_beyond=any(length > top(kind, tolerance, scene.ccdepth) for tolerance, length in found.items()),
    )


def distance_marks(top: Decimal, tolerance: Decimal, digits: int = DIGITS) -> list[Mark]:
    """The marks of a scale up to ``top``, from the lowest on."""
    wanted = [(tolerance, TOLERANCE)] if tolerance <= top else []
    wanted += [(top, ""), *((number, "") for number in round_numbers(top))]
    marks: list[Mark] = []
    for number, note in wanted:
        height = float(number / top)
        if all(abs(height - other.height) >= NUMBER_HEIGHT for other in marks):
            marks.append(Mark(height, number_text(number, digits=digits), note))
    return sorted(marks, key=lambda mark: mark.height)


def round_numbers(top: Decimal) -> list[Decimal]:
    """Few numbers from 0 to ``top``, in steps of 1, 2 or 5 times a power of ten."""
    magnitude = Decimal(1).scaleb((top / MOST_STEPS).adjusted())
    step = next(factor * magnitude for factor in (1, 2, 5, 10) if factor * magnitude * MOST_STEPS >= top)
    return [index * step for index in range(int(top / step) + 1)]


def _largest(mesh: bpy.types.Mesh, kind: Shown) -> float:
    """The largest value of the kind on the mesh, from its record."""
    record = mesh.ccdepth
    if kind is Shown.ANGLE:
        return float(max(record.largest_shading_angle, record.largest_facet_angle))
    if kind is Shown.DEVIATION:
        return float(record.deviation)
    return float(record.largest_ratio * record.world_tolerance or record.largest_bound)


def _alert(settings: bpy.types.PropertyGroup, kind: Shown, objects: Sequence[bpy.types.Object]) -> str:
    if kind is Shown.DEVIATION:
        stale = [each.name for each in objects if deviation_panel.stale_line(settings, each.data)]
    else:
        stale = [each.name for each in objects if panels.stale_line(settings, each.data, each)]
    if not stale:
        return ""
    return f"Out of date: {short_name(stale[0]) if len(stale) == 1 else f'{len(stale)} of {len(objects)}'}"
