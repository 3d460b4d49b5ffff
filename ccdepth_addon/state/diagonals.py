# SPDX-License-Identifier: GPL-3.0-or-later
"""The diagonals that relative tolerances are parts of, found without computing anything while the interface is drawn.

The interface asks for what is known. What it asked for, and what has changed since, is measured when nothing has
happened for a while, where that takes no time; the rest is known once somebody has measured it.
"""

from __future__ import annotations

import traceback
from time import perf_counter

import bpy
import numpy as np

from ..exchange.control_mesh import ControlMeshError, own_diagonal, read_control_mesh
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.modifiers import counted_modifiers, is_evaluated
from . import results, staleness, watch
from .result_record import control_object

# A larger mesh is not evaluated for this alone, nor one again that took longer, in seconds.
LARGEST_FACE_COUNT = 200_000
LONG = 0.1

# An object by its session identifier, and whether modifiers are counted in.
_Key = tuple[int, bool]

# None where it cannot be told without evaluating modifiers.
_known: dict[_Key, float | None] = {}
_wanted: set[_Key] = set()

_slow: set[_Key] = set()


def measured_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The objects that tolerances are told for: the active one, or the selected ones where that is no mesh.

    For a result it is what Update Result would make it from.
    """
    active = context.active_object
    holders = [active] if active is not None and active.type == "MESH" else context.selected_objects
    return [control_object(each) for each in holders if each.type == "MESH"]


def known_diagonal(blender_object: bpy.types.Object, *, use_modifiers: bool) -> float | None:
    """The diagonal of the object's dimensions, as a length in the scene, as far as measured."""
    key = (blender_object.session_uid, use_modifiers)
    if key not in _known:
        _wanted.add(key)
        watch.examine_soon()
    return _known.get(key)


def measured_diagonal(
    context: bpy.types.Context, blender_object: bpy.types.Object, *, use_modifiers: bool
) -> float | None:
    """The same, measured now; None where the object has no control mesh with a length."""
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
    _known[blender_object.session_uid, use_modifiers] = diagonal
    return diagonal


def _measure_wanted() -> bool:
    """Measure what was asked for, where it takes no time."""
    wanted = _wanted.copy()
    _wanted.clear()
    by_uid = {each.session_uid: each for each in bpy.data.objects if each.type == "MESH"} if wanted else {}
    for uid, use_modifiers in wanted:
        holder = by_uid.get(uid)
        _known[uid, use_modifiers] = None if holder is None else _quickly_measured(holder, use_modifiers)
    return bool(wanted)


def _quickly_measured(holder: bpy.types.Object, use_modifiers: bool) -> float | None:
    key, mesh, started = (holder.session_uid, use_modifiers), holder.data, perf_counter()
    # Leaving Edit Mode has it measured; until then nobody is disturbed.
    if mesh.is_editmode and key in _known:
        return _known[key]
    try:
        counted = counted_modifiers(holder, use_modifiers=use_modifiers)
        takes_long = mesh.is_editmode or is_evaluated(holder, counted)
        if key in _slow or (takes_long and mesh_face_count(mesh) > LARGEST_FACE_COUNT):
            return _recorded(holder, use_modifiers)
        found = measured_diagonal(bpy.context, holder, use_modifiers=use_modifiers)
    except Exception:
        # What cannot be measured is not shown.
        traceback.print_exc()
        return None
    if perf_counter() - started > LONG:
        _slow.add(key)
    return found


def _recorded(holder: bpy.types.Object, use_modifiers: bool) -> float | None:
    """The diagonal that the depths on the object's mesh were computed with, if they hold for it alone."""
    mesh, record = holder.data, holder.data.ccdepth
    is_own = results.has_result(mesh) and not record.subdivision and not record.frames and mesh.users == 1
    is_alike = (record.tolerance_mode, record.use_modifiers) == ("RELATIVE", use_modifiers)
    return record.world_tolerance / record.tolerance if is_own and is_alike and not staleness.is_stale(mesh) else None


def _want_again(changed: bpy.types.Object, _geometry: bool) -> bool:
    keys = {(changed.session_uid, use_modifiers) for use_modifiers in (False, True)} & _known.keys()
    _wanted.update(keys)
    return bool(keys)


def _measure_anew() -> None:
    _known.clear()
    _wanted.clear()


def _forget() -> None:
    _measure_anew()
    _slow.clear()


watch.clients.append(
    watch.Client(
        forget=_forget,
        updated=_want_again,
        frame_changed=_measure_anew,
        replaced=_measure_anew,
        examine=_measure_wanted,
    )
)
