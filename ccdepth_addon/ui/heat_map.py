# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map in the viewports: Solid shading is switched to show colour attributes, and put back.

Solid shading shows a mesh's active colours and no others, and they are what modes for painting paint on. While a mesh
is painted it is therefore shown with the user's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.bulk_writing import is_writable
from ..state import results

# The colour type of Solid shading that shows the mesh's active colour attribute.
COLOR_TYPE = "VERTEX"

PAINTING_MODES = {"SCULPT", "VERTEX_PAINT", "TEXTURE_PAINT"}

# The session identifiers of the objects last seen in one of them.
_painted: set[int] = set()


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
    painted = {obj.data for obj in bpy.data.objects if obj.type == "MESH" and obj.mode in PAINTING_MODES}
    holders = {obj for obj in bpy.data.objects if obj.type == "MESH" and results.has_heat_map(obj.data)}
    shown = waiting = False
    # Most scenes have none, and what belongs to them need not be asked for.
    for blender_object in holders.intersection(scene.objects) if holders else ():
        mesh = blender_object.data
        _show(mesh, wanted, mesh in painted)
        shown = shown or (results.shows_heat_map(mesh) and blender_object.visible_get())
        waiting = waiting or mesh in painted
    for shading in _shadings():
        if wanted and waiting and not shown:
            _pause(shading)
        else:
            _switch(shading, wanted and shown)
    redraw_viewports(context)


def synchronise_soon() -> None:
    """Do so as soon as Blender has finished what it is doing; at once where nobody waits for a window.

    While undo puts data back, a scene may still list objects that are gone, and looking at them crashes Blender 5.2.
    """
    if bpy.app.background:
        synchronise(bpy.context)
    elif not bpy.app.timers.is_registered(_synchronise):
        bpy.app.timers.register(_synchronise)


def _synchronise() -> None:
    synchronise(bpy.context)


def _show(mesh: bpy.types.Mesh, wanted: bool, painted: bool) -> None:
    # Another file decides for its meshes itself.
    if not is_writable(mesh):
        return
    if painted:
        results.keep_from_painting(mesh)
    else:
        results.show_color(mesh, wanted)


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


def _pause(shading: bpy.types.View3DShading) -> None:
    """Put a viewport back for a while. One that was changed since stays as it is, then and afterwards."""
    if shading.color_type == COLOR_TYPE:
        _switch(shading, False)


def redraw_viewports(context: bpy.types.Context) -> None:
    """Have every 3D View drawn again, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


@persistent
def _notice_painting(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Have the heat map make way when an object is going to be painted, and come back afterwards."""
    changed = False
    for update in depsgraph.updates:
        original = update.id.original
        if isinstance(original, bpy.types.Object) and original.type == "MESH":
            changed = _notice_mode(original) or changed
    if changed:
        synchronise(bpy.context)


def _notice_mode(blender_object: bpy.types.Object) -> bool:
    """Whether the object has begun or ceased to be painted, or is painted and has our colours active nevertheless."""
    uid, painted = blender_object.session_uid, blender_object.mode in PAINTING_MODES
    changed = painted != (uid in _painted)
    if painted:
        _painted.add(uid)
        return changed or blender_object.data.attributes.active_color_name == results.COLOR
    _painted.discard(uid)
    return changed


@persistent
def _forget_painting(*_: Any) -> None:
    _painted.clear()


HANDLERS = (("depsgraph_update_post", _notice_painting), ("load_pre", _forget_painting))


def register() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(_synchronise):
        bpy.app.timers.unregister(_synchronise)
    _forget_painting()
