# SPDX-License-Identifier: GPL-3.0-or-later
"""Which results are stale: those that were touched are examined later, and the answer is kept until they are touched
again. Operators that rely on a result examine it themselves, by the same function."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import bpy

from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.object_state import KnownDescriptions
from . import fingerprint, measured_state, results, watch

Answer = TypeVar("Answer")

# In Edit Mode a larger mesh is not read again after every change: any change of its geometry makes its result stale.
LARGEST_EDITED_FACE_COUNT = 200_000

_touched: set[int] = set()
_stale: set[int] = set()
_uncovered: set[int] = set()

# What has changed since measurements on meshes were made, by the session identifiers of these.
_changes: dict[int, str] = {}
_own_writes: set[int] = set()

# By the session identifier of an object, the meshes that were measured against its limit surface.
_measured_against: dict[int, set[int]] = {}


def is_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has changed since its result was computed, as far as examined."""
    return mesh.session_uid in _stale


def is_uncovered(blender_object: bpy.types.Object) -> bool:
    """Whether the result on the object's mesh was not computed for an object like it, as far as examined."""
    return blender_object.session_uid in _uncovered


def change_since_measured(mesh: bpy.types.Mesh) -> str:
    """What has changed since the measurement on the mesh was made, as far as examined; empty where it holds."""
    return _changes.get(mesh.session_uid, "")


def note_deviation(measured: bpy.types.Object) -> None:
    """Note a new measurement on the object's mesh: the next change of its geometry is the writing of it."""
    _changes.pop(measured.data.session_uid, None)
    _own_writes.add(measured.data.session_uid)
    _note_target(measured)


def _note_target(measured: bpy.types.Object) -> None:
    target = measured_state.target_of(measured) if results.has_deviation(measured.data) else None
    if target is not None:
        _measured_against.setdefault(target.session_uid, set()).add(measured.data.session_uid)


def out_of_date(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of the objects whose results no longer hold, examined now; panels show the same."""
    context.view_layer.update()
    _examine({blender_object.data.session_uid for blender_object in objects})
    return [holder for holder in objects if is_stale(holder.data) or is_uncovered(holder)]


def note_write(mesh: bpy.types.Mesh) -> None:
    """Note a new result on the mesh: the next change of its geometry is the writing of it."""
    _stale.discard(mesh.session_uid)
    _own_writes.add(mesh.session_uid)


def _check_touched() -> bool:
    """Examine the results of the meshes that were touched, and remember which no longer hold."""
    touched = set(_touched)
    _touched.clear()
    return _examine(touched)


def _examine(uids: set[int]) -> bool:
    """Examine the results on these meshes; returns whether there are any."""
    users = _users_of_results(uids)
    known: KnownDescriptions = {}
    for mesh, objects in users.items():
        if results.has_result(mesh):
            # What cannot be examined counts as stale.
            found = _tried(fingerprint.examine, mesh, objects, known)
            uncovered = set(found.uncovered) if found else set()
            _set(_stale, mesh, found is None or found.has_changed)
            for holder in objects:
                _set(_uncovered, holder, holder in uncovered)
        _changes.pop(mesh.session_uid, None)
        if results.has_deviation(mesh):
            change = _tried(measured_state.change, mesh, objects)
            _changes[mesh.session_uid] = "objects changed" if change is None else change
    return bool(users)


def _tried(examine: Callable[..., Answer], *given: Any) -> Answer | None:
    """What the function returns; None, with a message on the console, where it fails."""
    try:
        return examine(*given)
    except Exception:
        traceback.print_exc()
        return None


def _set(holders: set[int], holder: bpy.types.ID, wanted: bool) -> None:
    if wanted:
        holders.add(holder.session_uid)
    else:
        holders.discard(holder.session_uid)


def _users_of_results(uids: set[int]) -> dict[bpy.types.Mesh, list[bpy.types.Object]]:
    """The meshes among these that hold a result, and the objects that use each."""
    users: dict[bpy.types.Mesh, list[bpy.types.Object]] = {
        mesh: [] for mesh in bpy.data.meshes if mesh.session_uid in uids and results.has_any(mesh)
    }
    for blender_object in bpy.data.objects if users else ():
        if blender_object.data in users:
            users[blender_object.data].append(blender_object)
    return users


def touch(mesh: bpy.types.Mesh) -> None:
    """Examine the mesh's result soon."""
    _touched.add(mesh.session_uid)
    watch.examine_soon()


def _notice_update(holder: bpy.types.Object, geometry: bool) -> bool:
    if holder.type != "MESH":
        return False
    _touched.update(_measured_against.get(holder.session_uid, ()))
    if results.has_any(holder.data):
        _notice_change(holder.data, geometry)
    return bool(_touched)


def _notice_change(mesh: bpy.types.Mesh, geometry: bool) -> None:
    own_write = geometry and mesh.session_uid in _own_writes
    if geometry:
        _own_writes.discard(mesh.session_uid)
    if not mesh.is_editmode or mesh_face_count(mesh) <= LARGEST_EDITED_FACE_COUNT:
        _touched.add(mesh.session_uid)
    elif geometry and not own_write:
        _stale.add(mesh.session_uid)
        _changes[mesh.session_uid] = f"“{mesh.name}” changed"


def _touch_everything() -> bool:
    for each in bpy.data.objects:
        if each.type == "MESH" and results.has_any(each.data):
            _note_target(each)
            _touched.add(each.data.session_uid)
    return bool(_touched)


def _forget_everything() -> None:
    for runtime in (_touched, _stale, _uncovered, _changes, _own_writes, _measured_against):
        runtime.clear()


watch.clients.append(
    watch.Client(
        forget=_forget_everything,
        updated=_notice_update,
        frame_changed=_touch_everything,
        replaced=_touch_everything,
        examine=_check_touched,
    )
)
