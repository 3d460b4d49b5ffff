# SPDX-License-Identifier: GPL-3.0-or-later
"""The depths and deviations that no longer hold, and the results with changed sources.

Touched objects are examined when nothing has happened for a while, and the answer is kept until they are touched again.
Operators that rely on depths examine them by the same function.
"""

from __future__ import annotations

import traceback
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import NDArray

from ..exchange.changes import begin_session, forget_checksums
from ..exchange.dependencies import ObjectState
from ..tasks.depth_task import DepthSettings, MeshDepths
from ..tasks.deviation_task import MeasureSettings, MeshDeviation
from . import mesh_values, result_record, still_holds

Answer = TypeVar("Answer")


@dataclass
class Noted:
    """The notes of a session on a mesh or an object, as far as examined.

    is_stale: whether a mesh has changed since its depths were computed, or a result's source since it made the result.
    is_unchecked: whether these depend on other data that may have changed before the file was opened. change: the
    change since the measurement on a mesh; empty where it holds. is_uncovered: whether the depths on the object's mesh
    were not computed for an object like it. is_touched: whether the object was updated since it was examined.
    is_edited: whether it was updated in Edit Mode; has_left: whether it has left Edit Mode, or was made anew, since its
    results were examined. is_due: whether a result is to be made anew for that reason. measured, results: by their
    session identifiers, the meshes measured against the object's limit surface, and its results.
    """

    is_stale: bool = False
    is_unchecked: bool = False
    change: str = ""
    is_uncovered: bool = False
    is_touched: bool = False
    is_edited: bool = False
    has_left: bool = False
    is_due: bool = False
    measured: set[int] = field(default_factory=set)
    results: set[int] = field(default_factory=set)


# By session identifiers.
_notes: defaultdict[int, Noted] = defaultdict(Noted)

# The number of objects when results were last looked for.
_object_count = -1


def noted(holder: bpy.types.ID) -> Noted:
    """The notes on a mesh or an object."""
    return _notes[holder.session_uid]


def is_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has changed since its depths were computed, as far as examined."""
    return noted(mesh).is_stale


def out_of_date(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> list[bpy.types.Object]:
    """The objects whose depths no longer hold, examined now; panels show the same."""
    context.view_layer.update()
    forget_checksums()
    _examine([each.data for each in objects])
    return [
        each
        for each in objects
        if noted(each.data).is_stale or noted(each.data).is_unchecked or noted(each).is_uncovered
    ]


def write_depths(holders: Sequence[bpy.types.Object], answers: Sequence[MeshDepths], settings: DepthSettings) -> None:
    """Write answers, with their records and inputs, to the meshes of these objects, all or none. Raises
    ComputeError."""
    mesh_values.write_depths(holders, answers, settings)
    inputs = [(answer.task.geometry, answer.depths, answer.task.states) for answer in answers]
    remember_depths(dict(zip([holder.data for holder in holders], inputs, strict=True)))


def write_deviations(
    measured: Mapping[bpy.types.Object, bpy.types.Object],
    answers: Sequence[MeshDeviation],
    settings: MeasureSettings,
    states: Mapping[int, still_holds.MeasuredState],
) -> None:
    """Write answers, with their records and inputs, to the meshes of measured objects, all or none. measured: each with
    the object of the limit surface; states: by their session identifiers, as they were read. Raises ComputeError."""
    mesh_values.write_deviations([*measured], answers, settings)
    for each, target in measured.items():
        _remember_measurement(each, target, states[each.session_uid])


def remember_depths(written: Mapping[bpy.types.Mesh, tuple[int, NDArray[np.int32], Sequence[ObjectState]]]) -> None:
    """Write the inputs of new depths to their meshes (``still_holds.remember_depths``), after our last change of
    these."""
    changes = {mesh: noted(mesh).change for mesh in written}
    for mesh, inputs in written.items():
        still_holds.remember_depths(mesh, *inputs)
    bpy.context.view_layer.update()
    for mesh, change in changes.items():
        note = noted(mesh)
        note.change, note.is_stale, note.is_unchecked = change, False, False
    for each in bpy.data.objects:
        if each.data in written:
            noted(each).is_uncovered = False


def _remember_measurement(measured: bpy.types.Object, *given: Any) -> None:
    """Write the inputs of a new measurement to the object and its mesh (``still_holds.remember_measurement``), after
    its last change by us."""
    note = noted(measured.data)
    was_stale = note.is_stale
    still_holds.remember_measurement(measured, *given)
    bpy.context.view_layer.update()
    note.is_stale, note.change = was_stale, ""
    _note_target(measured)


def remember_made(result: bpy.types.Object, source: bpy.types.Object, *given: Any) -> None:
    """Record on the result that the source has just made it (``result_record.remember``), and let both be examined: the
    source may have changed during the run, and results of the result follow."""
    result_record.remember(result, source, *given)
    of_result, of_source = noted(result), noted(source)
    of_result.is_stale = of_result.is_unchecked = of_result.is_due = False
    of_result.is_touched = of_result.has_left = of_source.is_touched = True
    of_source.results.add(result.session_uid)


def _note_target(measured: bpy.types.Object) -> None:
    target = still_holds.target_of(measured) if mesh_values.has_deviation(measured.data) else None
    if target is not None:
        noted(target).measured.add(measured.data.session_uid)


def has_results(blender_object: bpy.types.Object) -> bool:
    """Whether results came from this object, as far as known."""
    _find_new_results()
    return bool(noted(blender_object).results)


def due_results() -> list[bpy.types.Object]:
    """The results that are to be made anew because their sources have left Edit Mode, or were made anew."""
    due = {uid for uid, note in _notes.items() if note.is_due}
    return [each for each in bpy.data.objects if each.session_uid in due and each.ccdepth.keep_updated] if due else []


def none_due() -> None:
    """Leave results out of date until the next edit of their sources."""
    for note in _notes.values():
        note.is_due = False


def examine_touched() -> bool:
    """Examine the values and results of touched objects; returns whether there are any. Edited data are examined when
    they leave Edit Mode."""
    chosen = {uid for uid, note in _notes.items() if note.is_touched}
    if chosen:
        _find_new_results()
    touched = [each for each in bpy.data.objects if each.session_uid in chosen] if chosen else []
    others = {uid for each in touched for uid in noted(each).measured}
    meshes = {each.data for each in touched}
    if others:
        meshes.update(each for each in bpy.data.meshes if each.session_uid in others)
    for uid in chosen:
        _notes[uid].is_touched = False
    found = [_examine([each for each in meshes if not each.is_editmode])]
    found += [_examine_results_of(each) for each in touched if not each.data.is_editmode]
    return any(found)


def _examine(meshes: Iterable[bpy.types.Mesh]) -> bool:
    """Examine the depths and deviations on these meshes; returns whether there are any."""
    users = _users_of_values(meshes)
    for mesh, objects in users.items():
        note = noted(mesh)
        if mesh_values.has_depths(mesh):
            # Depths that cannot be examined count as stale.
            found = _tried(still_holds.STALE, still_holds.examine, mesh, objects)
            note.is_stale, note.is_unchecked = found.has_changed, found.is_unchecked
            for each in objects:
                noted(each).is_uncovered = each in found.uncovered
        note.change = ""
        if mesh_values.has_deviation(mesh):
            note.change = _tried("objects changed", still_holds.change_since_measured, mesh, objects)
    return bool(users)


def _examine_results_of(source: bpy.types.Object) -> bool:
    """Compare the source with the records of its results; returns whether there are any results."""
    has_left, noted(source).has_left = noted(source).has_left, False
    made = result_record.results_of(source) if noted(source).results else []
    for result in made:
        # A source that cannot be examined counts as changed.
        same: bool | None = False
        same, note = _tried(same, result_record.source_is_same, result, source), noted(result)
        note.is_stale, note.is_unchecked = same is False, same is None
        note.is_due |= note.is_stale and has_left and _is_kept_updated(result)
    return bool(made)


def _is_kept_updated(result: bpy.types.Object) -> bool:
    """Whether the result is made anew automatically: only while its own mesh is unchanged."""
    return result.ccdepth.keep_updated and not result.data.is_editmode and not result_record.is_edited(result)


def _tried(otherwise: Answer, examine: Callable[..., Answer], *given: Any) -> Answer:
    """The answer of the function, or another one, with a message on the console, where the function fails."""
    try:
        return examine(*given)
    except Exception:
        traceback.print_exc()
        return otherwise


def _users_of_values(meshes: Iterable[bpy.types.Mesh]) -> dict[bpy.types.Mesh, list[bpy.types.Object]]:
    """The meshes among these with depths or deviations, and the objects that use each."""
    users: dict[bpy.types.Mesh, list[bpy.types.Object]] = {mesh: [] for mesh in meshes if mesh_values.has_any(mesh)}
    for blender_object in bpy.data.objects if users else ():
        if blender_object.data in users:
            users[blender_object.data].append(blender_object)
    return users


def notice_update(holder: bpy.types.Object, geometry: bool) -> bool:
    """Note an update of an object, of its geometry or its place alone; returns whether to examine anything."""
    if holder.type != "MESH":
        return False
    note, mesh = noted(holder), holder.data
    has_values = mesh_values.has_any(mesh)
    note.is_touched |= has_values or bool(note.results) or bool(note.measured)
    if not mesh.is_editmode:
        note.has_left |= note.is_edited
        note.is_edited = False
    elif geometry and not note.is_edited:
        note.is_edited = True
    elif geometry and has_values:
        # Edited since; whether that matters is examined after Edit Mode.
        noted(mesh).is_stale, noted(mesh).change = True, f"“{holder.name}” changed"
    return note.is_touched


def _find_results() -> None:
    """Look at all objects of the file."""
    global _object_count
    for note in _notes.values():
        note.results.clear()
    for each in bpy.data.objects:
        source = result_record.source_of(each) if each.type == "MESH" else None
        if source is not None:
            noted(source).results.add(each.session_uid)
    _object_count = len(bpy.data.objects)


def _find_new_results() -> None:
    # Blender counts its objects one by one.
    if len(bpy.data.objects) != _object_count:
        _find_results()


def touch_everything() -> bool:
    """Note all objects with values and results; returns whether to examine any."""
    _find_new_results()
    for each in bpy.data.objects:
        if each.type == "MESH":
            has_values = mesh_values.has_any(each.data)
            if has_values:
                _note_target(each)
            noted(each).is_touched |= has_values or bool(noted(each).results)
    return any(note.is_touched for note in _notes.values())


def begin_anew() -> bool:
    """``touch_everything`` after undo, redo and loading, without results that are due."""
    forget_checksums()
    for note in _notes.values():
        note.is_edited = note.has_left = note.is_due = False
    _find_results()
    return touch_everything()


def forget_everything() -> None:
    global _object_count
    _notes.clear()
    _object_count = -1
    begin_session()
