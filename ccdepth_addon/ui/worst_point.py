# SPDX-License-Identifier: GPL-3.0-or-later
"""A label in the 3D View at the place where the measured deviation is largest."""

from __future__ import annotations

from typing import Any

import blf
import bpy
import gpu
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..state.heat_map import Shown, shown
from ..state.still_holds import measured_to_show
from .deviation_panel import stale_line
from .lengths import Rounding, length_text

FONT = 0

# In pixels at an interface scale of 1.
FONT_SIZE, REACH, PADDING = 11, 28, 5

BACKGROUND_COLOR, TEXT_COLOR = (0.08, 0.08, 0.08, 0.85), (1.0, 1.0, 1.0, 1.0)

_handle: Any = None


def draw() -> None:
    """Draw the label in the current region, while the heat map shows deviations that hold."""
    context = bpy.context
    settings = context.scene.ccdepth
    if shown(settings) is not Shown.DEVIATION or not context.space_data.overlay.show_overlays:
        return
    holder = measured_to_show(context)
    if holder is None or not holder.visible_get() or stale_line(settings, holder.data):
        return
    record = holder.data.ccdepth
    place = location_3d_to_region_2d(context.region, context.region_data, Vector(record.measurement.worst_point))
    if place is not None:
        # That distance is really there.
        text = length_text(context.scene, record.deviation_reached, Rounding.DOWN)
        _draw_label(place, text, context.preferences.system.ui_scale)


def _draw_label(place: Vector, text: str, scale: float) -> None:
    blf.size(FONT, FONT_SIZE * scale)
    width, height = blf.dimensions(FONT, text)
    padding, reach = PADDING * scale, REACH * scale
    left, bottom = place.x + reach, place.y + reach
    box = [
        (left - padding, bottom - padding),
        (left + width + padding, bottom - padding),
        (left + width + padding, bottom + height + padding),
        (left - padding, bottom + height + padding),
    ]
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", BACKGROUND_COLOR)
    batch_for_shader(shader, "TRIS", {"pos": box}, indices=[(0, 1, 2), (0, 2, 3)]).draw(shader)
    for color, wide in ((BACKGROUND_COLOR, 3.0), (TEXT_COLOR, 1.0)):
        gpu.state.line_width_set(wide * scale)
        shader.uniform_float("color", color)
        batch_for_shader(shader, "LINES", {"pos": [tuple(place), box[0]]}).draw(shader)
    gpu.state.line_width_set(1.0)
    gpu.state.blend_set("NONE")
    blf.color(FONT, *TEXT_COLOR)
    blf.position(FONT, round(left), round(bottom), 0)
    blf.draw(FONT, text)


def register() -> None:
    global _handle
    _handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    global _handle
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
