# SPDX-License-Identifier: GPL-3.0-or-later
"""The vertex groups of a mesh on its subdivision, with their weights.

Blender has no bulk access to weights. Reading the base mesh's, which are few, takes a loop; the new ones are written as
an attribute, which Blender's own operator turns into a vertex group.
"""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import BoolArray, PolygonMesh, SubdividedMesh, interpolated_at_vertices
from .blender_arrays import write_attribute
from .data_blocks import convert_attribute, held, unused_name

WEIGHTS = "ccdepth_weights"


# The vertex groups of a mesh, in order: their names, and whether they are locked.
Groups = list[tuple[str, bool]]


def has_groups(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh has vertex groups, whose names only its objects know."""
    with held(mesh) as holder:
        return len(holder.vertex_groups) > 0


def write_groups(
    holder: bpy.types.Object,
    groups: Groups,
    base: bpy.types.Mesh,
    control: PolygonMesh,
    subdivided: SubdividedMesh,
) -> None:
    """Make the groups on the mesh of ``holder``, which has its attributes and no groups, with the weights of ``base``
    interpolated.

    A vertex belongs to a group when one of the base's vertices with a say in it does.
    """
    if not groups:
        return
    mesh = holder.data
    taken = {*(name for name, _ in groups), *(attribute.name for attribute in mesh.attributes)}
    temporary = unused_name(WEIGHTS, taken)
    members, numbers, weights = read_weights(base)
    for number, (name, lock) in enumerate(groups):
        chosen = numbers == number
        values = np.zeros((len(base.vertices), 2))
        values[members[chosen], 0] = weights[chosen]
        values[members[chosen], 1] = 1.0
        found = interpolated_at_vertices(control, values, subdivided)
        _write_group(holder, temporary, found[:, 0], found[:, 1] > 0)
        holder.vertex_groups[-1].name = name
        holder.vertex_groups[-1].lock_weight = lock


def read_weights(base: bpy.types.Mesh) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """The vertex, the group and the value of every weight of a mesh."""
    rows = [(vertex.index, entry.group, entry.weight) for vertex in base.vertices for entry in vertex.groups]
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return table[:, 0].astype(np.intp), table[:, 1].astype(np.intp), table[:, 2]


def _write_group(holder: bpy.types.Object, name: str, weights: NDArray[np.float32], belongs: BoolArray) -> None:
    write_attribute(holder.data, name, "FLOAT", "POINT", np.clip(weights, 0.0, 1.0))
    convert_attribute(holder, name, mode="VERTEX_GROUP")
    group = holder.vertex_groups[-1]
    # The operator leaves out weights of zero.
    group.add(np.flatnonzero(belongs & (weights <= 0)).tolist(), 0.0, "REPLACE")
