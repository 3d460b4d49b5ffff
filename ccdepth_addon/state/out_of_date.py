# SPDX-License-Identifier: GPL-3.0-or-later
"""The depths and deviations that no longer hold, and the results with changed sources. Touched data are examined when
nothing has happened for a while, and the answer is kept until they are touched again. Operators that rely on depths
examine them by the same function.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import bpy

from ..exchange.changes import begin_session
from . import mesh_values, result_record, still_holds, watch

Answer = TypeVar("Answer")

# All by session identifiers: touched meshes, meshes with stale depths, and meshes that have entered Edit Mode; and
# objects without depths computed for them.
_touched: set[int] = set()
_stale: set[int] = set()
_unchecked: set[int] = set()
_entered: set[int] = set()
_uncovered: set[int] = set()

# The changes since the measurements on meshes.
_changes: dict[int, str] = {}

# By an object, the meshes measured against its limit surface; by a source, its results.
_measured_against: dict[int, set[int]] = {}
_results: dict[int, set[int]] = {}
_object_count = -1

# Touched sources, sources in Edit Mode, and sources that have left Edit Mode, or were made anew, since they were last
# examined.
_touched_sources: set[int] = set()
_edited: set[int] = set()
_left: set[int] = set()

# Results with changed sources, and results to be made anew for that reason.
_changed: set[int] = set()
_due: set[int] = set()


def is_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has changed since its depths were computed, as far as examined."""
    return mesh.session_uid in _stale


def is_unchecked(holder: bpy.types.ID) -> bool:
    """Whether depths on a mesh, or a result, depend on other data that may have changed before the file was opened."""
    return holder.session_uid in _unchecked


def is_uncovered(blender_object: bpy.types.Object) -> bool:
    """Whether the depths on the object's mesh were not computed for an object like it, as far as examined."""
    return blender_object.session_uid in _uncovered


def change_since_measured(mesh: bpy.types.Mesh) -> str:
    """The changes since the measurement on the mesh was made, as far as examined; empty where it holds."""
    return _changes.get(mesh.session_uid, "")


def out_of_date(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """The objects whose depths no longer hold, examined now; panels show the same."""
    context.view_layer.update()
    _examine({blender_object.data.session_uid for blender_object in objects})
    return [each for each in objects if is_stale(each.data) or is_unchecked(each.data) or is_uncovered(each)]


def remember_depths(mesh: bpy.types.Mesh, *given: Any) -> None:
    """Write the inputs of new depths to the mesh (``still_holds.remember_depths``), after its last change by us."""
    change = _changes.get(mesh.session_uid)
    still_holds.remember_depths(mesh, *given)
    bpy.context.view_layer.update()
    if change is None:
        _changes.pop(mesh.session_uid, None)
    for each in (_stale, _unchecked):
        each.discard(mesh.session_uid)
    _uncovered.difference_update(each.session_uid for each in bpy.data.objects if each.data == mesh)


def remember_measurement(measured: bpy.types.Object, *given: Any) -> None:
    """Write the inputs of a new measurement to the object and its mesh (``still_holds.remember_measurement``), after
    its last change by us."""
    was_stale = is_stale(measured.data)
    still_holds.remember_measurement(measured, *given)
    bpy.context.view_layer.update()
    _set(_stale, measured.data, was_stale)
    _changes.pop(measured.data.session_uid, None)
    _note_target(measured)


def _note_target(measured: bpy.types.Object) -> None:
    target = still_holds.target_of(measured) if mesh_values.has_deviation(measured.data) else None
    if target is not None:
        _measured_against.setdefault(target.session_uid, set()).add(measured.data.session_uid)


def has_results(blender_object: bpy.types.Object) -> bool:
    """Whether results came from this object, as far as known."""
    return bool(uids_of_results(blender_object.session_uid))


def uids_of_results(source_uid: int) -> set[int]:
    """The session identifiers of the results that came from the object with this one, as far as known."""
    if len(bpy.data.objects) != _object_count:
        _find_results()
    return _results.get(source_uid, set())


def source_has_changed(result: bpy.types.Object) -> bool:
    """Whether the result's source has changed since the result was made, as far as examined."""
    return result.session_uid in _changed


def due_results() -> list[bpy.types.Object]:
    """The results that are to be made anew because their sources have left Edit Mode, or were made anew."""
    if not _due:
        return []
    return [each for each in bpy.data.objects if each.session_uid in _due and each.ccdepth.keep_updated]


def none_due() -> None:
    """Leave results out of date until the next edit of their sources."""
    _due.clear()


def remember_made(result: bpy.types.Object, source: bpy.types.Object, *given: Any) -> None:
    """Record on the result that the source has just made it (``result_record.remember``), and let both be examined: the
    source may have changed during the run, and results of the result follow."""
    result_record.remember(result, source, *given)
    _touched_sources.update((source.session_uid, result.session_uid))
    _left.add(result.session_uid)
    _changed.discard(result.session_uid)
    _unchecked.discard(result.session_uid)
    _due.discard(result.session_uid)
    _results.setdefault(source.session_uid, set()).add(result.session_uid)


def _examine_touched() -> bool:
    """Examine touched meshes and sources; returns whether there are any."""
    sources = set(_touched_sources)
    # Edited meshes are examined when they leave Edit Mode.
    touched = {each.session_uid for each in bpy.data.meshes if each.session_uid in _touched and not each.is_editmode}
    _touched.clear()
    _touched_sources.clear()
    found = [_examine(touched)]
    # Edited data are examined when they leave Edit Mode.
    for each in bpy.data.objects if sources else ():
        if each.session_uid in sources and each.type == "MESH" and not each.data.is_editmode:
            found.append(_examine_results_of(each))
    return any(found)


def _examine(uids: set[int]) -> bool:
    """Examine the depths and deviations on these meshes; returns whether there are any."""
    users = _users_of_values(uids)
    for mesh, objects in users.items():
        if mesh_values.has_depths(mesh):
            # Depths that cannot be examined count as stale.
            found = _tried(still_holds.examine, mesh, objects)
            uncovered = set(found.uncovered) if found else set()
            _set(_stale, mesh, found is None or found.has_changed)
            _set(_unchecked, mesh, found is not None and found.is_unchecked)
            for holder in objects:
                _set(_uncovered, holder, holder in uncovered)
        _changes.pop(mesh.session_uid, None)
        if mesh_values.has_deviation(mesh):
            change = _tried(still_holds.change_since_measured, mesh, objects)
            _changes[mesh.session_uid] = "objects changed" if change is None else change
    return bool(users)


def _examine_results_of(source: bpy.types.Object) -> bool:
    """Compare the source with the records of its results; returns whether there are any results."""
    has_left = source.session_uid in _left
    _left.discard(source.session_uid)
    made = result_record.results_of(source)
    for result in made:
        # A source that cannot be examined counts as changed.
        try:
            is_same = result_record.source_is_same(result, source)
        except Exception:
            traceback.print_exc()
            is_same = False
        changed = is_same is False
        _set(_changed, result, changed)
        _set(_unchecked, result, is_same is None)
        if changed and has_left and _is_kept_updated(result):
            _due.add(result.session_uid)
    return bool(made)


def _is_kept_updated(result: bpy.types.Object) -> bool:
    """Whether the result is made anew automatically: only while its own mesh is unchanged."""
    return result.ccdepth.keep_updated and not result.data.is_editmode and not result_record.is_edited(result)


def _tried(examine: Callable[..., Answer], *given: Any) -> Answer | None:
    """The answer of the function; None, with a message on the console, where the function fails."""
    try:
        return examine(*given)
    except Exception:
        traceback.print_exc()
        return None


def _set(holders: set[int], holder: bpy.types.ID, wanted: bool) -> None:
    (holders.add if wanted else holders.discard)(holder.session_uid)


def _users_of_values(uids: set[int]) -> dict[bpy.types.Mesh, list[bpy.types.Object]]:
    """The meshes among these with depths or deviations, and the objects that use each."""
    users: dict[bpy.types.Mesh, list[bpy.types.Object]] = {
        mesh: [] for mesh in bpy.data.meshes if mesh.session_uid in uids and mesh_values.has_any(mesh)
    }
    for blender_object in bpy.data.objects if users else ():
        if blender_object.data in users:
            users[blender_object.data].append(blender_object)
    return users


def touch(mesh: bpy.types.Mesh) -> None:
    """Let the mesh's depths and deviations be examined soon."""
    _touched.add(mesh.session_uid)
    watch.examine_soon()


def _notice_update(holder: bpy.types.Object, geometry: bool) -> bool:
    if holder.type == "MESH":
        _touched.update(_measured_against.get(holder.session_uid, ()))
        if mesh_values.has_any(holder.data):
            _notice_change(holder, geometry)
    uid = holder.session_uid
    if uids_of_results(uid):
        _touched_sources.add(uid)
        # Another object may edit the mesh.
        if holder.type == "MESH" and holder.data.is_editmode:
            _edited.add(uid)
        elif uid in _edited:
            _edited.discard(uid)
            _left.add(uid)
    return bool(_touched or _touched_sources)


def _notice_change(holder: bpy.types.Object, geometry: bool) -> None:
    mesh = holder.data
    if not mesh.is_editmode:
        _entered.discard(mesh.session_uid)
        _touched.add(mesh.session_uid)
    elif geometry and mesh.session_uid not in _entered:
        _entered.add(mesh.session_uid)
    elif geometry:
        # Edited since; whether that matters is examined after Edit Mode.
        _stale.add(mesh.session_uid)
        _changes[mesh.session_uid] = f"“{holder.name}” changed"


def _find_results() -> None:
    """Look at all objects of the file."""
    global _object_count
    _results.clear()
    for each in bpy.data.objects:
        source = result_record.source_of(each) if each.type == "MESH" else None
        if source is not None:
            _results.setdefault(source.session_uid, set()).add(each.session_uid)
    _object_count = len(bpy.data.objects)


def _touch_everything() -> bool:
    for each in bpy.data.objects:
        if each.type == "MESH" and mesh_values.has_any(each.data):
            _note_target(each)
            _touched.add(each.data.session_uid)
    _touched_sources.update(_results)
    return bool(_touched or _touched_sources)


def _begin_anew() -> bool:
    """Begin anew after undo, redo and loading, without results that are due."""
    for runtime in (_edited, _left, _due):
        runtime.clear()
    _find_results()
    return _touch_everything()


def _forget_everything() -> None:
    global _object_count
    for noted in (_touched, _stale, _unchecked, _entered, _uncovered, _touched_sources, _edited, _left, _changed, _due):
        noted.clear()
    for kept in (_changes, _measured_against, _results):
        kept.clear()
    _object_count = -1
    begin_session()


watch.clients.append(
    watch.Client(
        forget=_forget_everything,
        updated=_notice_update,
        frame_changed=_touch_everything,
        replaced=_begin_anew,
        examine=_examine_touched,
    )
)
