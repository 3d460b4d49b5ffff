# SPDX-License-Identifier: GPL-3.0-or-later
"""What a measurement depends on, as checksums in its record, and whether that has changed."""

from __future__ import annotations

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


def remember(measured: bpy.types.Object) -> None:
    """Write to the record of the object's mesh what the measurement just written to it depends on."""
    found = measured.data.ccdepth.measurement
    against = bpy.data.objects[found.against]
    found.fingerprint = _checksum(measured, against, use_modifiers=found.use_modifiers)
    found.placement = _placement(measured, against)


def has_changed(mesh: bpy.types.Mesh) -> bool:
    """Whether the objects of the mesh's measurement differ from its record."""
    found = mesh.ccdepth.measurement
    measured, against = bpy.data.objects.get(found.measured), bpy.data.objects.get(found.against)
    if measured is None or against is None or measured.data != mesh or against.type != "MESH":
        return True
    if mesh_face_count(mesh) != found.faces:
        return True
    recorded, present = np.array(found.placement, dtype=np.float64), _placement(measured, against)
    if np.abs(recorded - present).max() > DRIFT * np.abs(recorded).max():
        return True
    return _checksum(measured, against, use_modifiers=found.use_modifiers) != found.fingerprint


def _checksum(measured: bpy.types.Object, against: bpy.types.Object, *, use_modifiers: bool) -> str:
    parts = [
        _mesh_checksum(measured),
        shown_checksum(measured, shown_modifiers(measured)),
        object_state(against, use_modifiers=use_modifiers).checksum,
    ]
    if against != measured:
        with own_mesh(against) as mesh:
            parts.append(f"{geometry_checksum(mesh):08x}")
    return " ".join(parts)


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
