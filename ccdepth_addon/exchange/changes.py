# SPDX-License-Identifier: GPL-3.0-or-later
"""The changes that Blender tells of during a session: of objects' geometry by other data, like a mirror object or a
texture, counted; and of meshes, whose checksums are kept until then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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

# Checksums of meshes, by their identifiers and by the functions that make them.
_checksums: dict[tuple[int, Callable[[bpy.types.Mesh], int]], int] = {}


def known_changes(blender_object: bpy.types.Object) -> str:
    """The session, the number of changes so far, the frame, and whether frames matter, each after a colon."""
    uid = blender_object.session_uid
    animated = "animated" if uid in _animated else ""
    return f"{_session}:{_changes.get(uid, 0)}:{bpy.context.scene.frame_current_final:g}:{animated}"


def known_checksum(mesh: bpy.types.Mesh, checksum_of: Callable[[bpy.types.Mesh], int]) -> int:
    """A checksum of a mesh outside Edit Mode, made once for each change that Blender tells of."""
    key = mesh.session_uid, checksum_of
    if key not in _checksums:
        _checksums[key] = checksum_of(mesh)
    return _checksums[key]


def forget_checksums() -> None:
    """Make all checksums anew: scripts need not tell of their changes."""
    _checksums.clear()


def note_changes(depsgraph: bpy.types.Depsgraph, *, is_frame: bool) -> None:
    """Note an update of the scene. An object that is updated without its mesh was changed by other data. is_frame:
    another frame is shown."""
    updated = [(update.id.original, update.is_updated_geometry) for update in depsgraph.updates]
    ids = {each for each, _ in updated}
    meshes = {each.session_uid for each in ids if isinstance(each, bpy.types.Mesh)}
    for key in [key for key in _checksums if key[0] in meshes]:
        del _checksums[key]
    for each, geometry in [] if _is_paused else updated:
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
    for noted in (_changes, _animated, _checksums):
        noted.clear()
