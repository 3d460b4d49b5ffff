# SPDX-License-Identifier: GPL-3.0-or-later
"""The legend in the 3D View: which colour stands for which depth of the active object, and how many faces have it; or
for which deviation.

It stands at the bottom right, clear of the sidebar, the headers and the asset shelf, and below the navigation gizmo.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ..state import deviation_results, results, viewports
from ..state.colors import BEYOND, VIRIDIS_COLORS, palette
from .deviation_scale import Scale, deviation_scale

Color = tuple[float, ...]

# Lengths in pixels at an interface scale of 1.
FONT_SIZE = 11
LINE_HEIGHT = 18
MARGIN = 14
PADDING = 8
SWATCH_WIDTH = 18
COLUMN_GAP = 12
GIZMO_HEIGHT = 250
SCALE_HEIGHT = 180
TICK_WIDTH = 5

FONT = 0
TEXT_COLOR = (1.0, 1.0, 1.0, 1.0)
HEADING_COLOR = (0.75, 0.75, 0.75, 1.0)
BACKGROUND_COLOR = (0.08, 0.08, 0.08, 0.75)

_handle: Any = None


@dataclass(frozen=True)
class LegendRow:
    """One line: the texts of the two columns, and the colour, if it has one."""

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
    """Draw the legend in the current region, if there is anything to show."""
    context = bpy.context
    if not (context.scene.ccdepth.show_legend and context.space_data.overlay.show_overlays):
        return
    if not viewports.shows_colors(context.space_data):
        return
    measured = deviation_results.shown_object(context)
    if measured is not None:
        if _is_colored(measured):
            _draw_scale(context, measured.data.ccdepth)
        return
    active = context.active_object
    if active is not None and active.type == "MESH" and _is_colored(active):
        _draw_rows(context, active.data.ccdepth)


def _is_colored(blender_object: bpy.types.Object) -> bool:
    return blender_object.visible_get() and results.shows_heat_map(blender_object.data)


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


def _draw_scale(context: bpy.types.Context, record: bpy.types.PropertyGroup) -> None:
    """The colours as a bar, from the bottom upwards, with numbers on its right and what they are beside them."""
    ui = context.preferences.system.ui_scale
    line, padding, gap, swatch = (round(each * ui) for each in (LINE_HEIGHT, PADDING, COLUMN_GAP, SWATCH_WIDTH))
    right, bottom, top = _free_corner(context, ui)
    # Beside the bar: half a line below it, and above it the title and what is beyond the scale.
    height = min(round(SCALE_HEIGHT * ui), top - bottom - 2 * padding - 4 * line)
    if height < 3 * line:
        return
    scale = deviation_scale(context.scene, record, line / height)
    blf.size(FONT, FONT_SIZE * ui)
    numbers = max(_width(mark.number) for mark in scale.marks)
    notes = max(_width(mark.note) for mark in scale.marks)
    left = right - max(swatch + numbers + notes + 2 * gap, _width(scale.title)) - 2 * padding
    base = bottom + padding + line // 2
    highest = base + round(max(1.0, scale.marks[-1].label_height) * height) + line // 2
    _draw_rectangle(left, bottom, right, highest + line + padding, BACKGROUND_COLOR)
    _draw_text(scale.title, left + padding + _width(scale.title), highest + round(0.3 * line), HEADING_COLOR)
    bar = (left + padding, base, left + padding + swatch, base + height)
    _draw_gradient(*bar)
    if scale.has_beyond:
        beyond = base + round(scale.marks[-1].label_height * height) - line // 2
        _draw_rectangle(bar[0], beyond, bar[2], beyond + line, (*BEYOND, 1.0))
    _draw_marks(scale, bar, bar[2] + gap + numbers, gap, line)


def _draw_marks(scale: Scale, bar: tuple[int, int, int, int], numbers_right: int, gap: int, line: int) -> None:
    left, base, right, top = bar
    tick = round(TICK_WIDTH * line / LINE_HEIGHT)
    for mark in scale.marks:
        if mark.height <= 1.0:
            y = base + round(mark.height * (top - base))
            # The tolerance is marked across the whole bar.
            _draw_rectangle(left if mark.note == "tolerance" else right, y - 1, right + tick, y + 1, TEXT_COLOR)
        text_base = base + round(mark.label_height * (top - base)) - round(0.2 * line)
        _draw_text(mark.number, numbers_right, text_base, TEXT_COLOR)
        _draw_text(mark.note, numbers_right + gap // 2 + _width(mark.note), text_base, HEADING_COLOR)


def _width(text: str) -> int:
    return round(blf.dimensions(FONT, text)[0])


def _draw_gradient(left: float, bottom: float, right: float, top: float) -> None:
    count = len(VIRIDIS_COLORS)
    corners, colors, triangles = [], [], []
    for index, color in enumerate(VIRIDIS_COLORS.tolist()):
        y = bottom + (top - bottom) * index / (count - 1)
        corners += [(left, y), (right, y)]
        colors += 2 * [(*color, 1.0)]
    for first in range(0, 2 * (count - 1), 2):
        triangles += [(first, first + 1, first + 3), (first, first + 3, first + 2)]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRIS", {"pos": corners, "color": colors}, indices=triangles).draw(shader)


def _free_corner(context: bpy.types.Context, scale: float) -> tuple[int, int, int]:
    """The right, bottom and top edge of the region's free space: (x, y, y)."""
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
