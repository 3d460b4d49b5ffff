# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""How viewports show the heat map: switched to its colours as they are, with edges, and back to what was before."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import bpy
from bpy.props import BoolProperty, PointerProperty, StringProperty

# The colour type of Solid shading that shows the mesh's active colour attribute.
COLOR_TYPE = "VERTEX"

# How it shows them, as parts and settings of the 3D View. Light, shadows and cavities would change the colours.
FLAT_LIGHT = {"shading.light": "FLAT", "shading.show_shadows": False, "shading.show_cavity": False}
# In flat light edges alone show the form; they are faint, so that the colours between them stay what they are.
EDGES = {"overlay.show_wireframes": True, "overlay.wireframe_threshold": 1.0, "overlay.wireframe_opacity": 0.25}
APPEARANCE = {**FLAT_LIGHT, **EDGES}


class ViewportMemory(bpy.types.PropertyGroup):
    """What a viewport was like before the heat map; it lives on the shading, so it is saved with the file."""

    is_switched: BoolProperty()
    previous_color_type: StringProperty()
    wants_edges: BoolProperty()
    previous: StringProperty(description="The settings switched now, and what they were before, as JSON")
    left_alone: StringProperty(description="The settings that were changed since they were switched, as JSON")


def shows_colors(space: bpy.types.SpaceView3D) -> bool:
    """Whether this viewport shows colour attributes."""
    return space.shading.type == "SOLID" and space.shading.color_type == COLOR_TYPE


def restore_all() -> None:
    """Put every viewport back."""
    for space in spaces():
        switch(space, False)


def spaces() -> Iterator[bpy.types.SpaceView3D]:
    """Every 3D View of the file."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            for space in area.spaces:
                if space.type == "VIEW_3D":
                    yield space


def switch(space: bpy.types.SpaceView3D, on: bool, *, edges: bool = True) -> None:
    """Show colour attributes, or what the viewport showed before, except for what was changed since.

    edges: whether to draw them as well.
    """
    shading, memory = space.shading, space.shading.ccdepth
    memory.wants_edges = edges
    if on and not memory.is_switched:
        memory.previous_color_type, memory.left_alone = shading.color_type, ""
        shading.color_type = COLOR_TYPE
    elif memory.is_switched and not on and shading.color_type == COLOR_TYPE:
        shading.color_type = memory.previous_color_type
    memory.is_switched = on
    _switch_appearance(space)


def pause(space: bpy.types.SpaceView3D) -> None:
    """Put a viewport back for a while, unless its colours were changed since."""
    if space.shading.color_type == COLOR_TYPE:
        switch(space, False)
    else:
        _switch_appearance(space)


def is_amiss(space: bpy.types.SpaceView3D) -> bool:
    """Whether the light or the edges are not as they are to be: the shading was changed since they were switched."""
    return set(_previous(space)) != _wanted_appearance(space)


def _switch_appearance(space: bpy.types.SpaceView3D) -> None:
    """Light and edges are switched only while the viewport shows colours."""
    if not is_amiss(space):
        return
    memory = space.shading.ccdepth
    left_alone = set(json.loads(memory.left_alone or "[]"))
    for path, before in _previous(space).items():
        if _value(space, path) == APPEARANCE[path]:
            _set_value(space, path, before)
        else:
            left_alone.add(path)
    memory.left_alone = json.dumps(sorted(left_alone))
    wanted = sorted(_wanted_appearance(space))
    memory.previous = json.dumps({path: _value(space, path) for path in wanted})
    for path in wanted:
        _set_value(space, path, APPEARANCE[path])


def _wanted_appearance(space: bpy.types.SpaceView3D) -> set[str]:
    memory = space.shading.ccdepth
    if not (memory.is_switched and shows_colors(space)):
        return set()
    wanted = APPEARANCE if memory.wants_edges else FLAT_LIGHT
    return wanted.keys() - set(json.loads(memory.left_alone or "[]"))


def _previous(space: bpy.types.SpaceView3D) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(space.shading.ccdepth.previous or "{}")
    return found


def _value(space: bpy.types.SpaceView3D, path: str) -> Any:
    return space.path_resolve(path)


def _set_value(space: bpy.types.SpaceView3D, path: str, value: Any) -> None:
    part, name = path.split(".")
    setattr(getattr(space, part), name, value)


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
