# SPDX-License-Identifier: GPL-3.0-or-later
"""Which results are stale, found without computing anything while the interface is drawn.

A handler only notes which meshes with a result were touched. A timer examines them later and keeps the answer until
they are touched again. Operators that rely on a result examine it themselves, by the same function.
"""

from __future__ import annotations

import traceback
from collections.abc import Sequence
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.object_state import KnownDescriptions
from ..registration import add_handlers, call_soon, do_not_call, remove_handlers
from . import fingerprint, measured_state, results, viewports

# In Edit Mode a larger mesh is not read again after every change: any change of its geometry makes its result stale.
LARGEST_EDITED_FACE_COUNT = 200_000

_touched: set[int] = set()
_stale: set[int] = set()
_uncovered: set[int] = set()
_stale_deviations: set[int] = set()
_own_writes: set[int] = set()

# By the name of an object, the meshes that were measured against its limit surface.
_measured_against: dict[str, set[int]] = {}


def is_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has changed since its result was computed, as far as examined."""
    return mesh.session_uid in _stale


def is_uncovered(blender_object: bpy.types.Object) -> bool:
    """Whether the result on the object's mesh was not computed for an object like it, as far as examined."""
    return blender_object.session_uid in _uncovered


def is_deviation_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the measurement on the mesh no longer holds, as far as examined."""
    return mesh.session_uid in _stale_deviations


def note_deviation(mesh: bpy.types.Mesh) -> None:
    """Note a new measurement on the mesh: the next change of its geometry is the writing of it."""
    _stale_deviations.discard(mesh.session_uid)
    _own_writes.add(mesh.session_uid)
    _note_target(mesh)


def _note_target(mesh: bpy.types.Mesh) -> None:
    if results.has_deviation(mesh):
        _measured_against.setdefault(mesh.ccdepth.measurement.against, set()).add(mesh.session_uid)


def out_of_date(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """Those of the objects whose results no longer hold, examined now; panels show the same."""
    context.view_layer.update()
    _examine({blender_object.data.session_uid for blender_object in objects})
    return [holder for holder in objects if is_stale(holder.data) or is_uncovered(holder)]


def note_write(mesh: bpy.types.Mesh) -> None:
    """Note a new result on the mesh: the next change of its geometry is the writing of it."""
    _stale.discard(mesh.session_uid)
    _own_writes.add(mesh.session_uid)


def note_colors(mesh: bpy.types.Mesh) -> None:
    """Note new colours on the mesh: the next change of its geometry is the writing of them."""
    _own_writes.add(mesh.session_uid)


def check_touched() -> None:
    """Examine the results of the meshes that were touched, and remember which no longer hold."""
    touched = set(_touched)
    _touched.clear()
    if _examine(touched):
        viewports.redraw(bpy.context)


def _examine(uids: set[int]) -> bool:
    """Examine the results on these meshes; returns whether there are any."""
    users = _users_of_results(uids)
    known: KnownDescriptions = {}
    for mesh, objects in users.items():
        _set(_stale_deviations, mesh, results.has_deviation(mesh) and _is_measured_otherwise(mesh))
        if not results.has_result(mesh):
            continue
        try:
            found = fingerprint.examine(mesh, objects, known)
        except Exception:
            # What cannot be examined counts as stale.
            traceback.print_exc()
            found = fingerprint.Examination(True, [])
        uncovered = set(found.uncovered)
        _set(_stale, mesh, found.has_changed)
        for holder in objects:
            _set(_uncovered, holder, holder in uncovered)
    return bool(users)


def _is_measured_otherwise(mesh: bpy.types.Mesh) -> bool:
    try:
        return measured_state.has_changed(mesh)
    except Exception:
        traceback.print_exc()
        return True


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
    _touch({mesh.session_uid})


def _touch(uids: set[int]) -> None:
    _touched.update(uids)
    call_soon(check_touched)


@persistent
def _notice_updates(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if not (update.is_updated_geometry or update.is_updated_transform):
            continue
        original = update.id.original
        if not isinstance(original, bpy.types.Object) or original.type != "MESH":
            continue
        if results.has_any(original.data):
            _notice_update(original.data, update.is_updated_geometry)
        if original.name in _measured_against:
            _touch(_measured_against[original.name])


def _notice_update(mesh: bpy.types.Mesh, geometry: bool) -> None:
    own_write = geometry and mesh.session_uid in _own_writes
    if geometry:
        _own_writes.discard(mesh.session_uid)
    if not mesh.is_editmode or mesh_face_count(mesh) <= LARGEST_EDITED_FACE_COUNT:
        touch(mesh)
    elif geometry and not own_write:
        _stale.add(mesh.session_uid)
        _stale_deviations.add(mesh.session_uid)


@persistent
def _touch_everything(*_: Any) -> None:
    """After undo, redo and loading, which may replace data as a whole, and after a change of the frame: Blender
    reports no updates of what is animated."""
    for mesh in bpy.data.meshes:
        if results.has_any(mesh):
            _note_target(mesh)
            touch(mesh)


@persistent
def _forget_everything(*_: Any) -> None:
    for runtime in (_touched, _stale, _uncovered, _stale_deviations, _own_writes, _measured_against):
        runtime.clear()


HANDLERS = (
    ("depsgraph_update_post", _notice_updates),
    ("frame_change_post", _touch_everything),
    ("undo_post", _touch_everything),
    ("redo_post", _touch_everything),
    ("load_pre", _forget_everything),
    ("load_post", _touch_everything),
)


def register() -> None:
    add_handlers(HANDLERS)


def unregister() -> None:
    remove_handlers(HANDLERS)
    do_not_call(check_touched)
    _forget_everything()
