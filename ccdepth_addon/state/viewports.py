# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The shading of viewports: switched to show colours, and back to what it was before."""

from collections.abc import Iterator

import bpy
from bpy.props import BoolProperty, PointerProperty, StringProperty

# The colour type of Solid shading that shows the mesh's active colour attribute.
COLOR_TYPE = "VERTEX"


class ViewportMemory(bpy.types.PropertyGroup):
    """What a viewport's shading was before the heat map; it lives on the shading, so it is saved with the file."""

    is_switched: BoolProperty()
    previous_color_type: StringProperty()


def shows_colors(space: bpy.types.SpaceView3D) -> bool:
    """Whether this viewport shows colour attributes."""
    return space.shading.type == "SOLID" and space.shading.color_type == COLOR_TYPE


def restore_all() -> None:
    """Put every viewport back."""
    for shading in shadings():
        switch(shading, False)


def shadings() -> Iterator[bpy.types.View3DShading]:
    """The shading of every 3D View of the file."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    yield space.shading


def switch(shading: bpy.types.View3DShading, on: bool) -> None:
    """Show colour attributes, or what the viewport showed before, unless its shading was changed since."""
    memory = shading.ccdepth
    if on == memory.is_switched:
        return
    if on:
        memory.previous_color_type = shading.color_type
        shading.color_type = COLOR_TYPE
    elif shading.color_type == COLOR_TYPE:
        shading.color_type = memory.previous_color_type
    memory.is_switched = on


def pause(shading: bpy.types.View3DShading) -> None:
    """Put a viewport back for a while, unless its shading was changed since."""
    if shading.color_type == COLOR_TYPE:
        switch(shading, False)


def redraw(context: bpy.types.Context) -> None:
    """Redraw every 3D View, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def register() -> None:
    bpy.utils.register_class(ViewportMemory)
    bpy.types.View3DShading.ccdepth = PointerProperty(type=ViewportMemory)


def unregister() -> None:
    # What the viewports looked like is lost with these properties.
    restore_all()
    del bpy.types.View3DShading.ccdepth
    bpy.utils.unregister_class(ViewportMemory)
