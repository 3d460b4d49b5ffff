# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result was computed from, as checksums in its record, and whether that is still what is there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple
from zlib import crc32

import bpy
import numpy as np
from numpy.typing import NDArray

from . import results
from .computation import count_faces
from .control_mesh import EDGE_CREASE, VERTEX_CREASE, own_mesh, read_built_in, read_creases, read_values
from .object_state import ObjectState, object_state
from .results import AttributeKind

# How far, relatively, an object's scale may drift by rounding while it is turned.
SCALE_DRIFT = 1e-5


class Topology(NamedTuple):
    """A mesh's faces and edges as Blender keeps them, int32: (F,) first corners, (C,), (E, 2)."""

    face_starts: NDArray[np.int32]
    corner_vertices: NDArray[np.int32]
    edge_vertices: NDArray[np.int32]


def remember(blender_object: bpy.types.Object, states: Iterable[ObjectState], topology: Topology | None = None) -> None:
    """Put into the record of the object's mesh what the result just written to it depends on.

    topology: that of the mesh, where it is known, as it takes long to read it back.
    """
    record = blender_object.data.ccdepth
    record.fingerprint = mesh_checksum(blender_object, topology)
    record.contributors.clear()
    for state in states:
        contributor = record.contributors.add()
        contributor.gram, contributor.checksum = state.scale, state.checksum


def mesh_checksum(
    blender_object: bpy.types.Object,
    topology: Topology | None = None,
    result: AttributeKind | None = results.DEPTH_KIND,
) -> str:
    """A checksum of the object's own mesh, as far as its surface depends on it, and of one attribute of ours on it."""
    checksum = 0
    with own_mesh(blender_object) as mesh:
        for values in _stored(mesh, topology, result):
            checksum = crc32(values.data, checksum)
    return f"{checksum:08x}"


def _stored(mesh: bpy.types.Mesh, topology: Topology | None, result: AttributeKind | None) -> Iterator[NDArray[Any]]:
    """As Blender keeps it. No creases are the same as creases of zero."""
    attributes = mesh.attributes
    yield read_built_in(attributes, "position", "vector", np.float32, 3)
    yield from topology or _read_topology(mesh)
    for name in (EDGE_CREASE, VERTEX_CREASE):
        creases = read_creases(mesh, name)
        if creases is not None and creases.any():
            yield np.frombuffer(name.encode(), dtype=np.uint8)
            yield creases
    if result is not None and results.has_values(mesh, result):
        yield np.frombuffer(result.name.encode(), dtype=np.uint8)
        dtype = np.int32 if result.data_type == "INT" else np.float32
        yield read_values(attributes[result.name].data, result.value, dtype)


def _read_topology(mesh: bpy.types.Mesh) -> Topology:
    return Topology(
        face_starts=read_values(mesh.polygons, "loop_start", np.int32),
        corner_vertices=read_built_in(mesh.attributes, ".corner_vert", "value", np.int32),
        edge_vertices=read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2),
    )


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
