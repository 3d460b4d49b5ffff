# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts over the 3D View: the legend of the selected objects, and a label at the place of the largest deviation.

The legend stands at the bottom right, clear of the sidebar and of regions at the bottom.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from time import monotonic
from typing import Any, NamedTuple

import blf
import bpy
import gpu
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..registration import do_not_call, redraw
from ..state.colors import BEYOND, scale_colors
from ..state.heat_map import Shown, shown
from ..state.still_holds import measured_to_show
from .deviation_panel import stale_line
from .facts import colored_objects, ratio_texts
from .legend_contents import NUMBER_HEIGHT, TOLERANCE, Color, Legend, legend
from .lengths import Rounding, length_text

FONT = 0
TEXT, HEADING, ALERT = (1.0, 1.0, 1.0, 1.0), (0.75, 0.75, 0.75, 1.0), (1.0, 0.45, 0.4, 1.0)
BACKGROUND = (0.08, 0.08, 0.08, 0.85)

# Lengths in pixels at an interface scale of 1. REACH: from the place of the largest distance to its label.
FONT_SIZE, LINE, MARGIN, PADDING, SWATCH, GAP, TICK, REACH = 11, 18, 14, 8, 18, 12, 5, 28
BAR = LINE / NUMBER_HEIGHT

# The number of colours of the scale, with halves and quarters among them.
SCALE_STEPS = 101

# Seconds after which it has taken long to put the legend together, and for how many times as long it is kept then.
LONG = 0.03
TIMES_KEPT = 50

# A text: its left or right end, its base line, and whether it ends there.
Text = tuple[str, float, float, Color, bool]


class Box(NamedTuple):
    """A filled rectangle, in pixels."""

    left: float
    bottom: float
    right: float
    top: float
    color: Color


@dataclass
class Layout:
    """Texts and boxes, from the left bottom corner of the legend, upwards. top: the lower end of the next line."""

    scale: float
    width: float = 0.0
    top: float = 0.0
    boxes: list[Box] = field(default_factory=list)
    texts: list[Text] = field(default_factory=list)

    def pixels(self, *lengths: float) -> Iterator[int]:
        """Lengths at an interface scale of 1 as pixels."""
        return (round(length * self.scale) for length in lengths)

    def wide(self, texts: Iterable[str]) -> float:
        """The width of the widest text."""
        blf.size(FONT, FONT_SIZE * self.scale)
        return max(float(blf.dimensions(FONT, text)[0]) for text in texts)

    def write(self, text: str, x: float, bottom: float, color: Color = TEXT, *, ends: bool = False) -> None:
        """Add a text in a line with a given lower end."""
        self.texts.append((text, x, bottom + round(0.3 * LINE * self.scale), color, ends))


class _Kept(NamedTuple):
    """The legend of a scene and view layer, and the end of its use."""

    layer: tuple[str, str, str]
    until: float
    legend: Legend | None


_handle: Any = None
_kept: _Kept | None = None


def draw() -> None:
    """Draw legend and label in the current region."""
    context = bpy.context
    if context.space_data.overlay.show_overlays:
        scale = context.preferences.system.ui_scale
        _draw_worst_point(context, scale)
        if context.scene.ccdepth.show_legend:
            _draw_legend(context, scale)


def _draw_legend(context: bpy.types.Context, scale: float) -> None:
    wanted = _wanted(context)
    if wanted is None:
        return
    layout, margin, (right, bottom) = laid_out(wanted, scale), round(MARGIN * scale), _covered(context)
    left, bottom = round(context.region.width - right - margin - layout.width), bottom + margin
    # Without room for it, it is not drawn.
    if left >= margin and bottom + layout.top <= context.region.height - margin:
        _draw_boxes([Box(0, 0, layout.width, layout.top, BACKGROUND), *layout.boxes], left, bottom)
        _draw_texts(layout.texts, scale, left, bottom)


def laid_out(legend: Legend, scale: float) -> Layout:
    """The legend as a column. scale: of the interface."""
    layout, alert = Layout(scale), [(legend.alert, ALERT)] if legend.alert else []
    padding, line = layout.pixels(PADDING, LINE)
    lines = [(legend.title, TEXT), *((note, HEADING) for note in legend.notes), *alert]
    layout.width, layout.top = layout.wide(text for text, _ in lines) + 2 * padding, padding
    (_add_scale if legend.marks else _add_rows)(layout, legend)
    for text, color in reversed(lines):
        layout.write(text, padding, layout.top, color)
        layout.top += line
    layout.top += padding
    return layout


def _add_rows(layout: Layout, legend: Legend) -> None:
    """Add swatches, depths and faces below their headings."""
    padding, line, swatch, gap = layout.pixels(PADDING, LINE, SWATCH, GAP)
    rows = [("Depth", "Faces", None), *((row.label, f"{row.faces:,}", row.color) for row in legend.rows)]
    label_end = padding + swatch + gap + layout.wide(label for label, _, _ in rows)
    layout.width = max(layout.width, label_end + gap + layout.wide(number for _, number, _ in rows) + padding)
    for label, number, color in reversed(rows):
        if color is not None:
            layout.boxes.append(Box(padding, layout.top, padding + swatch, layout.top + line, (*color, 1.0)))
        for text, end in ((label, label_end), (number, layout.width - padding)):
            layout.write(text, end, layout.top, HEADING if color is None else TEXT, ends=True)
        layout.top += line


def _add_scale(layout: Layout, legend: Legend) -> None:
    """Add the colours as a bar, with numbers on the right."""
    padding, line, swatch, gap, bar, tick = layout.pixels(PADDING, LINE, SWATCH, GAP, BAR, TICK)
    left, right, bottom = padding, padding + swatch, padding + line // 2
    numbers_end = right + gap + layout.wide(mark.number for mark in legend.marks)
    layout.width = max(layout.width, numbers_end + gap // 2 + layout.wide(mark.note for mark in legend.marks) + padding)
    steps = pairwise(np.linspace(bottom, bottom + bar, SCALE_STEPS + 1).tolist())
    for (low, high), color in zip(steps, scale_colors(np.linspace(0.0, 1.0, SCALE_STEPS)).tolist(), strict=True):
        layout.boxes.append(Box(left, low, right, high, (*color, 1.0)))
    for mark in legend.marks:
        y = bottom + round(mark.height * bar)
        # The tolerance is marked across the whole bar.
        layout.boxes.append(Box(left if mark.note == TOLERANCE else right, y - 1, right + tick, y + 1, TEXT))
        layout.write(mark.number, numbers_end, y - line // 2, ends=True)
        layout.write(mark.note, numbers_end + gap // 2, y - line // 2, HEADING)
    layout.top = bottom + bar + line // 2
    if legend.has_beyond:
        layout.boxes.append(Box(left, layout.top, right, layout.top + line, (*BEYOND, 1.0)))
        layout.write("beyond", right + gap, layout.top, HEADING)
        layout.top += line
    layout.top += line // 4


def _wanted(context: bpy.types.Context) -> Legend | None:
    """The legend, kept for some time, as a legend of very many objects takes a while to make."""
    global _kept
    scene, started = context.scene, monotonic()
    layer = scene.name, context.view_layer.name, scene.ccdepth.heat_map
    if _kept is not None and _kept.layer == layer and started < _kept.until:
        if not bpy.app.timers.is_registered(_redraw):
            bpy.app.timers.register(_redraw, first_interval=_kept.until - started)
        return _kept.legend
    kind = shown(scene.ccdepth)
    objects = [] if kind is None else colored_objects(context, kind)
    found = legend(scene, kind, objects) if kind is not None and objects else None
    took = monotonic() - started
    _kept = _Kept(layer, monotonic() + TIMES_KEPT * took, found) if took > LONG else None
    return found


def _redraw() -> None:
    redraw(bpy.context)


def _covered(context: bpy.types.Context) -> tuple[int, int]:
    """The width at the right and the height at the bottom of the 3D View that its other regions cover; hidden ones have
    no size."""
    window, others = context.region, [each for each in context.area.regions if each.width > 1 and each.height > 1]
    right = sum(window.x + window.width - each.x for each in others if each.alignment == "RIGHT")
    bottom = sum(each.height for each in others if each.alignment == "BOTTOM" and each.y >= window.y)
    return max(0, right), bottom


def _draw_worst_point(context: bpy.types.Context, scale: float) -> None:
    """Draw the largest distance at its place, while the heat map shows deviations that hold."""
    settings = context.scene.ccdepth
    holder = measured_to_show(context) if shown(settings) is Shown.DEVIATION else None
    if holder is None or not holder.visible_get() or stale_line(settings, holder.data):
        return
    record = holder.data.ccdepth
    place = location_3d_to_region_2d(context.region, context.region_data, Vector(record.measurement.worst_point))
    if place is None:
        return
    # The reached distance is really there.
    text = length_text(context.scene, record.deviation_reached, Rounding.DOWN)
    if record.measurement.factors[1]:
        _, text = ratio_texts(record.deviation, record.deviation_reached, record.measurement.world_tolerance)
    blf.size(FONT, FONT_SIZE * scale)
    width, height = blf.dimensions(FONT, text)
    padding, bottom, (covered, _) = PADDING * scale / 2, place.y + REACH * scale, _covered(context)
    left = min(place.x + REACH * scale, context.region.width - covered - width - 2 * padding)
    box = Box(left - padding, bottom - padding, left + width + padding, bottom + height + padding, BACKGROUND)
    _draw_boxes([box], 0, 0)
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    for color, wide in ((BACKGROUND, 3.0), (TEXT, 1.0)):
        gpu.state.line_width_set(wide * scale)
        shader.uniform_float("color", color)
        batch_for_shader(shader, "LINES", {"pos": [tuple(place), box[:2]]}).draw(shader)
    gpu.state.line_width_set(1.0)
    _draw_texts([(text, left, bottom, TEXT, False)], scale, 0, 0)


def _draw_texts(texts: Iterable[Text], scale: float, left: float, bottom: float) -> None:
    """Draw texts from a left bottom corner."""
    blf.size(FONT, FONT_SIZE * scale)
    for text, x, y, color, ends in texts:
        begin = x - (blf.dimensions(FONT, text)[0] if ends else 0.0)
        blf.color(FONT, *color)
        blf.position(FONT, round(left + begin), round(bottom + y), 0)
        blf.draw(FONT, text)


def _draw_boxes(boxes: Sequence[Box], left: float, bottom: float) -> None:
    """Draw boxes from a left bottom corner, one over the other."""
    corners = [(left + x, bottom + y) for a, b, c, d, _ in boxes for x, y in ((a, b), (c, b), (c, d), (a, d))]
    colors = [each.color for each in boxes for _ in range(4)]
    triangles = [(first, first + one, first + one + 1) for first in range(0, len(corners), 4) for one in (1, 2)]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": corners, "color": colors}, indices=triangles)
    gpu.state.blend_set("ALPHA")
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def register() -> None:
    global _handle
    _handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    global _handle, _kept
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = _kept = None
    do_not_call(_redraw)
