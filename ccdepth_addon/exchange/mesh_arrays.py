# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender mesh → ``PolygonMesh``, with its creases as sharpness, and checksums of the Blender mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from zlib import crc32

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import FloatArray, PolygonMesh, crease_to_sharpness
from .blender_arrays import TYPES, read_built_in, read_values
from .changes import known_checksum
from .data_blocks import convert_attribute, held, own_copy
from .face_values import ATTRIBUTES
from .modifiers import SurfaceRule

EDGE_CREASE, VERTEX_CREASE = "crease_edge", "crease_vert"
CREASE_DOMAINS = {EDGE_CREASE: "EDGE", VERTEX_CREASE: "POINT"}


@contextmanager
def own_mesh(blender_object: bpy.types.Object) -> Iterator[bpy.types.Mesh]:
    """The object's mesh, or in Edit Mode a temporary copy of the edited mesh."""
    if not blender_object.data.is_editmode:
        yield blender_object.data
        return
    scratch = bpy.data.meshes.new(blender_object.data.name)
    try:
        bmesh.from_edit_mesh(blender_object.data).to_mesh(scratch)
        _copy_lists(blender_object, scratch)
        yield scratch
    finally:
        bpy.data.meshes.remove(scratch)


def own_checksum(blender_object: bpy.types.Object, checksum_of: Callable[[bpy.types.Mesh], int]) -> int:
    """A checksum of the object's mesh, as known, or in Edit Mode of the edited mesh."""
    if not blender_object.data.is_editmode:
        return known_checksum(blender_object.data, checksum_of)
    with own_mesh(blender_object) as mesh:
        return checksum_of(mesh)


def mesh_face_count(mesh: bpy.types.Mesh) -> int:
    """The number of faces of a mesh; in Edit Mode, of the mesh being edited."""
    if not mesh.is_editmode:
        return len(mesh.polygons)
    return len(bmesh.from_edit_mesh(mesh).faces)


def _copy_lists(blender_object: bpy.types.Object, scratch: bpy.types.Mesh) -> None:
    """Give a mesh the object's vertex groups and materials: its vertices and faces refer to them by index, modifiers by
    name."""
    for material in blender_object.data.materials:
        scratch.materials.append(material)
    with held(scratch) as holder:
        for group in blender_object.vertex_groups:
            holder.vertex_groups.new(name=group.name)


def mesh_arrays(mesh: bpy.types.Mesh, rule: SurfaceRule) -> PolygonMesh:
    """A Blender mesh, not in Edit Mode, as arrays. Sharpness is that of its creases alone."""
    face_starts = np.empty(len(mesh.polygons) + 1, dtype=np.intp)
    face_starts[:-1] = read_values(mesh.polygons, "loop_start", np.int32)
    face_starts[-1] = len(mesh.loops)
    attributes = mesh.attributes
    # A modifier that takes elements away leaves some corners of faces with a repeated vertex no edge: -1. Such faces
    # are refused, whichever edge stands there.
    corner_edges = np.maximum(read_built_in(attributes, ".corner_edge", "value", np.int32), 0)
    return PolygonMesh(
        positions=read_built_in(attributes, "position", "vector", np.float32, 3).astype(np.float64),
        face_starts=face_starts,
        corner_vertices=read_built_in(attributes, ".corner_vert", "value", np.int32).astype(np.intp),
        corner_edges=corner_edges.astype(np.intp),
        edge_vertices=read_built_in(attributes, ".edge_verts", "value", np.int32, 2).astype(np.intp),
        edge_sharpness=_sharpness(mesh, EDGE_CREASE, len(mesh.edges), rule),
        vertex_sharpness=_sharpness(mesh, VERTEX_CREASE, len(mesh.vertices), rule),
    )


def _sharpness(mesh: bpy.types.Mesh, name: str, number: int, rule: SurfaceRule) -> FloatArray:
    creases = read_creases(mesh, name) if rule.use_creases else None
    return np.zeros(number) if creases is None else crease_to_sharpness(creases)


def read_creases(mesh: bpy.types.Mesh, name: str) -> NDArray[np.float32] | None:
    """(E,) or (V,): the creases that the Subdivision Surface modifier takes from an attribute, None without one.

    The modifier converts an attribute of another type or domain, and so does Blender's own operator, on a copy.
    """
    attribute = mesh.attributes.get(name)
    if attribute is None:
        return None
    if (attribute.data_type, attribute.domain) == ("FLOAT", CREASE_DOMAINS[name]):
        return read_values(attribute.data, "value", np.float32)
    copy = own_copy(mesh)
    try:
        with held(copy) as holder:
            convert_attribute(holder, name, mode="GENERIC", domain=CREASE_DOMAINS[name], data_type="FLOAT")
        return read_values(copy.attributes[name].data, "value", np.float32)
    finally:
        bpy.data.meshes.remove(copy)


# Attributes that the checksum of the geometry has already, and our values.
UNREAD = {"position", EDGE_CREASE, VERTEX_CREASE, *(kind.name for kind in ATTRIBUTES)}


def geometry_checksum(mesh: bpy.types.Mesh) -> int:
    """A checksum of positions, faces, edges and creases of a mesh outside Edit Mode."""
    checksum = 0
    for values in _stored(mesh):
        checksum = crc32(values.data, checksum)
    return checksum


def content_checksum(mesh: bpy.types.Mesh) -> int:
    """``geometry_checksum`` with all other attributes, except the interface's and our own.

    An attribute of zeros counts as none, as Blender adds and removes such attributes by itself.
    """
    return attributes_checksum(mesh, geometry_checksum(mesh))


def attributes_checksum(mesh: bpy.types.Mesh, checksum: int = 0) -> int:
    """The checksum with the attributes of a mesh added that the checksum of its geometry does not have."""
    for attribute in sorted(mesh.attributes, key=lambda each: each.name):
        name, kind = attribute.name, TYPES.get(attribute.data_type)
        if kind is None or name.startswith(".") or name in UNREAD:
            continue
        values = read_values(attribute.data, kind.value, kind.dtype, kind.width)
        if values.any():
            checksum = continued(checksum, f"{name} {attribute.data_type} {attribute.domain}", values)
    return checksum


def continued(checksum: int, name: str, values: NDArray[Any]) -> int:
    """The checksum with an attribute of the mesh added."""
    return crc32(values.data, crc32(name.encode(), checksum))


def _stored(mesh: bpy.types.Mesh) -> Iterator[NDArray[Any]]:
    """The stored creases; no creases count as creases of zero."""
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
