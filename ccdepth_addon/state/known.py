# SPDX-License-Identifier: GPL-3.0-or-later
"""The facts of a session, stored in no file: the diagonals for relative tolerances, the numbers of faces of adaptive
meshes, the meshes that the last run refused, and the selections shown.

The interface asks for known facts, and computes nothing while it is drawn. Requested and changed diagonals are measured
when nothing has happened for a while, if measuring takes no time; other diagonals are known once an operator has
measured them.
"""

from __future__ import annotations

import traceback
from collections.abc import Iterable, Mapping, Sequence
from time import perf_counter

import bpy
import numpy as np

from ..exchange.control_mesh import ControlMeshError, own_diagonal, read_control_mesh
from ..exchange.evaluated import is_placed
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.modifiers import counted_modifiers, is_evaluated
from ..tasks.adaptive_meshes import FaceCount
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask
from . import mesh_values, out_of_date, viewports, watch
from .chosen import chosen
from .properties import scene_tolerance
from .result_record import control_object

# A larger mesh is not evaluated for its diagonal alone, nor one again that took longer, in seconds.
LARGEST_FACE_COUNT = 200_000
LONG = 0.1

# An object by its session identifier, and whether modifiers are counted in.
_Key = tuple[int, bool]

# None where it cannot be told without evaluating modifiers.
_diagonals: dict[_Key, float | None] = {}
_wanted: set[_Key] = set()
_slow: set[_Key] = set()

# Counts by the session identifiers of the objects counted together: a mesh for several of them counts once.
_counts: dict[frozenset[int], tuple[AdaptiveSettings, FaceCount]] = {}

# The numbers of faces at fault, by the session identifiers of meshes.
_refused: dict[int, int] = {}

# The meshes whose faces an operator selected in Object Mode, by their session identifiers.
_selected: set[int] = set()


def objects_for_tolerance(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The objects whose tolerances are shown: the active object, or the selected objects if the active one is no mesh.
    A result is replaced by its source."""
    objects, active = chosen(context), context.active_object
    return [control_object(each) for each in ([active] if active in objects else objects)]


def known_diagonal(blender_object: bpy.types.Object, *, use_modifiers: bool) -> float | None:
    """The diagonal of the object's dimensions, as a length in the scene, as far as measured."""
    key = (blender_object.session_uid, use_modifiers)
    if key not in _diagonals:
        _wanted.add(key)
        watch.examine_soon()
    return _diagonals.get(key)


def measured_diagonal(
    context: bpy.types.Context, blender_object: bpy.types.Object, *, use_modifiers: bool
) -> float | None:
    """The diagonal of the object's dimensions, measured now; None without a control mesh of some length, or without a
    known place."""
    if not is_placed(context.view_layer, blender_object):
        return None
    counted = counted_modifiers(blender_object, use_modifiers=use_modifiers)
    try:
        if is_evaluated(blender_object, counted):
            found = read_control_mesh(context, blender_object, use_modifiers=use_modifiers).diagonal()
        else:
            context.view_layer.update()
            found = own_diagonal(blender_object)
    except (ControlMeshError, ValueError):
        found = 0.0
    diagonal = found if np.isfinite(found) and found > 0 else None
    _diagonals[blender_object.session_uid, use_modifiers] = diagonal
    return diagonal


def _measure_wanted() -> bool:
    """Measure the requested diagonals, if measuring takes no time."""
    wanted = _wanted.copy()
    _wanted.clear()
    by_uid = {each.session_uid: each for each in bpy.data.objects if each.type == "MESH"} if wanted else {}
    for uid, use_modifiers in wanted:
        holder = by_uid.get(uid)
        _diagonals[uid, use_modifiers] = None if holder is None else _quickly_measured(holder, use_modifiers)
    return bool(wanted)


def _quickly_measured(holder: bpy.types.Object, use_modifiers: bool) -> float | None:
    key, mesh, started = (holder.session_uid, use_modifiers), holder.data, perf_counter()
    # Leaving Edit Mode has it measured; until then nobody is disturbed.
    if mesh.is_editmode and key in _diagonals:
        return _diagonals[key]
    try:
        counted = counted_modifiers(holder, use_modifiers=use_modifiers)
        takes_long = mesh.is_editmode or is_evaluated(holder, counted)
        if key in _slow or (takes_long and mesh_face_count(mesh) > LARGEST_FACE_COUNT):
            return _recorded(holder, use_modifiers)
        found = measured_diagonal(bpy.context, holder, use_modifiers=use_modifiers)
    except Exception:
        # Diagonals that cannot be measured are not shown.
        traceback.print_exc()
        return None
    if perf_counter() - started > LONG:
        _slow.add(key)
    return found


def _recorded(holder: bpy.types.Object, use_modifiers: bool) -> float | None:
    """The diagonal of the computation of depths on the object's mesh, if the depths hold for this object alone."""
    mesh, record = holder.data, holder.data.ccdepth
    is_own = mesh_values.has_depths(mesh) and not record.subdivision and not record.frames and mesh.users == 1
    is_alike = (record.tolerance_mode, record.use_modifiers) == ("RELATIVE", use_modifiers)
    return record.world_tolerance / record.tolerance if is_own and is_alike and not out_of_date.is_stale(mesh) else None


def remember_count(
    context: bpy.types.Context,
    tasks: Sequence[AdaptiveTask],
    settings: AdaptiveSettings,
    counts: Sequence[FaceCount],
) -> None:
    """Keep and show the count of each task's result, and the count of all results together, until the objects change.
    With too many faces, any count is the count of all."""
    # The evaluation for counting must not look like a change of the objects.
    context.view_layer.update()
    together = counts[0]
    if not together.are_too_many:
        together = FaceCount(sum(count.faces for count in counts))
        for task, count in zip(tasks, counts, strict=True):
            _counts[_uids(bpy.data.objects[name] for name in task.object_names)] = settings, count
    _counts[_uids(bpy.data.objects[name] for task in tasks for name in task.object_names)] = settings, together
    viewports.redraw(context)


def known_count(objects: Iterable[bpy.types.Object], settings: AdaptiveSettings) -> FaceCount | None:
    """The number of faces of the adaptive meshes of all these objects together with these settings; None if not
    counted."""
    counted_with, count = _counts.get(_uids(objects), (None, None))
    return count if counted_with == settings else None


def count_to_make(objects: Iterable[bpy.types.Object], settings: bpy.types.PropertyGroup) -> FaceCount | None:
    """The number of faces, as of ``known_count``, with the scene's settings."""
    return known_count(objects, AdaptiveSettings.of(settings, scene_tolerance(settings)))


def _uids(objects: Iterable[bpy.types.Object]) -> frozenset[int]:
    return frozenset(each.session_uid for each in objects)


def note_refused(faces_at_fault: Mapping[str, int]) -> None:
    """Note the number of faces that the last run could not use, by the names of objects; none after a good run."""
    _refused.clear()
    for name, faces in faces_at_fault.items():
        holder = bpy.data.objects.get(name)
        # The object may have been deleted during the run.
        if holder is not None:
            _refused[holder.data.session_uid] = faces


def faces_at_fault(mesh: bpy.types.Mesh) -> int:
    """The number of the mesh's faces that the last run could not use."""
    return _refused.get(mesh.session_uid, 0)


def note_selected(mesh: bpy.types.Mesh) -> None:
    """Show the mesh's selection in Object Mode, where Blender shows none."""
    _selected.add(mesh.session_uid)


def is_selection_shown(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh's selection is shown in Object Mode; Edit Mode ends that, as users select there."""
    if mesh.is_editmode:
        _selected.discard(mesh.session_uid)
    return mesh.session_uid in _selected


def _notice_update(changed: bpy.types.Object, _geometry: bool) -> bool:
    uid = changed.session_uid
    uids = {uid, *out_of_date.uids_of_results(uid)} if _counts else set()
    for counted in [counted for counted in _counts if counted & uids]:
        del _counts[counted]
    keys = {(uid, use_modifiers) for use_modifiers in (False, True)} & _diagonals.keys()
    _wanted.update(keys)
    return bool(keys)


def _measure_anew() -> None:
    _diagonals.clear()
    _wanted.clear()


def _forget_what_was_replaced() -> None:
    _measure_anew()
    _counts.clear()
    _selected.clear()


def _forget_everything() -> None:
    _forget_what_was_replaced()
    _slow.clear()
    _refused.clear()


watch.clients.append(
    watch.Client(
        forget=_forget_everything,
        updated=_notice_update,
        frame_changed=_measure_anew,
        replaced=_forget_what_was_replaced,
        examine=_measure_wanted,
    )
)
