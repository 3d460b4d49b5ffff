# SPDX-License-Identifier: GPL-3.0-or-later
"""The polygon mesh as arrays, and its half-edge neighbours.

A corner (a vertex of a face, as seen from the face) is also the half-edge that leaves the vertex along the face, so
corner arrays and half-edge arrays share one numbering: the corners of face ``f`` are ``face_starts[f] … face_starts[f +
1] - 1``, in order around the face.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray

INFINITELY_SHARP = np.inf

# Cached properties that depend on the faces' corners alone.
TOPOLOGY = (
    "face_sizes",
    "corner_faces",
    "next_corner",
    "previous_corner",
    "edge_face_counts",
    "vertex_face_counts",
    "largest_surroundings",
    "_twins",
)


@dataclass(frozen=True)
class PolygonMesh:
    """A control mesh with V vertices, E edges, F faces of any size, and C corners.

    positions: (V, 3) float64, in the space where the caller measures the tolerance.
    face_starts: (F + 1,) intp, the first corner of each face; the last entry is C.
    corner_vertices, corner_edges: (C,) intp, the vertex of each corner, and the edge from there to the next corner.
    edge_vertices: (E, 2) intp, the two ends of each edge. Edges without faces are allowed and have no effect.
    edge_sharpness: (E,) float64, 0 smooth, positive semi-sharp, ``INFINITELY_SHARP``; see ``sharpness``.
    vertex_sharpness: (V,) float64, likewise.
    sharpness_is_explicit: whether both arrays include the sharpness from the topology, such as at boundaries; see
    ``sharpness.apply_boundary_rule``.
    rounded_size: for positions computed from others, the length relative to which the others were rounded; see
    ``rounding.rounded_size``.
    axes: (3, 3) float64, in columns the axes of the space where Blender chooses the diagonals of quads, in coordinates
    of the positions; None for the space of the positions.
    """

    positions: FloatArray
    face_starts: IndexArray
    corner_vertices: IndexArray
    corner_edges: IndexArray
    edge_vertices: IndexArray
    edge_sharpness: FloatArray
    vertex_sharpness: FloatArray
    sharpness_is_explicit: bool = False
    rounded_size: float = 0.0
    axes: FloatArray | None = None

    def changed(self, **fields: Any) -> PolygonMesh:
        """The mesh with other positions or another sharpness; cached topology is kept."""
        mesh = replace(self, **fields)
        vars(mesh).update({name: vars(self)[name] for name in TOPOLOGY if name in vars(self)})
        return mesh

    @property
    def vertex_count(self) -> int:
        return len(self.positions)

    @property
    def edge_count(self) -> int:
        return len(self.edge_vertices)

    @property
    def face_count(self) -> int:
        return len(self.face_starts) - 1

    @property
    def corner_count(self) -> int:
        return len(self.corner_vertices)

    @cached_property
    def face_sizes(self) -> IndexArray:
        """(F,) intp, the number of corners of each face."""
        return np.diff(self.face_starts)

    @cached_property
    def corner_faces(self) -> IndexArray:
        """(C,) intp, the face of each corner."""
        return np.repeat(np.arange(self.face_count), self.face_sizes)

    @cached_property
    def next_corner(self) -> IndexArray:
        """(C,) intp, the corner after each one in its face."""
        following = np.arange(1, self.corner_count + 1)
        following[self.face_starts[1:] - 1] = self.face_starts[:-1]
        return following

    @cached_property
    def previous_corner(self) -> IndexArray:
        """(C,) intp, the corner before each one in its face."""
        preceding = np.arange(-1, self.corner_count - 1)
        preceding[self.face_starts[:-1]] = self.face_starts[1:] - 1
        return preceding

    @cached_property
    def edge_face_counts(self) -> IndexArray:
        """(E,) intp, the number of half-edges along each edge: 0 loose, 1 boundary, 2 inside, more non-manifold."""
        return np.bincount(self.corner_edges, minlength=self.edge_count)

    @cached_property
    def vertex_face_counts(self) -> IndexArray:
        """(V,) intp, the number of corners at each vertex."""
        return np.bincount(self.corner_vertices, minlength=self.vertex_count)

    @cached_property
    def largest_surroundings(self) -> int:
        """The largest number of points averaged into a vertex of the next level: the largest sum of face sizes less
        one, over the faces at a vertex or beyond the edges of a face. Quads replace missing faces; the least is 12."""
        sizes = self.face_sizes[self.corner_faces] - 1
        beyond = np.where(self.edge_has_twins[self.corner_edges], sizes[self.twin], 3)
        sums = (np.bincount(self.corner_vertices, sizes), np.bincount(self.corner_faces, beyond))
        return int(max(total.max(initial=12) for total in sums))

    @property
    def twin(self) -> IndexArray:
        """(C,) intp, the half-edge on the other side of each edge; a half-edge without one is its own twin.

        Only an edge inside a manifold surface with consistently oriented faces has twins: exactly two half-edges,
        running in opposite directions.
        """
        return self._twins[0]

    @property
    def edge_has_twins(self) -> BoolArray:
        """(E,) bool, whether each edge has twins."""
        return self._twins[1]

    @cached_property
    def _twins(self) -> tuple[IndexArray, BoolArray]:
        half_edges = np.arange(self.corner_count)
        last = np.zeros(self.edge_count, dtype=np.intp)
        last[self.corner_edges] = half_edges
        first = np.zeros(self.edge_count, dtype=np.intp)
        first[self.corner_edges[::-1]] = half_edges[::-1]
        paired = (self.edge_face_counts == 2) & (self.corner_vertices[first] != self.corner_vertices[last])
        if np.all(paired):
            return (first + last)[self.corner_edges] - half_edges, paired
        total = np.where(paired, first + last, 0)[self.corner_edges]
        return np.where(paired[self.corner_edges], total - half_edges, half_edges), paired


def polygon_mesh(
    positions: FloatArray,
    face_sizes: IndexArray,
    corner_vertices: IndexArray,
    *,
    sharp_edges: dict[tuple[int, int], float] | None = None,
    vertex_sharpness: FloatArray | None = None,
) -> PolygonMesh:
    """A PolygonMesh from faces alone, with one edge for each pair of vertices that a face joins.

    positions: (V, 3) floats; face_sizes: (F,) ints; corner_vertices: (sum of sizes,) ints.
    sharp_edges: sharpness by (vertex, vertex), in either order; other edges are smooth.
    vertex_sharpness: (V,) floats, all smooth by default.
    Raises KeyError for a pair in ``sharp_edges`` without an edge, and IndexError for a corner at a missing vertex.
    """
    positions = np.ascontiguousarray(positions, dtype=np.float64)
    outside = np.flatnonzero((np.asarray(corner_vertices) < 0) | (np.asarray(corner_vertices) >= len(positions)))
    if len(outside):
        first = outside[0]
        raise IndexError(f"corner {first} stands at vertex {corner_vertices[first]}, and there are {len(positions)}")
    face_starts = np.concatenate([[0], np.cumsum(face_sizes)]).astype(np.intp)
    corner_vertices = np.ascontiguousarray(corner_vertices, dtype=np.intp)
    following = np.arange(1, len(corner_vertices) + 1)
    following[face_starts[1:] - 1] = face_starts[:-1]
    ends = np.sort(np.stack([corner_vertices, corner_vertices[following]], axis=1), axis=1)
    edge_vertices, corner_edges = np.unique(ends, axis=0, return_inverse=True)
    edge_sharpness = np.zeros(len(edge_vertices))
    if sharp_edges:
        edge_of = {(a, b): edge for edge, (a, b) in enumerate(edge_vertices.tolist())}
        for (a, b), sharpness in sharp_edges.items():
            edge_sharpness[edge_of[min(a, b), max(a, b)]] = sharpness
    if vertex_sharpness is None:
        vertex_sharpness = np.zeros(len(positions))
    return PolygonMesh(
        positions=positions,
        face_starts=face_starts,
        corner_vertices=corner_vertices,
        corner_edges=corner_edges.reshape(-1).astype(np.intp),
        edge_vertices=edge_vertices.astype(np.intp),
        edge_sharpness=edge_sharpness,
        vertex_sharpness=np.ascontiguousarray(vertex_sharpness, dtype=np.float64),
    )
