# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result was computed from, as checksums in its record, and whether that is still what is there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from zlib import crc32

import bpy
import numpy as np

from . import results
from .computation import count_faces
from .control_mesh import SurfaceRule, mesh_arrays, own_mesh, read_values
from .object_state import ObjectState, object_state

# How far, relatively, an object's scale may drift by rounding while it is turned.
SCALE_DRIFT = 1e-5


def remember(blender_object: bpy.types.Object, states: Iterable[ObjectState]) -> None:
    """Put into the record of the object's mesh what the result just written to it depends on."""
    record = blender_object.data.ccdepth
    record.fingerprint = mesh_checksum(blender_object)
    record.contributors.clear()
    for state in states:
        contributor = record.contributors.add()
        contributor.gram, contributor.checksum = state.scale, state.checksum


def mesh_checksum(blender_object: bpy.types.Object) -> str:
    """A checksum of the object's own mesh, as far as its surface depends on it, and of the depths on it."""
    with own_mesh(blender_object) as mesh:
        arrays = mesh_arrays(mesh, SurfaceRule())
        checksum = 0
        for array in (
            arrays.positions,
            arrays.face_starts,
            arrays.corner_vertices,
            arrays.edge_vertices,
            arrays.edge_sharpness,
            arrays.vertex_sharpness,
            _depths(mesh),
        ):
            checksum = crc32(array.data, checksum)
    return f"{checksum:08x}"


def _depths(mesh: bpy.types.Mesh) -> Any:
    attribute = mesh.attributes.get(results.DEPTH)
    return np.zeros(0) if attribute is None else read_values(attribute.data, "value", np.int32)


def has_changed(mesh: bpy.types.Mesh, users: list[bpy.types.Object]) -> bool:
    """Whether the mesh, or an object its result was computed for, is no longer as its record tells."""
    record = mesh.ccdepth
    if not users or count_faces(mesh) != record.faces or mesh_checksum(users[0]) != record.fingerprint:
        return True
    present = [object_state(user, use_modifiers=record.use_modifiers) for user in users]
    return not all(any(_is_same(contributor, state) for state in present) for contributor in record.contributors)


def covers(blender_object: bpy.types.Object) -> bool:
    """Whether the result on the object's mesh was computed for an object like it."""
    record = blender_object.data.ccdepth
    state = object_state(blender_object, use_modifiers=record.use_modifiers)
    return any(_is_same(contributor, state) for contributor in record.contributors)


def _is_same(contributor: bpy.types.PropertyGroup, state: ObjectState) -> bool:
    recorded = np.array(contributor.gram, dtype=np.float64)
    drift = np.abs(recorded - state.scale).max()
    return contributor.checksum == state.checksum and bool(drift <= SCALE_DRIFT * np.abs(recorded).max())
