# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Viewports: redrawn, and put back in files of an earlier version that switched shadings."""

from __future__ import annotations

import json
from typing import Any

import bpy
from bpy.app.handlers import persistent
from bpy.props import BoolProperty, StringProperty

# The settings to which earlier versions switched viewports.
SWITCHED = {
    "shading.color_type": "VERTEX",
    "shading.light": "FLAT",
    "shading.show_shadows": False,
    "shading.show_cavity": False,
    "overlay.show_wireframes": True,
    "overlay.wireframe_threshold": 1.0,
    "overlay.wireframe_opacity": 0.25,
}


class ViewportMemory(bpy.types.PropertyGroup):
    """The settings of a viewport before an earlier version switched them, as that version saved them."""

    is_switched: BoolProperty()
    previous_color_type: StringProperty()
    previous: StringProperty(description="The other settings switched, and what they were before, as JSON")


def redraw(context: bpy.types.Context) -> None:
    """Redraw every 3D View, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


@persistent
def put_back_all(*_: Any) -> None:
    """Put back every viewport of a file that an earlier version switched, once."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D" and space.shading.ccdepth.is_switched:
                    _put_back(space)


def _put_back(space: bpy.types.SpaceView3D) -> None:
    """Put back the settings that are still as they were switched; others were changed since."""
    memory = space.shading.ccdepth
    previous = {"shading.color_type": memory.previous_color_type, **json.loads(memory.previous or "{}")}
    for path, before in previous.items():
        if space.path_resolve(path) == SWITCHED[path]:
            part, name = path.split(".")
            setattr(getattr(space, part), name, before)
    space.shading.property_unset("ccdepth")
