# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map in the viewports: Solid shading is switched to show colour attributes, and put back.

Solid shading shows a mesh's active colours alone, and painting changes them. So a mesh that is painted is shown with
the user's colours.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.bulk_writing import is_writable
from ..exchange.result_attributes import COLOR
from ..registration import add_handlers, remove_handlers
from ..state import results, viewports
from ..state.settings import heat_map_listeners

PAINTING_MODES = {"SCULPT", "VERTEX_PAINT", "TEXTURE_PAINT"}

# The session identifiers of the objects last seen in one of them.
_painted: set[int] = set()


def synchronise(context: bpy.types.Context) -> None:
    """Show the heat map on meshes and in viewports when there is one, and put them back when not.

    A viewport is switched once; when the user changes its shading afterwards, it stays so.
    """
    scene = context.scene
    if scene is None:
        return
    wanted = scene.ccdepth.show_heat_map
    painted = {obj.data for obj in bpy.data.objects if obj.type == "MESH" and obj.mode in PAINTING_MODES}
    holders = {obj for obj in bpy.data.objects if obj.type == "MESH" and results.has_heat_map(obj.data)}
    shown = waiting = False
    # Most scenes have none: their objects are not read.
    for blender_object in holders.intersection(scene.objects) if holders else ():
        mesh = blender_object.data
        _show(mesh, wanted, mesh in painted)
        shown = shown or (results.shows_heat_map(mesh) and blender_object.visible_get())
        waiting = waiting or mesh in painted
    for shading in viewports.shadings():
        if wanted and waiting and not shown:
            viewports.pause(shading)
        else:
            viewports.switch(shading, wanted and shown)
    viewports.redraw(context)


@persistent
def _synchronise_soon(*_: Any) -> None:
    """After undo, redo and loading, which may replace all data: once Blender has finished its current event, or at once
    in the background, which has no events.

    While undo restores data, a scene may still list objects that are gone, and reading them crashes Blender 5.2.
    """
    if bpy.app.background:
        synchronise(bpy.context)
    elif not bpy.app.timers.is_registered(_synchronise):
        bpy.app.timers.register(_synchronise)


def _synchronise() -> None:
    synchronise(bpy.context)


def _show(mesh: bpy.types.Mesh, wanted: bool, painted: bool) -> None:
    # Linked meshes cannot be changed.
    if not is_writable(mesh):
        return
    if painted:
        results.keep_from_painting(mesh)
    else:
        results.show_color(mesh, wanted)


@persistent
def _notice_painting(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Hide the heat map while an object is painted, and show it again afterwards."""
    changed = False
    for update in depsgraph.updates:
        original = update.id.original
        if isinstance(original, bpy.types.Object) and original.type == "MESH":
            changed = _notice_mode(original) or changed
    if changed:
        synchronise(bpy.context)


def _notice_mode(blender_object: bpy.types.Object) -> bool:
    """Whether painting the object has begun or ended, or it is painted while our colours are active."""
    uid, painted = blender_object.session_uid, blender_object.mode in PAINTING_MODES
    changed = painted != (uid in _painted)
    if painted:
        _painted.add(uid)
        return changed or blender_object.data.attributes.active_color_name == COLOR
    _painted.discard(uid)
    return changed


@persistent
def _forget_painting(*_: Any) -> None:
    _painted.clear()


HANDLERS = (
    ("depsgraph_update_post", _notice_painting),
    ("undo_post", _synchronise_soon),
    ("redo_post", _synchronise_soon),
    ("load_pre", _forget_painting),
    ("load_post", _synchronise_soon),
)


def register() -> None:
    add_handlers(HANDLERS)
    heat_map_listeners.append(synchronise)


def unregister() -> None:
    heat_map_listeners.remove(synchronise)
    remove_handlers(HANDLERS)
    if bpy.app.timers.is_registered(_synchronise):
        bpy.app.timers.unregister(_synchronise)
    _forget_painting()
