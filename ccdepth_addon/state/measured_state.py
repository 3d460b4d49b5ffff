# SPDX-License-Identifier: GPL-3.0-or-later
"""What a measurement depends on, as checksums in its record, and whether it still holds."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ..core import FloatArray
from ..exchange.bulk_reading import read_values
from ..exchange.mesh_arrays import mesh_face_count, own_mesh
from ..exchange.mesh_checksums import continued, geometry_checksum
from ..exchange.object_state import object_state, shown_checksum
from ..exchange.result_attributes import DEVIATION
from ..exchange.shown_mesh import shown_modifiers

# How far, in parts of the largest number, a placement may drift by rounding while both objects are moved together.
DRIFT = 2e-6


def remember(measured: bpy.types.Object, target: bpy.types.Object) -> None:
    """Write to the records of the object and of its mesh what the measurement just written to it depends on.

    target: the object against whose limit surface it is.
    """
    found = measured.data.ccdepth.measurement
    measured.ccdepth.measured_against = None if target == measured else target
    found.fingerprint = " ".join(_checksums(measured, target, use_modifiers=found.use_modifiers))
    found.placement = _placement(measured, target)


def measured_object(holder: bpy.types.Object) -> bpy.types.Object:
    """Of the objects that use the holder's mesh, the one that its measurement is of: by its name, or the holder itself
    where that was renamed."""
    named = bpy.data.objects.get(holder.data.ccdepth.measurement.measured)
    return holder if named is None or named.data != holder.data else named


def is_own(mesh: bpy.types.Mesh) -> bool:
    """Whether the object that was measured is the one whose limit surface it was measured against."""
    found = mesh.ccdepth.measurement
    return bool(found.measured == found.against)


def target_of(measured: bpy.types.Object) -> bpy.types.Object | None:
    """The object against whose limit surface one was measured; None where it is gone."""
    if is_own(measured.data):
        return measured
    # Objects that were measured by earlier versions know its name alone.
    target = measured.ccdepth.measured_against or bpy.data.objects.get(measured.data.ccdepth.measurement.against)
    return target if target is not None and target.type == "MESH" else None


def change(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> str:
    """What has changed since the measurement on the mesh was made; empty where it holds for the object that was
    measured, or where that was renamed for one of those that use the mesh."""
    named = [each for each in users if each.name == mesh.ccdepth.measurement.measured]
    changes = [_change_for(each) for each in named or users]
    # The empty one comes first.
    return min(changes, default=f"“{mesh.name}” changed")


def _change_for(measured: bpy.types.Object) -> str:
    found, target = measured.data.ccdepth.measurement, target_of(measured)
    # The record keeps an object in the file that was deleted.
    if target is None or not target.users_scene:
        return f"“{found.against}” was removed"
    if mesh_face_count(measured.data) != found.faces:
        return f"“{measured.name}” changed"
    before, now = found.fingerprint.split(), _checksums(measured, target, use_modifiers=found.use_modifiers)
    if before != now:
        return f"“{(measured if before[:2] != now[:2] else target).name}” changed"
    recorded, present = np.array(found.placement, dtype=np.float64), _placement(measured, target)
    has_moved = np.abs(recorded - present) > DRIFT * np.abs(recorded).max()
    if has_moved[:6].any():
        return f"“{target.name}” was scaled"
    return "objects were moved" if has_moved.any() else ""


def _checksums(measured: bpy.types.Object, against: bpy.types.Object, *, use_modifiers: bool) -> list[str]:
    """Two of the measured object, and one or two of the other one."""
    parts = [
        _mesh_checksum(measured),
        shown_checksum(measured, shown_modifiers(measured)),
        object_state(against, use_modifiers=use_modifiers).checksum,
    ]
    if against != measured:
        with own_mesh(against) as mesh:
            parts.append(f"{geometry_checksum(mesh):08x}")
    return parts


def _mesh_checksum(measured: bpy.types.Object) -> str:
    """Of the object's own mesh, and of the deviations on it."""
    with own_mesh(measured) as mesh:
        values = read_values(mesh.attributes[DEVIATION].data, "value", np.float32)
        return f"{continued(geometry_checksum(mesh), DEVIATION, values):08x}"


def _placement(measured: bpy.types.Object, against: bpy.types.Object) -> FloatArray:
    """(18,): the scale of the second object, and the place of the first relative to it, which stays when both move
    together."""
    place, other = (np.array(item.matrix_world, dtype=np.float64) for item in (measured, against))
    scale = object_state(against, use_modifiers=False).scale
    relative = np.linalg.pinv(other[:3, :3]) @ (place[:3] - np.column_stack([np.zeros((3, 3)), other[:3, 3]]))
    return np.concatenate([scale, relative.ravel()])
