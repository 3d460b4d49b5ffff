# SPDX-License-Identifier: GPL-3.0-or-later
"""Checksums of a mesh as Blender keeps it, as far as its surface depends on it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any
from zlib import crc32

import bpy
import numpy as np
from numpy.typing import NDArray

from .blender_arrays import TYPES, read_built_in, read_values
from .mesh_arrays import EDGE_CREASE, VERTEX_CREASE, read_creases

# Attributes that the checksum of the geometry has already.
IN_GEOMETRY = {"position", EDGE_CREASE, VERTEX_CREASE}


def geometry_checksum(mesh: bpy.types.Mesh) -> int:
    """A checksum of positions, faces, edges and creases of a mesh that is not in Edit Mode."""
    checksum = 0
    for values in _stored(mesh):
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


def _stored(mesh: bpy.types.Mesh) -> Iterator[NDArray[Any]]:
    """No creases are the same as creases of zero."""
    attributes = mesh.attributes
    yield read_built_in(attributes, "position", "vector", np.float32, 3)
    yield read_values(mesh.polygons, "loop_start", np.int32)
    yield read_built_in(attributes, ".corner_vert", "value", np.int32)
    yield read_built_in(attributes, ".edge_verts", "value", np.int32, 2)
    for name in (EDGE_CREASE, VERTEX_CREASE):
        creases = read_creases(mesh, name)
        if creases is not None and creases.any():
            yield np.frombuffer(name.encode(), dtype=np.uint8)
            yield creases
