# SPDX-License-Identifier: GPL-3.0-or-later
"""The changes of objects' geometry by other data, like a mirror object or a texture, counted during a session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from secrets import token_hex

import bpy

# Modes in which an object's own mesh changes in a way that no checksum tells.
PAINTING = {"WEIGHT_PAINT", "SCULPT"}

# The mark of this session, and what it knows of objects by their identifiers: how often other data have changed their
# geometry, and whether frames change it.
_session = token_hex(4)
_changes: dict[int, int] = {}
_animated: set[int] = set()
_is_paused = False


def known_changes(blender_object: bpy.types.Object) -> str:
    """The session, the number of changes so far, the frame, and whether frames matter, each after a colon."""
    uid = blender_object.session_uid
    animated = "animated" if uid in _animated else ""
    return f"{_session}:{_changes.get(uid, 0)}:{bpy.context.scene.frame_current_final:g}:{animated}"


def note_changes(depsgraph: bpy.types.Depsgraph, *, is_frame: bool) -> None:
    """Count the changes of objects' geometry by other data, from an update of the scene: the object is updated without
    its mesh. is_frame: another frame is shown."""
    if _is_paused:
        return
    updated = [(update.id.original, update.is_updated_geometry) for update in depsgraph.updates]
    ids = {each for each, _ in updated}
    for each, geometry in updated:
        if not geometry or not isinstance(each, bpy.types.Object) or each.type != "MESH":
            continue
        if is_frame:
            _animated.add(each.session_uid)
        elif each.data not in ids or each.mode in PAINTING:
            _changes[each.session_uid] = _changes.get(each.session_uid, 0) + 1


@contextmanager
def paused(context: bpy.types.Context) -> Iterator[None]:
    """Count no changes while temporary objects come and go in the scene."""
    global _is_paused
    was_paused = _is_paused
    context.view_layer.update()
    _is_paused = True
    try:
        yield
    finally:
        context.view_layer.update()
        _is_paused = was_paused


def begin_session() -> None:
    """Begin to count anew, with another file."""
    global _session
    _session = token_hex(4)
    _changes.clear()
    _animated.clear()
