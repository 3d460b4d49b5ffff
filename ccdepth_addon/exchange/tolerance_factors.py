# SPDX-License-Identifier: GPL-3.0-or-later
"""Factors on the tolerance at the corners of a mesh, from weights of a vertex group or from materials."""

from __future__ import annotations

from typing import Any
from zlib import crc32

import bpy
import numpy as np

from ..core import FloatArray
from .blender_arrays import face_sizes, read_values
from .control_mesh import ControlMeshError
from .data_blocks import held
from .mesh_arrays import own_checksum
from .vertex_groups import read_weights


def corner_factors(
    blender_object: bpy.types.Object, mesh: bpy.types.Mesh, settings: Any, *, is_own: bool
) -> FloatArray | None:
    """(C,): the factors at the corners of a mesh by settings, None where the tolerance is the same everywhere. is_own:
    whether the mesh is the object's own, with the materials of the object's slots. Raises ControlMeshError."""
    if settings.tolerance_by == "VERTEX_GROUP":
        return _factors_of_group(mesh, settings.vertex_group, settings.coarsest)
    return _factors_of_materials(blender_object, mesh, is_own=is_own) if settings.tolerance_by == "MATERIAL" else None


def factors_text(blender_object: bpy.types.Object, settings: Any) -> str:
    """What the factors of an object depend on beside modifiers and settings; empty without factors."""
    if settings.tolerance_by == "VERTEX_GROUP":
        return f"{blender_object.vertex_groups.find(settings.vertex_group)} {own_checksum(blender_object, _weights)}"
    if settings.tolerance_by == "MATERIAL":
        slots = [
            each.material.ccdepth.tolerance_factor if each.material else 1 for each in blender_object.material_slots
        ]
        return f"{slots} {own_checksum(blender_object, _material_indices)}"
    return ""


def _weights(mesh: bpy.types.Mesh) -> int:
    """A checksum of the weights of all vertex groups."""
    return crc32(np.column_stack(read_weights(mesh)).tobytes())


def _material_indices(mesh: bpy.types.Mesh) -> int:
    """A checksum of the materials of faces."""
    return crc32(read_values(mesh.polygons, "material_index", np.int32).tobytes())


def _factors_of_group(mesh: bpy.types.Mesh, name: str, coarsest: float) -> FloatArray:
    """(C,): coarsest^(1 - weight) for the weights of a vertex group: 1 for a weight of 1, coarsest for 0 and without
    one. Raises ControlMeshError without the group."""
    with held(mesh) as holder:
        group = holder.vertex_groups.get(name)
        if group is None:
            raise ControlMeshError(f"it has no vertex group called “{name}”" if name else "no vertex group is chosen")
        number = group.index
    vertices, groups, weights = read_weights(mesh)
    of_vertices = np.zeros(len(mesh.vertices))
    chosen = groups == number
    of_vertices[vertices[chosen]] = weights[chosen]
    return coarsest ** (1 - of_vertices)[read_values(mesh.loops, "vertex_index", np.int32)]


def _factors_of_materials(blender_object: bpy.types.Object, mesh: bpy.types.Mesh, *, is_own: bool) -> FloatArray:
    """(C,): the factors of the materials of faces, 1 without one. Modifiers may have changed the materials of a mesh
    that is not the object's own. Raises ControlMeshError for a factor of zero or less."""
    materials = [slot.material for slot in blender_object.material_slots] if is_own else [*mesh.materials]
    factors = [1.0 if each is None else each.ccdepth.tolerance_factor for each in materials] or [1.0]
    for material, factor in zip(materials, factors, strict=False):
        if not 0 < factor < np.inf:
            raise ControlMeshError(
                f"the tolerance factor of its material “{material.name}” is {factor:.3g}: it must be greater than zero"
            )
    # Blender draws faces beyond the last material with that one.
    of_faces = np.minimum(read_values(mesh.polygons, "material_index", np.int32), len(factors) - 1)
    return np.repeat(np.array(factors)[of_faces], face_sizes(mesh))
