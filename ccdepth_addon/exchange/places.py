# SPDX-License-Identifier: GPL-3.0-or-later
"""UV maps, colours and normals of a reduced mesh, from the places of its vertices on the mesh it was made from.

Decimate interpolates them along the edges it merges, and moves vertices off these edges: textures would slide.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..core import Places
from .blender_arrays import TYPES, read_built_in, read_values, write_values
from .custom_normals import CARRIED_NORMAL
from .kept_lines import changes_along_lines, line_edges


def interpolate_at(places: Places, source: bpy.types.Mesh, mesh: bpy.types.Mesh) -> None:
    """Write these attributes at the corners around the vertices of a mesh, from the triangles of another.

    Vertices on lines, which have not moved, and those that may belong to the other side of one keep what they have.
    """
    kept = np.zeros(len(mesh.vertices), dtype=bool)
    kept[line_edges(mesh)] = True
    beside_lines = np.zeros(len(source.vertices), dtype=bool)
    beside_lines[line_edges(source)] = True
    triangles = read_built_in(source.attributes, ".corner_vert", "value", np.int32).reshape(-1, 3)
    moved = ~kept & (places.triangles >= 0) & ~beside_lines[triangles].any(axis=1)[places.triangles]
    vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)
    corners = np.flatnonzero(moved[vertices])
    weights, which = places.weights[vertices[corners]], places.triangles[vertices[corners]]
    for attribute in mesh.attributes:
        if not (changes_along_lines(attribute) or attribute.name.startswith(CARRIED_NORMAL)):
            continue
        kind = TYPES[attribute.data_type]
        known = read_values(source.attributes[attribute.name].data, kind.value, kind.dtype, kind.width)
        values = read_values(attribute.data, kind.value, kind.dtype, kind.width)
        values[corners] = np.einsum("ck,ckd->cd", weights, known.reshape(len(triangles), 3, -1)[which])
        write_values(attribute.data, kind.value, values, kind.step)
