# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's handlers, and one timer, for all that is known of objects during a session.

Nothing is computed while Blender evaluates or draws: objects are noted, and examined once nothing has happened for a
while.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.changes import note_changes
from ..registration import add_handlers, call_soon, do_not_call, is_of_window, redraw, remove_handlers
from . import known, out_of_date

# Called after each examination.
after_examination: list[Callable[[], object]] = []


def examine() -> None:
    """Examine everything that was noted now."""
    if out_of_date.examine_touched():
        redraw(bpy.context)
    for act in after_examination:
        act()


def _notice(depsgraph: bpy.types.Depsgraph, *, is_frame: bool) -> None:
    """Note updated objects. is_frame: another frame is shown; Blender reports not everything that is animated."""
    # In renders the shown frame stays.
    if not is_of_window(depsgraph):
        return
    note_changes(depsgraph, is_frame=is_frame)
    is_any = is_frame and out_of_date.touch_everything()
    for update in depsgraph.updates:
        holder = update.id.original
        if isinstance(holder, bpy.types.Object) and (update.is_updated_geometry or update.is_updated_transform):
            is_any |= out_of_date.notice_update(holder, update.is_updated_geometry)
            known.forget_counts(holder)
    if is_any:
        call_soon(examine)


@persistent
def _notice_updates(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    _notice(depsgraph, is_frame=False)


@persistent
def _notice_frame(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    _notice(depsgraph, is_frame=True)


@persistent
def _notice_replacement(*_: Any) -> None:
    """After undo, redo or loading, all data may be other data."""
    known.forget_what_was_replaced()
    if out_of_date.begin_anew():
        call_soon(examine)


@persistent
def _forget(*_: Any) -> None:
    known.forget_everything()
    out_of_date.forget_everything()


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
