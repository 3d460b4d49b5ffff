# SPDX-License-Identifier: GPL-3.0-or-later
"""A subdivision result: polygons, and where on the control mesh each of their parts lies."""

from __future__ import annotations

from dataclasses import dataclass

from .mesh import FloatArray, IndexArray
from .surface_points import SurfacePoints


@dataclass(frozen=True)
class SubdividedMesh:
    """Polygons on the limit surface of a control mesh. V vertices, E edges, F faces, C corners.

    vertex_points: SurfacePoints (V)          where each vertex lies; corner -1 for vertices without faces
    positions: (V, 3) float64                 limit positions, object space
    face_starts: (F + 1,) intp; corner_vertices: (C,) intp; corner_edges: (C,) intp; edge_vertices: (E, 2) intp
    corner_points: SurfacePoints (C)          where each corner lies, in its face's own base face
    base_faces: (F,) intp                     face of the control mesh
    base_edges: (E,) intp                     edge of the control mesh it lies on, or -1 inside a face
    base_vertices: (V,) intp                  vertex of the control mesh it is, or -1
    vertex_edges: (V,) intp                   edge of the control mesh it lies inside of, or -1
    """

    vertex_points: SurfacePoints
    positions: FloatArray
    face_starts: IndexArray
    corner_vertices: IndexArray
    corner_edges: IndexArray
    edge_vertices: IndexArray
    corner_points: SurfacePoints
    base_faces: IndexArray
    base_edges: IndexArray
    base_vertices: IndexArray
    vertex_edges: IndexArray
