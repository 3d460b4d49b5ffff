# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects are sources of results, and which results' sources have changed, found without computing anything while
the interface is drawn.

Listeners are told when sources of results that are kept updated have left Edit Mode.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

import bpy

from . import result_record, watch

# Called when the source of a result that is to be kept updated has left Edit Mode changed; operators register here.
edited_source_listeners: list[Callable[[], None]] = []

# By the session identifier of a source, those of its results.
_results: dict[int, set[int]] = {}
_object_count = -1

_touched: set[int] = set()
_changed: set[int] = set()

# Sources that are in Edit Mode, and those that have left it since they were examined last.
_edited: set[int] = set()
_left: set[int] = set()

# Results that are to be made anew because of that.
_due: set[int] = set()


def has_results(blender_object: bpy.types.Object) -> bool:
    """Whether results came from this object, as far as known."""
    return bool(uids_of_results(blender_object.session_uid))


def uids_of_results(source_uid: int) -> set[int]:
    """The session identifiers of the results that came from the object with this one, as far as known."""
    if len(bpy.data.objects) != _object_count:
        _find_results()
    return _results.get(source_uid, set())


def has_changed(result: bpy.types.Object) -> bool:
    """Whether the result's source has changed since the result was made, as far as examined."""
    return result.session_uid in _changed


def due_results() -> list[bpy.types.Object]:
    """The results that are to be made anew because their sources have left Edit Mode."""
    if not _due:
        return []
    return [each for each in bpy.data.objects if each.session_uid in _due and each.ccdepth.keep_updated]


def no_longer_due(results: list[bpy.types.Object]) -> None:
    """Do not make these anew before their sources leave Edit Mode again."""
    _due.difference_update(each.session_uid for each in results)


def due_again(results: list[bpy.types.Object]) -> None:
    """Make these anew when nothing has happened for a while."""
    _due.update(each.session_uid for each in results)
    watch.examine_soon()


def remember_made(result: bpy.types.Object, source: bpy.types.Object, *given: Any) -> None:
    """Write to the result that it has just been made from the source: see ``result_record.remember``."""
    result_record.remember(result, source, *given)
    _changed.discard(result.session_uid)
    _due.discard(result.session_uid)
    _results.setdefault(source.session_uid, set()).add(result.session_uid)


def _check_touched() -> bool:
    """Examine the results of the sources that were touched."""
    touched = set(_touched)
    _touched.clear()
    sources = [each for each in bpy.data.objects if each.session_uid in touched] if touched else []
    # What is being edited is examined when it leaves Edit Mode.
    found = [_examine(source) for source in sources if source.type == "MESH" and not source.data.is_editmode]
    if due_results():
        for listener in edited_source_listeners:
            listener()
    return any(found)


def _examine(source: bpy.types.Object) -> bool:
    """Compare the source with what its results were made from; returns whether there are any."""
    has_left = source.session_uid in _left
    _left.discard(source.session_uid)
    results = result_record.results_of(source)
    for result in results:
        try:
            changed = result_record.source_has_changed(result, source)
        except Exception:
            # What cannot be examined counts as changed.
            traceback.print_exc()
            changed = True
        (_changed.add if changed else _changed.discard)(result.session_uid)
        if changed and has_left and _is_kept_updated(result):
            _due.add(result.session_uid)
    return bool(results)


def _is_kept_updated(result: bpy.types.Object) -> bool:
    """Whether the result is made anew without asking: not if its own mesh was edited, or is just being edited."""
    return result.ccdepth.keep_updated and not result.data.is_editmode and not result_record.is_edited(result)


def _notice_update(source: bpy.types.Object, _geometry: bool) -> bool:
    uid = source.session_uid
    if not uids_of_results(uid):
        return False
    _touched.add(uid)
    if source.mode == "EDIT":
        _edited.add(uid)
    elif uid in _edited:
        _edited.discard(uid)
        _left.add(uid)
    return True


def _find_results() -> None:
    """Look at all objects of the file."""
    global _object_count
    _results.clear()
    for each in bpy.data.objects:
        source = result_record.source_of(each) if each.type == "MESH" else None
        if source is not None:
            _results.setdefault(source.session_uid, set()).add(each.session_uid)
    _object_count = len(bpy.data.objects)


def _touch_known() -> bool:
    _touched.update(_results)
    return bool(_results)


def _begin_anew() -> bool:
    """After undo, redo and loading: they must not be followed by something that is made anew."""
    for runtime in (_edited, _left, _due):
        runtime.clear()
    _find_results()
    return _touch_known()


def _forget_everything() -> None:
    global _object_count
    for runtime in (_results, _touched, _changed, _edited, _left, _due):
        runtime.clear()
    _object_count = -1


watch.clients.append(
    watch.Client(
        forget=_forget_everything,
        updated=_notice_update,
        frame_changed=_touch_known,
        replaced=_begin_anew,
        examine=_check_touched,
    )
)
