# SPDX-License-Identifier: GPL-3.0-or-later
"""The legend in the 3D View: which colour stands for which depth or distance on the selected objects.

It stands at the bottom right, clear of the sidebar, the headers, the asset shelf, the navigation gizmo and the panel
Adjust Last Operation. In Quad View it is in one of the views alone.
"""

from __future__ import annotations

from time import monotonic
from typing import Any, NamedTuple

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ..registration import do_not_call
from ..state import viewports
from ..state.colors import BEYOND, VIRIDIS_COLORS
from .legend_contents import legends
from .legend_layout import Color, Layout, Legend, Rectangle, Room, Style, placed
from .selected_results import colored_objects

FONT = 0
COLORS = {
    Style.TEXT: (1.0, 1.0, 1.0, 1.0),
    Style.HEADING: (0.75, 0.75, 0.75, 1.0),
    Style.ALERT: (1.0, 0.45, 0.4, 1.0),
}
BACKGROUND_COLOR = (0.08, 0.08, 0.08, 0.85)

# What the navigation gizmo takes at the top right, at an interface scale of 1.
GIZMO_WIDTH, GIZMO_HEIGHT = 100, 250

# And what the information takes at the top left, with the headers above it.
INFORMATION_WIDTH, INFORMATION_HEIGHT = 260, 135

# Seconds after which it has taken long to put the legends together, and for how many times as long they are kept then.
LONG = 0.01
TIMES_KEPT = 10


class _Kept(NamedTuple):
    """The legends of a scene and view layer, and until when they serve."""

    layer: tuple[str, str]
    until: float
    legends: list[Legend]


_handle: Any = None
_kept: _Kept | None = None


def draw() -> None:
    """Draw the legend in the current region, if there is anything to show."""
    context = bpy.context
    space = context.space_data
    if not (context.scene.ccdepth.show_legend and space.overlay.show_overlays and viewports.shows_colors(space)):
        return
    wanted = _wanted(context)
    scale = context.preferences.system.ui_scale
    for region in _views(context.area):
        found = _placed_in(context, region, wanted, scale)
        if region == context.region:
            for layout, place in found:
                _draw_layout(layout, place)
        if found or region == context.region:
            return


def _wanted(context: bpy.types.Context) -> list[Legend]:
    """What the legends say. Of very many objects this takes a while, and is kept for some time."""
    global _kept
    started, layer = monotonic(), (context.scene.name, context.view_layer.name)
    if _kept is not None and _kept.layer == layer and started < _kept.until:
        if not bpy.app.timers.is_registered(_redraw):
            bpy.app.timers.register(_redraw, first_interval=_kept.until - started)
        return _kept.legends
    found = legends(context.scene, colored_objects(context))
    took = monotonic() - started
    _kept = _Kept(layer, monotonic() + TIMES_KEPT * took, found) if took > LONG else None
    return found


def _redraw() -> None:
    viewports.redraw(bpy.context)


def _views(area: bpy.types.Area) -> list[bpy.types.Region]:
    """The views of the area, of which the first that has room has the legend: from the lower right on in Quad View."""
    views = [each for each in area.regions if each.type == "WINDOW" and each.width > 1]
    return sorted(views, key=lambda each: (each.y, -each.x))


def _placed_in(
    context: bpy.types.Context, region: bpy.types.Region, wanted: list[Legend], scale: float
) -> list[tuple[Layout, Rectangle]]:
    """The legends that have room in the region, beside each other, and where."""
    size = region.width, region.height
    obstacles, avoided = _obstacles(context, region, scale), [_information(region, scale)]
    found = []
    for legend in wanted:
        answer = placed(legend, Room(size, obstacles, avoided), scale, _width, (*BEYOND, 1.0))
        if answer is not None:
            found.append(answer)
            obstacles.append(answer[1])
    return found


def _information(region: bpy.types.Region, scale: float) -> Rectangle:
    """Where the name of the view and of the active object are written."""
    width, height = (round(each * scale) for each in (INFORMATION_WIDTH, INFORMATION_HEIGHT))
    return Rectangle(0, region.height - height, width, region.height)


def _obstacles(context: bpy.types.Context, window: bpy.types.Region, scale: float) -> list[Rectangle]:
    """What is drawn over the region, or takes part of it."""
    found = [
        Rectangle(each.x, each.y, each.x + each.width, each.y + each.height)
        for each in context.area.regions
        # Hidden ones have no size.
        if each.type != "WINDOW" and each.width > 1 and each.height > 1
    ]
    relative = [Rectangle(a - window.x, b - window.y, c - window.x, d - window.y) for a, b, c, d in found]
    space = context.space_data
    if space.show_gizmo and space.show_gizmo_navigate:
        # In Quad View regions may lie beyond this view.
        right = min([window.width, *(each.left for each in relative if each.left > window.width / 2)])
        top = min([window.height, *(each.bottom for each in relative if each.bottom > window.height / 2)])
        width, height = (round(each * scale) for each in (GIZMO_WIDTH, GIZMO_HEIGHT))
        relative.append(Rectangle(right - width, top - height, right, top))
    return relative


def _draw_layout(layout: Layout, place: Rectangle) -> None:
    _draw_rectangle(place, BACKGROUND_COLOR)
    for swatch, color in layout.swatches:
        _draw_rectangle(_moved(swatch, place), color if len(color) == 4 else (*color, 1.0))
    if layout.ramp is not None:
        _draw_ramp(_moved(layout.ramp, place))
    for tick in layout.ticks:
        _draw_rectangle(_moved(tick, place), COLORS[Style.TEXT])
    blf.size(FONT, layout.font_size)
    for text in layout.texts:
        x = text.x - (blf.dimensions(FONT, text.text)[0] if text.ends_there else 0.0)
        blf.color(FONT, *COLORS[text.style])
        blf.position(FONT, round(place.left + x), round(place.bottom + text.y), 0)
        blf.draw(FONT, text.text)


def _moved(rectangle: Rectangle, place: Rectangle) -> Rectangle:
    left, bottom = round(place.left), round(place.bottom)
    return Rectangle(left + rectangle.left, bottom + rectangle.bottom, left + rectangle.right, bottom + rectangle.top)


def _width(text: str, size: float) -> float:
    blf.size(FONT, size)
    return float(blf.dimensions(FONT, text)[0])


def _draw_ramp(place: Rectangle) -> None:
    """All colours of the scale, the longer way."""
    count = len(VIRIDIS_COLORS)
    goes_up = place.top - place.bottom > place.right - place.left
    corners, colors, triangles = [], [], []
    for index, color in enumerate(VIRIDIS_COLORS.tolist()):
        part = index / (count - 1)
        if goes_up:
            y = place.bottom + (place.top - place.bottom) * part
            corners += [(place.left, y), (place.right, y)]
        else:
            x = place.left + (place.right - place.left) * part
            corners += [(x, place.top), (x, place.bottom)]
        colors += 2 * [(*color, 1.0)]
    for first in range(0, 2 * (count - 1), 2):
        triangles += [(first, first + 1, first + 3), (first, first + 3, first + 2)]
    shader = gpu.shader.from_builtin("SMOOTH_COLOR")
    batch_for_shader(shader, "TRIS", {"pos": corners, "color": colors}, indices=triangles).draw(shader)


def _draw_rectangle(place: Rectangle, color: Color) -> None:
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    left, bottom, right, top = place
    corners = [(left, bottom), (right, bottom), (right, top), (left, top)]
    batch = batch_for_shader(shader, "TRIS", {"pos": corners}, indices=[(0, 1, 2), (0, 2, 3)])
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", color)
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
