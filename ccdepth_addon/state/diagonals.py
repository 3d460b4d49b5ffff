# SPDX-License-Identifier: GPL-3.0-or-later
"""The diagonals that relative tolerances are parts of, found without computing anything while the interface is drawn.

The interface asks for what is known. What it asked for, and what has changed since, is measured when nothing has
happened for a while, where that takes no time; the rest is known once somebody has measured it.
"""

from __future__ import annotations

import traceback

import bpy
import numpy as np

from ..exchange.control_mesh import ControlMeshError, read_control_mesh
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.modifiers import counted_modifiers, is_evaluated
from . import results, staleness, watch
from .result_record import control_object

# A larger mesh is not read for this alone.
LARGEST_FACE_COUNT = 200_000

# An object by its session identifier, and whether modifiers are counted in.
_Key = tuple[int, bool]

# None where it cannot be told without evaluating modifiers.
_known: dict[_Key, float | None] = {}
_wanted: set[_Key] = set()


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
    try:
        found = read_control_mesh(context, blender_object, use_modifiers=use_modifiers).diagonal()
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
    record = holder.data.ccdepth
    # Leaving Edit Mode has it measured; until then nobody is disturbed.
    if holder.data.is_editmode:
        return _known.get((holder.session_uid, use_modifiers))
    try:
        counted = counted_modifiers(holder, use_modifiers=use_modifiers)
        if is_evaluated(holder, counted) or mesh_face_count(holder.data) > LARGEST_FACE_COUNT:
            return _recorded(record, holder) if record.use_modifiers == use_modifiers else None
        return measured_diagonal(bpy.context, holder, use_modifiers=use_modifiers)
    except Exception:
        # What cannot be measured is not shown.
        traceback.print_exc()
        return None


def _recorded(record: bpy.types.PropertyGroup, holder: bpy.types.Object) -> float | None:
    """The diagonal that the depths on the object's mesh were computed with, if they hold for it alone."""
    mesh = holder.data
    is_own = results.has_result(mesh) and not record.subdivision and not record.frames and mesh.users == 1
    if not is_own or record.tolerance_mode != "RELATIVE" or staleness.is_stale(mesh):
        return None
    return float(record.world_tolerance / record.tolerance)


def _want_again(changed: bpy.types.Object, _geometry: bool) -> bool:
    keys = {(changed.session_uid, use_modifiers) for use_modifiers in (False, True)} & _known.keys()
    _wanted.update(keys)
    return bool(keys)


def _forget() -> None:
    _known.clear()
    _wanted.clear()


watch.clients.append(
    watch.Client(forget=_forget, updated=_want_again, frame_changed=_forget, replaced=_forget, examine=_measure_wanted)
)
