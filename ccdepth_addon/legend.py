# SPDX-License-Identifier: GPL-3.0-or-later
"""The legend in the 3D View: which colour stands for which depth of the active object, and how many faces have it.

It stands at the bottom right, clear of the sidebar, the headers and the asset shelf, and below the navigation gizmo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from . import heat_map, results
from .colors import palette

Color = tuple[float, ...]

# Lengths in pixels at an interface scale of 1.
FONT_SIZE = 11
LINE_HEIGHT = 18
MARGIN = 14
PADDING = 8
SWATCH_WIDTH = 18
COLUMN_GAP = 12
GIZMO_HEIGHT = 250

FONT = 0
TEXT_COLOR = (1.0, 1.0, 1.0, 1.0)
HEADING_COLOR = (0.75, 0.75, 0.75, 1.0)
BACKGROUND_COLOR = (0.08, 0.08, 0.08, 0.75)

_handle: Any = None


@dataclass(frozen=True)
class LegendRow:
    """One line: what stands in the two columns, and the colour, if it stands for one."""

    depth: str
    faces: str
    color: Color | None


def legend_rows(record: bpy.types.PropertyGroup, most: int) -> list[LegendRow]:
    """The deepest depths first; when there are more than fit, the last line counts the rest."""
    colors = palette(record.least_color_depth, record.deepest_color_depth)
    rows = [
        LegendRow(str(row.depth), f"{row.faces:,}", (*colors[row.depth - record.least_color_depth], 1.0))
        for row in reversed(record.rows)
    ]
    if len(rows) <= most:
        return rows
    kept = max(0, most - 1)
    rest = sum(row.faces for row in list(reversed(record.rows))[kept:])
    return [*rows[:kept], LegendRow("…", f"{rest:,}", None)]


def draw() -> None:
    """Draw the legend in the region being drawn, if it has anything to say there."""
    context = bpy.context
    active = context.active_object
    if active is None or active.type != "MESH" or not active.visible_get() or not results.shows_heat_map(active.data):
        return
    if not (context.scene.ccdepth.show_legend and context.space_data.overlay.show_overlays):
        return
    if heat_map.shows_heat_map(context.space_data):
        _draw_rows(context, active.data.ccdepth)


def _draw_rows(context: bpy.types.Context, record: bpy.types.PropertyGroup) -> None:
    scale = context.preferences.system.ui_scale
    line = round(LINE_HEIGHT * scale)
    right, bottom, top = _free_corner(context, scale)
    most = (top - bottom - round(2 * PADDING * scale)) // line - 1
    if most < 1:
        return
    rows = [LegendRow("Depth", "Faces", None), *legend_rows(record, most)]
    blf.size(FONT, FONT_SIZE * scale)
    widths = [max(blf.dimensions(FONT, text)[0] for text in column) for column in _columns(rows)]
    padding, gap = round(PADDING * scale), round(COLUMN_GAP * scale)
    swatch = round(SWATCH_WIDTH * scale)
    left = right - round(sum(widths)) - swatch - 2 * gap - 2 * padding
    _draw_rectangle(left, bottom, right, bottom + len(rows) * line + 2 * padding, BACKGROUND_COLOR)
    depth_right = left + padding + swatch + gap + widths[0]
    for index, row in enumerate(reversed(rows)):
        base = bottom + padding + index * line
        if row.color is not None:
            _draw_rectangle(left + padding, base, left + padding + swatch, base + line, row.color)
        color = HEADING_COLOR if index == len(rows) - 1 else TEXT_COLOR
        text_base = base + round(0.3 * line)
        _draw_text(row.depth, depth_right, text_base, color)
        _draw_text(row.faces, right - padding, text_base, color)


def _columns(rows: list[LegendRow]) -> tuple[list[str], list[str]]:
    return [row.depth for row in rows], [row.faces for row in rows]


def _free_corner(context: bpy.types.Context, scale: float) -> tuple[int, int, int]:
    """The right and bottom edge of the space nothing else is drawn in, and its top: (x, y, y) in the region."""
    window = context.region
    right, bottom, top = window.width, 0, window.height
    for region in context.area.regions:
        if region.type in {"WINDOW", "HUD"} or region.width <= 1 or region.height <= 1:
            continue
        if region.alignment == "RIGHT" and region.type == "UI":
            right = min(right, region.x - window.x)
        elif region.type != "TOOLS" and region.y <= window.y + window.height // 2:
            bottom = max(bottom, region.y + region.height - window.y)
        elif region.type != "TOOLS":
            top = min(top, region.y - window.y)
    space = context.space_data
    if space.show_gizmo and space.show_gizmo_navigate:
        top -= round(GIZMO_HEIGHT * scale)
    margin = round(MARGIN * scale)
    return right - margin, bottom + margin, top - margin


def _draw_rectangle(left: float, bottom: float, right: float, top: float, color: Color) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    batch = batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)])
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", color)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _draw_text(text: str, right: float, base: float, color: Color) -> None:
    blf.color(FONT, *color)
    blf.position(FONT, round(right - blf.dimensions(FONT, text)[0]), base, 0)
    blf.draw(FONT, text)


def register() -> None:
    global _handle
    _handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")


def unregister() -> None:
    global _handle
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
