# SPDX-License-Identifier: GPL-3.0-or-later
"""The layout of a legend as a column: pure functions of the legend, the room, and the interface's scale."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..state.colors import BEYOND, scale_colors
from .legend_contents import TOLERANCE, Color, Legend

# The width of a text in a font of that size, both in pixels.
Measure = Callable[[str, float], float]

# Lengths in pixels at an interface scale of 1.
FONT_SIZE = 11
LINE_HEIGHT = 18
MARGIN = 14
PADDING = 8
SWATCH_WIDTH = 18
GAP = 12
SCALE_HEIGHT = 180
TICK_WIDTH = 5

# The number of colours of the scale, with halves and quarters among them.
SCALE_STEPS = 101


class Style(Enum):
    """The style of a text."""

    TEXT = "text"
    HEADING = "heading"
    ALERT = "alert"


class Rectangle(NamedTuple):
    """A rectangle in pixels of the region, from the region's left bottom corner."""

    left: float
    bottom: float
    right: float
    top: float


class PlacedText(NamedTuple):
    """A text whose left end, or right end, is at x, on the base line y."""

    text: str
    x: float
    y: float
    style: Style = Style.TEXT
    ends_there: bool = False


@dataclass
class Layout:
    """A legend laid out, from its left bottom corner.

    swatches: rectangles of one colour each, the scale's from below. ticks: rectangles in the colour of text.
    """

    size: float
    width: float = 0.0
    height: float = 0.0
    texts: list[PlacedText] = field(default_factory=list)
    swatches: list[tuple[Rectangle, Color]] = field(default_factory=list)
    ticks: list[Rectangle] = field(default_factory=list)

    @property
    def font_size(self) -> float:
        return FONT_SIZE * self.size

    def pixels(self, length: float) -> int:
        """A length at an interface scale of 1 as pixels."""
        return round(length * self.size)

    def write(self, text: str, x: float, line_bottom: float, style: Style = Style.TEXT, *, ends: bool = False) -> None:
        """Add a text in a line with a given lower end."""
        self.texts.append(PlacedText(text, x, line_bottom + self.pixels(0.3 * LINE_HEIGHT), style, ends))


def placed(
    legend: Legend, region: tuple[int, int], covered: tuple[int, int], scale: float, measure: Measure
) -> tuple[Layout, Rectangle] | None:
    """The layout in the lower right corner of a region, and its place; None without room. covered: the width at the
    right and the height at the bottom that other regions cover. scale: the interface's."""
    layout, margin = column(legend, scale, measure), round(MARGIN * scale)
    right, bottom = region[0] - covered[0] - margin, covered[1] + margin
    place = Rectangle(right - layout.width, bottom, right, bottom + layout.height)
    return (layout, place) if place.left >= margin and place.top <= region[1] - margin else None


def column(legend: Legend, size: float, measure: Measure) -> Layout:
    """The layout with all lines below each other, at a size; made from the bottom upwards."""
    layout = Layout(size)
    lines = [(legend.title, Style.TEXT), *((note, Style.HEADING) for note in legend.notes)]
    lines += [(legend.alert, Style.ALERT)] if legend.alert else []

    def width(text: str) -> float:
        return measure(text, layout.font_size)

    least = max(width(text) for text, _ in lines)
    base = _add_rows(layout, legend, least, width) if legend.marks is None else _add_scale(layout, legend, least, width)
    padding, line = layout.pixels(PADDING), layout.pixels(LINE_HEIGHT)
    for text, style in reversed(lines):
        layout.write(text, padding, base, style)
        base += line
    layout.height = base + padding
    return layout


def _add_rows(layout: Layout, legend: Legend, least: float, width: Callable[[str], float]) -> int:
    """Add swatches, depths and faces below their headings; returns where the next line begins."""
    padding, line, swatch, gap = map(layout.pixels, (PADDING, LINE_HEIGHT, SWATCH_WIDTH, GAP))
    rows = [(row.label, f"{row.faces:,}", row.color) for row in legend.rows]
    labels = max(width(text) for text in ["Depth", *(label for label, _, _ in rows)])
    faces = max(width(text) for text in ["Faces", *(number for _, number, _ in rows)])
    label_end = padding + swatch + gap + labels
    layout.width = max(least + 2 * padding, label_end + gap + faces + padding)
    base = padding
    for label, number, color in reversed(rows):
        layout.swatches.append((Rectangle(padding, base, padding + swatch, base + line), color))
        layout.write(label, label_end, base, ends=True)
        layout.write(number, layout.width - padding, base, ends=True)
        base += line
    layout.write("Depth", label_end, base, Style.HEADING, ends=True)
    layout.write("Faces", layout.width - padding, base, Style.HEADING, ends=True)
    return base + line


def _add_scale(layout: Layout, legend: Legend, least: float, width: Callable[[str], float]) -> int:
    """Add the colours as a bar, with numbers on the right; returns where the next line begins."""
    assert legend.marks is not None
    padding, line, swatch, gap = map(layout.pixels, (PADDING, LINE_HEIGHT, SWATCH_WIDTH, GAP))
    bar, tick = layout.pixels(SCALE_HEIGHT), layout.pixels(TICK_WIDTH)
    marks = legend.marks(line / bar)
    left, right, bottom = padding, padding + swatch, padding + line // 2
    numbers_end = right + gap + max(width(mark.number) for mark in marks)
    notes = max(width(mark.note) for mark in marks)
    layout.width = max(least + 2 * padding, numbers_end + gap // 2 + notes + padding)
    steps = pairwise(np.linspace(bottom, bottom + bar, SCALE_STEPS + 1).tolist())
    colors = map(tuple, scale_colors(np.linspace(0.0, 1.0, SCALE_STEPS)).tolist())
    layout.swatches += [
        (Rectangle(left, low, right, high), color) for (low, high), color in zip(steps, colors, strict=True)
    ]
    for mark in marks:
        y = bottom + round(mark.height * bar)
        # The tolerance is marked across the whole bar.
        layout.ticks.append(Rectangle(left if mark.note == TOLERANCE else right, y - 1, right + tick, y + 1))
        layout.write(mark.number, numbers_end, y - line // 2, ends=True)
        layout.write(mark.note, numbers_end + gap // 2, y - line // 2, Style.HEADING)
    highest = bottom + bar + line // 2
    if legend.has_beyond:
        layout.swatches.append((Rectangle(left, highest, right, highest + line), BEYOND))
        layout.write("beyond", right + gap, highest, Style.HEADING)
        highest += line
    return highest + line // 4
