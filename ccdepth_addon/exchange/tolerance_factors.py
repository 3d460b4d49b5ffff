# SPDX-License-Identifier: GPL-3.0-or-later
"""Factors on the tolerance at the corners of a mesh, from weights of a vertex group or from materials."""

from __future__ import annotations

import bpy
import numpy as np

from ..core import FloatArray
from .blender_arrays import face_sizes, read_values
from .control_mesh import ControlMeshError
from .data_blocks import held
from .vertex_groups import read_weights


def factors_of_group(mesh: bpy.types.Mesh, name: str, coarsest: float) -> FloatArray:
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


def factors_of_materials(blender_object: bpy.types.Object, mesh: bpy.types.Mesh) -> FloatArray:
    """(C,): the factors of the materials of faces, 1 without one. mesh: the object's own, or its evaluated one, whose
    materials modifiers may have changed. Raises ControlMeshError for a factor of zero or less."""
    is_own = mesh == blender_object.data
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
