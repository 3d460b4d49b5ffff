# SPDX-License-Identifier: GPL-3.0-or-later
"""The result of a subdivision: polygons, with the place of every vertex and corner on the control mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

from ..arrays.types import BoolArray, FloatArray, IndexArray, ShortIndexArray
from ..surface.surface_points import SurfacePoints


@dataclass(frozen=True)
class SubdividedMesh:
    """A mesh of V vertices on the limit surface of a control mesh, with E edges, F faces and C corners.

    vertex_points: SurfacePoints (V)          where each vertex lies; corner -1 for vertices without faces; computed
                                              on demand
    positions: (V, 3) float64                 limit positions, object space
    face_starts: (F + 1,) intp; corner_vertices: (C,) int32; corner_edges: (C,) int32; edge_vertices: (E, 2) int32
    corner_points: SurfacePoints (C)          where each corner lies, in its face's own base face; computed on demand
    base_faces: (F,) int32                    face of the control mesh
    base_edges: (E,) int32                    edge of the control mesh it lies on, or -1 inside a face
    base_vertices: (V,) int32                 vertex of the control mesh it is, or -1
    vertex_edges: (V,) int32                  edge of the control mesh it lies inside of, or -1
    """

    find_vertex_points: Callable[[], SurfacePoints]
    positions: FloatArray
    face_starts: IndexArray
    corner_vertices: ShortIndexArray
    corner_edges: ShortIndexArray
    edge_vertices: ShortIndexArray
    find_corner_points: Callable[[], SurfacePoints]
    base_faces: ShortIndexArray
    base_edges: ShortIndexArray
    base_vertices: ShortIndexArray
    vertex_edges: ShortIndexArray

    @property
    def vertex_points(self) -> SurfacePoints:
        return self.find_vertex_points()

    @property
    def is_loose(self) -> BoolArray:
        """(V,) bool: whether a vertex is a control vertex without faces, and so without a place on the surface."""
        return self.vertex_points.corners < 0

    @cached_property
    def corner_points(self) -> SurfacePoints:
        return self.find_corner_points()
