# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluated mesh → the triangles and edges that the viewport draws, with a value for each face."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from .blender_arrays import read_built_in, read_values
from .result_attributes import AttributeKind, has_values

# Edges of larger meshes are too many to be seen, and take long to draw.
MOST_EDGES = 400_000


@dataclass(frozen=True)
class DisplayedMesh:
    """corners: (C, 3) float32, the place of each corner of a face. values: (C,), that of its face. triangles: (T, 3)
    int32, of corners. chosen: (S, 3), those of selected faces, where they are wanted. edges: (E, 2, 3) float32, the
    ends of those that faces have; none of a very large mesh."""

    corners: NDArray[np.float32]
    values: NDArray[np.int32] | NDArray[np.float32]
    triangles: NDArray[np.int32]
    chosen: NDArray[np.int32]
    edges: NDArray[np.float32]


def read_displayed_mesh(
    mesh: bpy.types.Mesh, kind: AttributeKind, *, with_hidden: bool, with_chosen: bool
) -> DisplayedMesh | None:
    """What a viewport draws of an evaluated mesh; None where it has no such values.

    with_hidden: whether hidden faces are drawn as well, as they are in Object Mode. with_chosen: whether selected ones
    are told apart.
    """
    face_count, corner_count = len(mesh.polygons), len(mesh.loops)
    if not has_values(mesh, kind) or not 0 < face_count == len(mesh.attributes[kind.name].data):
        return None
    positions = read_built_in(mesh.attributes, "position", "vector", np.float32, 3)
    corner_vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)
    sizes = np.diff(read_values(mesh.polygons, "loop_start", np.int32), append=corner_count)
    values = np.repeat(read_values(mesh.attributes[kind.name].data, "value", kind.values.dtype), sizes)
    # The viewport's own diagonals: others would cross the surface it draws of a bent quad.
    mesh.calc_loop_triangles()
    triangles = read_values(mesh.loop_triangles, "loops", np.int32, 3)
    shown = np.ones(corner_count, dtype=np.bool_)
    if not with_hidden and ".hide_poly" in mesh.attributes:
        shown = np.repeat(~read_values(mesh.polygons, "hide", np.bool_), sizes)
        triangles = np.ascontiguousarray(triangles[shown[triangles[:, 0]]])
    chosen = triangles[:0]
    if with_chosen:
        selected = np.repeat(read_values(mesh.polygons, "select", np.bool_), sizes)
        chosen = np.ascontiguousarray(triangles[selected[triangles[:, 0]]])
    edges = np.empty((0, 2, 3), dtype=np.float32)
    if len(mesh.edges) <= MOST_EDGES:
        of_faces = np.zeros(len(mesh.edges), dtype=np.bool_)
        of_faces[read_built_in(mesh.attributes, ".corner_edge", "value", np.int32)[shown]] = True
        ends = read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2)[of_faces]
        edges = positions[ends]
    return DisplayedMesh(positions[corner_vertices], values, triangles, chosen, edges)
