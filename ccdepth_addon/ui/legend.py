# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts over the 3D View: the legend of the selected objects, and a label at the place of the largest deviation.

The legend stands at the bottom right, clear of the sidebar and of regions at the bottom.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import monotonic
from typing import Any, NamedTuple

import blf
import bpy
import gpu
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..registration import do_not_call
from ..state import watch
from ..state.heat_map import Shown, shown
from ..state.still_holds import measured_to_show
from .deviation_panel import stale_line
from .legend_contents import Color, Legend, legend
from .legend_layout import FONT_SIZE, Layout, Rectangle, Style, placed
from .lengths import Rounding, length_text
from .selected_objects import colored_objects

FONT = 0
COLORS = {
    Style.TEXT: (1.0, 1.0, 1.0, 1.0),
    Style.HEADING: (0.75, 0.75, 0.75, 1.0),
    Style.ALERT: (1.0, 0.45, 0.4, 1.0),
}
BACKGROUND_COLOR = (0.08, 0.08, 0.08, 0.85)

# The distance of the label from its place, and the room around its text, at an interface scale of 1.
REACH, PADDING = 28, 5

# Seconds after which it has taken long to put the legend together, and for how many times as long it is kept then.
LONG = 0.03
TIMES_KEPT = 50


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
    if wanted is not None:
        region = context.region.width, context.region.height
        found = placed(wanted, region, _covered(context), scale, _width)
        if found is not None:
            _draw_layout(*found)


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
    watch.redraw(bpy.context)


def _covered(context: bpy.types.Context) -> tuple[int, int]:
    """The width at the right and the height at the bottom of the 3D View that its other regions cover; hidden ones have
    no size."""
    window, others = context.region, [each for each in context.area.regions if each.width > 1 and each.height > 1]
    right = sum(window.x + window.width - each.x for each in others if each.alignment == "RIGHT")
    bottom = sum(each.height for each in others if each.alignment == "BOTTOM" and each.y >= window.y)
    return max(0, right), bottom


def _draw_layout(layout: Layout, place: Rectangle) -> None:
    left, bottom = round(place.left), round(place.bottom)
    filled = [
        (Rectangle(0, 0, layout.width, layout.height), BACKGROUND_COLOR),
        *((swatch, (*color, 1.0)) for swatch, color in layout.swatches),
        *((tick, COLORS[Style.TEXT]) for tick in layout.ticks),
    ]
    _draw_rectangles(
        [
            (Rectangle(each.left + left, each.bottom + bottom, each.right + left, each.top + bottom), color)
            for each, color in filled
        ]
    )
    blf.size(FONT, layout.font_size)
    for text in layout.texts:
        x = text.x - (blf.dimensions(FONT, text.text)[0] if text.ends_there else 0.0)
        blf.color(FONT, *COLORS[text.style])
        blf.position(FONT, round(place.left + x), round(place.bottom + text.y), 0)
        blf.draw(FONT, text.text)


def _width(text: str, size: float) -> float:
    blf.size(FONT, size)
    return float(blf.dimensions(FONT, text)[0])


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
    blf.size(FONT, FONT_SIZE * scale)
    width, height = blf.dimensions(FONT, text)
    padding, left, bottom = PADDING * scale, place.x + REACH * scale, place.y + REACH * scale
    box = Rectangle(left - padding, bottom - padding, left + width + padding, bottom + height + padding)
    _draw_rectangles([(box, BACKGROUND_COLOR)])
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    for color, wide in ((BACKGROUND_COLOR, 3.0), (COLORS[Style.TEXT], 1.0)):
        gpu.state.line_width_set(wide * scale)
        shader.uniform_float("color", color)
        batch_for_shader(shader, "LINES", {"pos": [tuple(place), box[:2]]}).draw(shader)
    gpu.state.line_width_set(1.0)
    blf.color(FONT, *COLORS[Style.TEXT])
    blf.position(FONT, round(left), round(bottom), 0)
    blf.draw(FONT, text)


def _draw_rectangles(filled: Sequence[tuple[Rectangle, Color]]) -> None:
    """Draw rectangles of one colour (red, green, blue, alpha) each, one over the other."""
    corners = [corner for (a, b, c, d), _ in filled for corner in ((a, b), (c, b), (c, d), (a, d))]
    colors = [color for _, color in filled for _ in range(4)]
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
