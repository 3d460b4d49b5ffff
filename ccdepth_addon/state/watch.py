# SPDX-License-Identifier: GPL-3.0-or-later
"""One set of handlers and one timer for all data kept during a session.

Nothing is computed while Blender evaluates or draws. Handlers tell the clients about updated and replaced objects;
clients note these objects, and examine them once nothing has happened for a while.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.changes import note_changes
from ..registration import add_handlers, call_soon, do_not_call, is_of_window, remove_handlers


def redraw(context: bpy.types.Context) -> None:
    """Redraw every 3D View, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _nothing(*_: Any) -> bool:
    return False


@dataclass(frozen=True)
class Client:
    """A module that keeps something of objects. The first three return whether there is something to examine.

    updated: Blender has updated an object, its geometry or its place alone. frame_changed: another frame is shown;
    Blender reports not everything that is animated. replaced: after undo, redo or loading, all data may be other data.
    examine: look at the noted objects; returns whether the interface may show something else. forget: everything.
    """

    forget: Callable[[], object] = _nothing
    updated: Callable[[bpy.types.Object, bool], bool] = _nothing
    frame_changed: Callable[[], object] = _nothing
    replaced: Callable[[], object] = _nothing
    examine: Callable[[], bool] = _nothing


# Modules that keep something add themselves.
clients: list[Client] = []


def examine_soon() -> None:
    """Examine everything that was noted when nothing has happened for a while."""
    call_soon(examine)


def examine() -> None:
    """Examine everything that was noted now."""
    answers = [client.examine() for client in clients]
    if any(answers):
        redraw(bpy.context)


def _tell(answers: list[object]) -> None:
    if any(answers):
        examine_soon()


@persistent
def _notice_updates(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    if not is_of_window(depsgraph):
        return
    note_changes(depsgraph, is_frame=False)
    _tell_updates(depsgraph)


def _tell_updates(depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        holder = update.id.original
        if isinstance(holder, bpy.types.Object) and (update.is_updated_geometry or update.is_updated_transform):
            _tell([client.updated(holder, update.is_updated_geometry) for client in clients])


@persistent
def _notice_frame(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    # In renders the shown frame stays.
    if not is_of_window(depsgraph):
        return
    note_changes(depsgraph, is_frame=True)
    _tell_updates(depsgraph)
    _tell([client.frame_changed() for client in clients])


@persistent
def _notice_replacement(*_: Any) -> None:
    _tell([client.replaced() for client in clients])


@persistent
def _forget(*_: Any) -> None:
    for client in clients:
        client.forget()


HANDLERS = (
    ("depsgraph_update_post", _notice_updates),
    ("frame_change_post", _notice_frame),
    ("undo_post", _notice_replacement),
    ("redo_post", _notice_replacement),
    ("load_pre", _forget),
    ("load_post", _notice_replacement),
)


def register() -> None:
    add_handlers(HANDLERS)


def unregister() -> None:
    remove_handlers(HANDLERS)
    do_not_call(examine)
    _forget()
