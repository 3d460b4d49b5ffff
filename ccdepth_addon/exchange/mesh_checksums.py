# SPDX-License-Identifier: GPL-3.0-or-later
"""Checksums of a mesh as Blender keeps it, as far as its surface depends on it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple
from zlib import crc32

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import PolygonMesh
from .bulk_reading import read_built_in, read_values
from .bulk_writing import TYPES
from .mesh_arrays import EDGE_CREASE, VERTEX_CREASE, read_creases

# Attributes that the checksum of the geometry has already.
IN_GEOMETRY = {"position", EDGE_CREASE, VERTEX_CREASE}


class Topology(NamedTuple):
    """A mesh's faces and edges as Blender keeps them, int32: (F,) first corners, (C,), (E, 2)."""

    face_starts: NDArray[np.int32]
    corner_vertices: NDArray[np.int32]
    edge_vertices: NDArray[np.int32]

    @staticmethod
    def of(arrays: PolygonMesh) -> Topology:
        """That of a mesh that was read."""
        columns = arrays.face_starts[:-1], arrays.corner_vertices, arrays.edge_vertices
        return Topology(*(values.astype(np.int32) for values in columns))


def geometry_checksum(mesh: bpy.types.Mesh, topology: Topology | None = None) -> int:
    """A checksum of positions, faces, edges and creases of a mesh that is not in Edit Mode.

    topology: that of the mesh, where it is known, as it takes long to read it back.
    """
    checksum = 0
    for values in _stored(mesh, topology):
        checksum = crc32(values.data, checksum)
    return checksum


def content_checksum(mesh: bpy.types.Mesh, unread: Collection[str]) -> int:
    """``geometry_checksum`` with all other attributes counted in, but for the interface's own and these unread ones.

    An attribute of zeros is the same as none: Blender adds and removes such ones by itself.
    """
    checksum = geometry_checksum(mesh)
    for attribute in sorted(mesh.attributes, key=lambda each: each.name):
        name, kind = attribute.name, TYPES.get(attribute.data_type)
        if kind is None or name.startswith(".") or name in unread or name in IN_GEOMETRY:
            continue
        values = read_values(attribute.data, kind.value, kind.dtype, kind.width)
        if values.any():
            checksum = continued(checksum, f"{name} {attribute.data_type} {attribute.domain}", values)
    return checksum


def checksum_of_points(points: Any, name: str = "co", width: int = 3) -> int:
    """A checksum of a vector of every item of a collection."""
    return crc32(read_values(points, name, np.float32, width).tobytes())


def continued(checksum: int, name: str, values: NDArray[Any]) -> int:
    """The checksum with an attribute of the mesh counted in."""
    return crc32(values.data, crc32(name.encode(), checksum))


def _stored(mesh: bpy.types.Mesh, topology: Topology | None) -> Iterator[NDArray[Any]]:
    """No creases are the same as creases of zero."""
    attributes = mesh.attributes
    yield read_built_in(attributes, "position", "vector", np.float32, 3)
    yield from topology or _read_topology(mesh)
    for name in (EDGE_CREASE, VERTEX_CREASE):
        creases = read_creases(mesh, name)
        if creases is not None and creases.any():
            yield np.frombuffer(name.encode(), dtype=np.uint8)
            yield creases


def _read_topology(mesh: bpy.types.Mesh) -> Topology:
    return Topology(
        face_starts=read_values(mesh.polygons, "loop_start", np.int32),
        corner_vertices=read_built_in(mesh.attributes, ".corner_vert", "value", np.int32),
        edge_vertices=read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2),
    )
