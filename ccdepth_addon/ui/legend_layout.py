# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of a legend: pure functions of what it says, of the room there is, and of the interface's scale.

A legend stands as a column or lies down as a strip. The first layout that has room is taken, from the largest on;
rows are left out last of all, and first those that fewest faces have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import NamedTuple

from .distance_scale import Mark, Scale

Color = tuple[float, ...]

# The width of a text in a font of that size, both in pixels.
Measure = Callable[[str, float], float]

# Lengths in pixels at an interface scale of 1.
FONT_SIZE = 11
LINE_HEIGHT = 18
MARGIN = 14
PADDING = 8
SWATCH_WIDTH = 18
COLUMN_GAP = 12
SCALE_HEIGHT = 180
TICK_WIDTH = 5

# How far a legend shrinks where there is no room for it.
SIZES = (1.0, 0.85, 0.7)

# It never takes more of the region than this.
LARGEST_PART = 1 / 3


class Style(Enum):
    """How a text is written."""

    TEXT = "text"
    HEADING = "heading"
    ALERT = "alert"


class Rectangle(NamedTuple):
    """In pixels of the region, from its left bottom corner."""

    left: float
    bottom: float
    right: float
    top: float

    def overlaps(self, other: Rectangle) -> bool:
        return (
            self.left < other.right and other.left < self.right and self.bottom < other.top and other.bottom < self.top
        )


@dataclass(frozen=True)
class Row:
    """A depth, or several that share a colour or a line: what is written, how many faces, and the sRGB colour."""

    label: str
    faces: int
    color: Color | None


@dataclass(frozen=True)
class Legend:
    """What a legend says.

    tolerance: what follows the title, in its line or the next one; it is never left out. notes: lines below. alert: one
    more, in red. rows: the deepest depths first. scale: of distances, for a label that takes that part of its height.
    objects: names and numbers.
    """

    title: str
    tolerance: str = ""
    notes: list[str] = field(default_factory=list)
    alert: str = ""
    rows: list[Row] = field(default_factory=list)
    scale: Callable[[float], Scale] | None = None
    objects: list[tuple[str, str]] = field(default_factory=list)


@dataclass(frozen=True)
class PlacedText:
    """A text whose left end, or right end, is at x, on the base line y."""

    text: str
    x: float
    y: float
    style: Style = Style.TEXT
    ends_there: bool = False


@dataclass
class Layout:
    """A legend laid out, from its left bottom corner.

    swatches: rectangles of one colour. ramp: the rectangle of all colours of the scale, which go the longer way. ticks:
    rectangles in the colour of text.
    """

    font_size: float
    width: float
    height: float = 0.0
    texts: list[PlacedText] = field(default_factory=list)
    swatches: list[tuple[Rectangle, Color]] = field(default_factory=list)
    ramp: Rectangle | None = None
    ticks: list[Rectangle] = field(default_factory=list)


class Lengths(NamedTuple):
    """The lengths above at some scale, and the measure of texts in their font."""

    font: float
    line: int
    padding: int
    gap: int
    swatch: int
    bar: int
    tick: int
    width: Callable[[str], float]


def lengths(scale: float, measure: Measure) -> Lengths:
    """Lengths at this scale."""
    font = FONT_SIZE * scale
    return Lengths(
        font=font,
        line=round(LINE_HEIGHT * scale),
        padding=round(PADDING * scale),
        gap=round(COLUMN_GAP * scale),
        swatch=round(SWATCH_WIDTH * scale),
        bar=round(SCALE_HEIGHT * scale),
        tick=round(TICK_WIDTH * scale),
        width=lambda text: measure(text, font) if text else 0.0,
    )


@dataclass(frozen=True)
class Room:
    """A region of the window: its width and height, what may not be covered, and what had better not be."""

    size: tuple[int, int]
    obstacles: Sequence[Rectangle]
    avoided: Sequence[Rectangle] = ()


def placed(
    legend: Legend, room: Room, scale: float, measure: Measure, beyond: Color
) -> tuple[Layout, Rectangle] | None:
    """The best layout that there is room for, and where; None when there is none.

    scale: the interface's. beyond: the colour of what is beyond a scale of distances.
    """
    largest, margin = LARGEST_PART * room.size[0] * room.size[1], round(MARGIN * scale)
    for layouts in (_whole_layouts, _shortened_layouts):
        found = [each for each in layouts(legend, scale, measure, beyond) if each.width * each.height <= largest]
        # Something is covered before a row is left out.
        for obstacles in ([*room.obstacles, *room.avoided], room.obstacles):
            for layout in found:
                place = free_place(layout.width, layout.height, room.size, obstacles, margin)
                if place is not None:
                    return layout, place
    return None


def free_place(
    width: float, height: float, region: tuple[int, int], obstacles: Sequence[Rectangle], margin: int
) -> Rectangle | None:
    """Where there is room for a rectangle, as far down and then as far to the right as can be; None when there is
    none."""
    rights = {region[0] - margin, *(each.left - margin for each in obstacles)}
    bottoms = {margin, *(each.top + margin for each in obstacles)}
    for bottom in sorted(bottoms):
        for right in sorted(rights, reverse=True):
            place = Rectangle(right - width, bottom, right, bottom + height)
            is_inside = place.left >= margin and bottom >= margin and right <= region[0] - margin
            if is_inside and place.top <= region[1] - margin and not any(map(place.overlaps, obstacles)):
                return place
    return None


def _whole_layouts(legend: Legend, scale: float, measure: Measure, beyond: Color) -> Iterator[Layout]:
    """Those with all rows, from the best to the least."""
    alone = replace(legend, objects=[])
    for size in SIZES:
        at = lengths(scale * size, measure)
        if legend.objects:
            yield _column(legend, at, beyond)
        yield _column(alone, at, beyond)
        yield _strip(alone, at, beyond)
    yield from _short_layouts(alone, at, beyond)


def _shortened_layouts(legend: Legend, scale: float, measure: Measure, beyond: Color) -> Iterator[Layout]:
    """Those that count some rows together, from the best to the least."""
    at = lengths(scale * SIZES[-1], measure)
    # One row takes as much room as the one that would count it among others.
    for kept in range(len(legend.rows) - 2, 0, -1):
        shorter = replace(legend, rows=most_rows(legend.rows, kept), objects=[])
        yield from _short_layouts(shorter, at, beyond)


def _short_layouts(legend: Legend, at: Lengths, beyond: Color) -> Iterator[Layout]:
    """Those without notes, and the last of them without the title."""
    short = replace(legend, notes=[])
    yield _column(short, at, beyond)
    yield _strip(short, at, beyond)
    if legend.tolerance:
        yield _column(replace(short, title=legend.tolerance, tolerance=""), at, beyond)


def most_rows(rows: list[Row], kept: int) -> list[Row]:
    """Those rows that most faces have, in their order, and one that counts the rest."""
    if kept >= len(rows):
        return rows
    chosen = sorted(range(len(rows)), key=lambda index: rows[index].faces, reverse=True)[:kept]
    rest = sum(row.faces for index, row in enumerate(rows) if index not in chosen)
    return [*(rows[index] for index in sorted(chosen)), Row("Other", rest, None)]


def _column(legend: Legend, at: Lengths, beyond: Color) -> Layout:
    """Everything below each other; laid out from the bottom upwards."""
    scale = None if legend.scale is None else legend.scale(at.line / at.bar)
    lines = [(legend.title if scale is None else scale.title, Style.TEXT)]
    lines += [(legend.tolerance, Style.TEXT)] if legend.tolerance else []
    lines += [(note, Style.HEADING) for note in legend.notes]
    lines += [(legend.alert, Style.ALERT)] if legend.alert else []
    widths = [at.width(text) for text, _ in lines]
    widths += [at.width(name) + at.gap + at.width(number) for name, number in legend.objects]
    widths.append(_width_of_rows(legend.rows, at) if scale is None else _width_of_scale(scale, at))
    layout = Layout(at.font, max(widths) + 2 * at.padding)
    base = _add_objects(layout, legend.objects, at.padding, at)
    base = _add_rows(layout, legend.rows, base, at) if scale is None else _add_scale(layout, scale, base, at, beyond)
    for text, style in reversed(lines):
        layout.texts.append(PlacedText(text, at.padding, base + _up(at), style))
        base += at.line
    layout.height = base + at.padding
    return layout


def _up(at: Lengths) -> int:
    """How far a base line is above the lower end of its line."""
    return round(0.3 * at.line)


def _add_objects(layout: Layout, objects: list[tuple[str, str]], base: int, at: Lengths) -> int:
    """A line for each; returns where the next line begins."""
    for name, number in reversed(objects):
        layout.texts.append(PlacedText(name, at.padding, base + _up(at), Style.HEADING))
        layout.texts.append(PlacedText(number, layout.width - at.padding, base + _up(at), ends_there=True))
        base += at.line
    return base + at.line // 2 if objects else base


def _width_of_rows(rows: list[Row], at: Lengths) -> float:
    faces = max(at.width(text) for text in ["Faces", *(f"{row.faces:,}" for row in rows)])
    return at.swatch + 2 * at.gap + _width_of_labels(rows, at) + faces


def _width_of_labels(rows: list[Row], at: Lengths) -> float:
    return max(at.width(text) for text in ["Depth", *(row.label for row in rows)])


def _add_rows(layout: Layout, rows: list[Row], base: int, at: Lengths) -> int:
    """Swatches, depths and faces, and above them what they are; returns where the next line begins."""
    depth_end = at.padding + at.swatch + at.gap + _width_of_labels(rows, at)
    faces_end = layout.width - at.padding
    for row in reversed(rows):
        if row.color is not None:
            place = Rectangle(at.padding, base, at.padding + at.swatch, base + at.line)
            layout.swatches.append((place, row.color))
        layout.texts.append(PlacedText(row.label, depth_end, base + _up(at), ends_there=True))
        layout.texts.append(PlacedText(f"{row.faces:,}", faces_end, base + _up(at), ends_there=True))
        base += at.line
    for text, end in (("Depth", depth_end), ("Faces", faces_end)):
        layout.texts.append(PlacedText(text, end, base + _up(at), Style.HEADING, ends_there=True))
    return base + at.line


def _width_of_scale(scale: Scale, at: Lengths) -> float:
    numbers = max(at.width(mark.number) for mark in scale.marks)
    notes = max(at.width(mark.note) for mark in scale.marks)
    return at.swatch + numbers + notes + 2 * at.gap


def _add_scale(layout: Layout, scale: Scale, base: int, at: Lengths, beyond: Color) -> int:
    """The colours as a bar, with numbers on its right and what they are beside them; returns where the next line
    begins."""
    bottom = base + at.line // 2
    layout.ramp = Rectangle(at.padding, bottom, at.padding + at.swatch, bottom + at.bar)
    numbers_end = layout.ramp.right + at.gap + max(at.width(mark.number) for mark in scale.marks)
    for mark in scale.marks:
        if mark.height <= 1.0:
            # The tolerance is marked across the whole bar.
            left = layout.ramp.left if mark.note == "tolerance" else layout.ramp.right
            y = bottom + round(mark.height * at.bar)
            layout.ticks.append(Rectangle(left, y - 1, layout.ramp.right + at.tick, y + 1))
        y = bottom + round(mark.label_height * at.bar) - round(0.2 * at.line)
        layout.texts.append(PlacedText(mark.number, numbers_end, y, ends_there=True))
        layout.texts.append(PlacedText(mark.note, numbers_end + at.gap // 2, y, Style.HEADING))
    highest = bottom + round(max(1.0, scale.marks[-1].label_height) * at.bar) + at.line // 2
    if scale.has_beyond:
        layout.swatches.append((Rectangle(at.padding, highest - at.line, layout.ramp.right, highest), beyond))
    return highest


def _strip(legend: Legend, at: Lengths, beyond: Color) -> Layout:
    """The title and the notes in one line, and below it the colours beside each other, with their numbers below."""
    scale = None if legend.scale is None else legend.scale(at.line / at.bar)
    first = [f"{legend.title} {legend.tolerance}"] if scale is None else [scale.title, *_tolerance_beside_end(scale)]
    title = " · ".join([*first, *legend.notes])
    alert_left = at.padding + at.width(title) + at.gap
    layout = Layout(at.font, alert_left + at.width(legend.alert) + at.padding, 3 * at.line + 2 * at.padding)
    if scale is None:
        _add_cells(layout, legend.rows, at)
    else:
        _add_lying_scale(layout, scale, at, beyond)
    base = at.padding + 2 * at.line + _up(at)
    layout.texts.append(PlacedText(title, at.padding, base))
    layout.texts.append(PlacedText(legend.alert, alert_left, base, Style.ALERT))
    return layout


def _end(scale: Scale) -> Mark:
    """The mark of the last colour."""
    return next(mark for mark in scale.marks if mark.height == mark.label_height == 1.0)


def _tolerance_beside_end(scale: Scale) -> list[str]:
    """The tolerance in words, unless the last colour, whose number a lying scale has, is for it."""
    end = _end(scale)
    return [f"Tolerance {mark.number}" for mark in scale.marks if mark.note == "tolerance" and mark != end]


def _add_cells(layout: Layout, rows: list[Row], at: Lengths) -> None:
    """A cell for each row, the least depth first: its swatch and its depth, and below them its faces."""
    lower, upper = at.padding, at.padding + at.line
    layout.texts.append(PlacedText("Depth", at.padding, upper + _up(at), Style.HEADING))
    layout.texts.append(PlacedText("Faces", at.padding, lower + _up(at), Style.HEADING))
    left = at.padding + max(at.width("Depth"), at.width("Faces")) + at.gap
    for row in reversed(rows):
        label_left = left
        if row.color is not None:
            layout.swatches.append((Rectangle(left, upper, left + at.swatch, upper + at.line), row.color))
            label_left += at.swatch + at.gap // 2
        layout.texts.append(PlacedText(row.label, label_left, upper + _up(at)))
        layout.texts.append(PlacedText(f"{row.faces:,}", left, lower + _up(at)))
        left = max(label_left + at.width(row.label), left + at.width(f"{row.faces:,}")) + at.gap
    layout.width = max(layout.width, left - at.gap + at.padding)


def _add_lying_scale(layout: Layout, scale: Scale, at: Lengths, beyond: Color) -> None:
    """The colours from the left to the right, with the numbers at both ends, and the tolerance marked."""
    lower, upper = at.padding, at.padding + at.line
    ramp = layout.ramp = Rectangle(at.padding, upper, at.padding + at.bar, upper + at.line)
    first, last = scale.marks[0], _end(scale)
    layout.texts.append(PlacedText(first.number, ramp.left, lower + _up(at)))
    layout.texts.append(PlacedText(f"{last.number} {last.note}".strip(), ramp.right, lower + _up(at), ends_there=True))
    for mark in scale.marks:
        if mark.note == "tolerance" and mark.height <= 1.0:
            x = ramp.left + round(mark.height * at.bar)
            layout.ticks.append(Rectangle(x - 1, upper, x + 1, upper + at.line))
    right = ramp.right
    if scale.has_beyond:
        right = ramp.right + at.gap // 2 + at.swatch
        layout.swatches.append((Rectangle(right - at.swatch, upper, right, upper + at.line), beyond))
    layout.width = max(layout.width, right + at.padding)
