# SPDX-License-Identifier: GPL-3.0-or-later
"""The facts of a session, stored in no file: the numbers of faces of adaptive meshes, the meshes that the last run
refused, and the selections shown; and the diagonals for relative tolerances.

The interface asks for known facts, and evaluates nothing while it is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import bpy
import numpy as np

from ..exchange.control_mesh import own_diagonal, read_alone
from ..exchange.evaluated import is_placed
from ..exchange.modifiers import counted_modifiers, is_evaluated
from ..registration import redraw
from ..tasks.adaptive_meshes import FaceCount
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask
from . import out_of_date
from .chosen import chosen
from .properties import scene_tolerance
from .result_record import control_object

# The diagonal of a larger mesh is not read from its points while the interface is drawn: it takes milliseconds.
MOST_POINTS = 50_000

# Counts by the session identifiers of the objects counted together: a mesh for several of them counts once.
_counts: dict[frozenset[int], tuple[AdaptiveSettings, FaceCount]] = {}

# The numbers of faces at fault, by the session identifiers of meshes.
_refused: dict[int, int] = {}

# The meshes whose faces an operator selected in Object Mode, by their session identifiers.
_selected: set[int] = set()


def objects_for_tolerance(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The objects whose tolerances are shown: the active object, or the selected objects if the active one is no
    mesh."""
    objects, active = chosen(context), context.active_object
    return [active] if active in objects else objects


def shown_diagonal(blender_object: bpy.types.Object, *, use_modifiers: bool) -> tuple[float, bool] | None:
    """The diagonal of the dimensions of an object, or of a result's source, as a length in the scene; and whether it is
    exact, from the control points as they are, or that of the last computation. None if it is not known."""
    source = control_object(blender_object)
    mesh, counted = source.data, counted_modifiers(source, use_modifiers=use_modifiers)
    if not mesh.is_editmode and not is_evaluated(source, counted) and len(mesh.vertices) <= MOST_POINTS:
        diagonal = own_diagonal(source)
        return (diagonal, True) if _is_length(diagonal) else None
    for holder in (source, blender_object):
        record = holder.data.ccdepth
        is_alike = (record.tolerance_mode, record.use_modifiers) == ("RELATIVE", use_modifiers)
        if record.has_result and is_alike and not record.frames:
            return record.world_tolerance / record.tolerance, False
    return None


def _is_length(diagonal: float) -> bool:
    return bool(np.isfinite(diagonal)) and diagonal > 0


def measured_diagonal(
    context: bpy.types.Context, blender_object: bpy.types.Object, *, use_modifiers: bool
) -> float | None:
    """The diagonal of the object's dimensions, measured now; None without a control mesh of some length, or without a
    known place."""
    if not is_placed(context.view_layer, blender_object):
        return None
    try:
        found = read_alone(context, blender_object, use_modifiers=use_modifiers).diagonal()
    except ValueError:
        found = 0.0
    return found if _is_length(found) else None


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
        by_distance = [count.by_distance for count in counts if count.by_distance is not None]
        total = sum(count.faces for count in counts)
        together = FaceCount(total, by_distance=sum(by_distance) if by_distance else None)
        for task, count in zip(tasks, counts, strict=True):
            _counts[frozenset(target.user.uid for target in task.targets)] = settings, count
    _counts[frozenset(target.user.uid for task in tasks for target in task.targets)] = settings, together
    redraw(context)


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


def note_refused(faces_at_fault: Mapping[int, int]) -> None:
    """Note the number of faces that the last run could not use, by the session identifiers of meshes; none after a good
    run."""
    _refused.clear()
    _refused.update(faces_at_fault)


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


def forget_counts(changed: bpy.types.Object) -> None:
    """Forget the counts of an object, and of its results."""
    uid = changed.session_uid
    uids = {uid, *out_of_date.noted(changed).results} if _counts else set()
    for counted in [counted for counted in _counts if counted & uids]:
        del _counts[counted]


def forget_what_was_replaced() -> None:
    """Forget what undo, redo and loading change."""
    _counts.clear()
    _selected.clear()


def forget_everything() -> None:
    """Forget all, with another file."""
    forget_what_was_replaced()
    _refused.clear()
