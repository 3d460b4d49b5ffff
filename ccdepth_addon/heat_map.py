# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map in the viewports: Solid shading is switched to show colour attributes, and put back."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from . import results
from .writing import is_writable

# The colour type of Solid shading that shows the mesh's active colour attribute.
COLOR_TYPE = "VERTEX"


def shows_heat_map(space: bpy.types.SpaceView3D) -> bool:
    """Whether this viewport shows colour attributes."""
    return space.shading.type == "SOLID" and space.shading.color_type == COLOR_TYPE


def synchronise(context: bpy.types.Context) -> None:
    """Make meshes and viewports show the heat map when there is one to show, and put them back when not.

    A viewport is switched once; whoever changes its shading afterwards has the last word.
    """
    scene = context.scene
    if scene is None:
        return
    wanted = scene.ccdepth.show_heat_map
    shown = False
    for blender_object in scene.objects:
        if blender_object.type == "MESH" and results.has_heat_map(blender_object.data):
            mesh = blender_object.data
            # Another file decides for its meshes itself.
            if is_writable(mesh):
                results.show_color(mesh, wanted)
            shown = shown or (mesh.ccdepth.active_color_taken and blender_object.visible_get())
    for shading in _shadings():
        _switch(shading, wanted and shown)
    redraw_viewports(context)


def restore_viewports() -> None:
    """Put every viewport back, whatever there is to show."""
    for shading in _shadings():
        _switch(shading, False)


def _shadings() -> Iterator[bpy.types.View3DShading]:
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    yield space.shading


def _switch(shading: bpy.types.View3DShading, on: bool) -> None:
    memory = shading.ccdepth
    if on == memory.is_switched:
        return
    if on:
        memory.previous_color_type = shading.color_type
        shading.color_type = COLOR_TYPE
    elif shading.color_type == COLOR_TYPE:
        shading.color_type = memory.previous_color_type
    memory.is_switched = on


def redraw_viewports(context: bpy.types.Context) -> None:
    """Have every 3D View drawn again, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
