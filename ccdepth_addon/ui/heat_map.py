# SPDX-License-Identifier: GPL-3.0-or-later
"""The heat map in the viewports: Solid shading is switched to show colour attributes in flat light, with edges, and put
back. So a colour is that of the legend wherever it is seen.

Solid shading shows a mesh's active colours alone, and painting changes them. So a mesh that is painted is shown with
the user's colours.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.bulk_writing import WriteError, is_writable
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.result_attributes import COLOR
from ..registration import add_handlers, call_soon, do_not_call, remove_handlers
from ..state import results, shown_colors, staleness, viewports
from ..state.settings import heat_map_listeners

PAINTING_MODES = {"SCULPT", "VERTEX_PAINT", "TEXTURE_PAINT"}

# Edges of more faces than this hide the colours, and take long to draw.
LARGEST_FACE_COUNT_WITH_EDGES = 200_000

# Takes notice of shading that was changed.
_handle: Any = None

# The session identifiers of the objects last seen in one of them.
_painted: set[int] = set()

# How many objects the scene that was last evaluated had.
_object_count = 0


def synchronise(context: bpy.types.Context) -> None:
    """Show the heat map on meshes and in viewports when there is one, in the colours that the settings ask for, and put
    them back when not.

    A viewport is switched once; when the user changes its shading afterwards, it stays so.
    """
    scene = context.scene
    if scene is None:
        return
    settings = scene.ccdepth
    wanted = settings.show_heat_map
    painted = {obj.data for obj in bpy.data.objects if obj.type == "MESH" and obj.mode in PAINTING_MODES}
    holders = {obj for obj in bpy.data.objects if obj.type == "MESH" and results.has_any(obj.data)}
    waiting = False
    shown: set[bpy.types.Mesh] = set()
    # Most scenes have none: their objects are not read.
    for blender_object in holders.intersection(scene.objects) if holders else ():
        mesh = blender_object.data
        _show(mesh, settings, mesh in painted)
        if results.shows_heat_map(mesh) and blender_object.visible_get():
            shown.add(mesh)
        waiting = waiting or mesh in painted
    edges = sum(map(mesh_face_count, shown)) <= LARGEST_FACE_COUNT_WITH_EDGES
    for space in viewports.spaces():
        if wanted and waiting and not shown:
            viewports.pause(space)
        else:
            viewports.switch(space, wanted and bool(shown), edges=edges)
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


def _show(mesh: bpy.types.Mesh, settings: bpy.types.PropertyGroup, painted: bool) -> None:
    # Linked meshes cannot be changed.
    if not is_writable(mesh):
        return
    if painted:
        results.keep_from_painting(mesh)
        return
    if settings.show_heat_map and not shown_colors.is_current(mesh, settings):
        try:
            shown_colors.write_colors(mesh, settings)
        except WriteError:
            # What Blender does not keep cannot be shown; the result itself is there.
            return
        staleness.note_colors(mesh)
    results.show_color(mesh, settings.show_heat_map and results.has_heat_map(mesh))


def _notice_shading() -> None:
    """Called as a viewport is drawn: puts light and edges right soon, if its shading was changed."""
    if viewports.is_amiss(bpy.context.space_data) and not bpy.app.timers.is_registered(_synchronise):
        bpy.app.timers.register(_synchronise)


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


@persistent
def _notice_removal(scene: bpy.types.Scene, _depsgraph: bpy.types.Depsgraph) -> None:
    """Put viewports back soon when the objects with a heat map are gone; not at once, as an operator may be at work
    with objects of its own."""
    global _object_count
    before, _object_count = _object_count, len(scene.objects)
    if _object_count < before and any(space.shading.ccdepth.is_switched for space in viewports.spaces()):
        call_soon(_synchronise)


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
    ("depsgraph_update_post", _notice_removal),
    ("undo_post", _synchronise_soon),
    ("redo_post", _synchronise_soon),
    ("load_pre", _forget_painting),
    ("load_post", _synchronise_soon),
)


def register() -> None:
    global _handle
    add_handlers(HANDLERS)
    _handle = bpy.types.SpaceView3D.draw_handler_add(_notice_shading, (), "WINDOW", "POST_PIXEL")
    heat_map_listeners.append(synchronise)


def unregister() -> None:
    global _handle
    bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = None
    heat_map_listeners.remove(synchronise)
    remove_handlers(HANDLERS)
    do_not_call(_synchronise)
    _forget_painting()
