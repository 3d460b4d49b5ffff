# SPDX-License-Identifier: GPL-3.0-or-later
"""The polygon mesh as arrays, and its half-edge neighbours.

A corner (a face's visit to one of its vertices) is also the half-edge that leaves that vertex along the face, so
corner arrays and half-edge arrays share one numbering: the corners of face ``f`` are
``face_starts[f] … face_starts[f + 1] - 1``, in the order in which the face visits them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import blocks
from ..arrays.types import BoolArray, FloatArray, IndexArray

INFINITELY_SHARP = np.inf

# Indices of so small a part of what is counted are sorted faster than everything is looked through.
SORTED_UP_TO = 1 << 6

# Indices renumbered at once, so that no long array is made on the way.
INDICES_AT_ONCE = 1 << 13

# What is worked out from the faces' corners alone, and kept.
TOPOLOGY = (
    "face_sizes",
    "corner_faces",
    "next_corner",
    "previous_corner",
    "edge_face_counts",
    "vertex_face_counts",
    "_twins",
)


@dataclass(frozen=True)
class PolygonMesh:
    """A control mesh. V vertices, E edges, F faces of any size, C corners.

    positions: (V, 3) float64, in whatever space the caller measures the tolerance in.
    face_starts: (F + 1,) intp, the first corner of each face; the last entry is C.
    corner_vertices, corner_edges: (C,) intp, the vertex each corner stands at and the edge it leaves along.
    edge_vertices: (E, 2) intp, the two ends of each edge. Edges without faces are allowed and have no effect.
    edge_sharpness: (E,) float64, 0 smooth, positive semi-sharp, ``INFINITELY_SHARP``; see ``catmull_clark``.
    vertex_sharpness: (V,) float64, likewise.
    sharpness_is_explicit: whether the sharpness that follows from the topology (boundaries and the like) is already in
    the two arrays, see ``catmull_clark.apply_boundary_rule``.
    """

    positions: FloatArray
    face_starts: IndexArray
    corner_vertices: IndexArray
    corner_edges: IndexArray
    edge_vertices: IndexArray
    edge_sharpness: FloatArray
    vertex_sharpness: FloatArray
    sharpness_is_explicit: bool = False

    def changed(self, **fields: Any) -> PolygonMesh:
        """The mesh with other positions or another sharpness; what is known of its topology is not lost."""
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
        """(E,) intp, how many half-edges run along each edge: 0 loose, 1 boundary, 2 inside, more non-manifold."""
        return np.bincount(self.corner_edges, minlength=self.edge_count)

    @cached_property
    def vertex_face_counts(self) -> IndexArray:
        """(V,) intp, how many corners stand at each vertex."""
        return np.bincount(self.corner_vertices, minlength=self.vertex_count)

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
    """A PolygonMesh from faces alone: the edges are found, one for each pair of vertices joined by a face.

    positions: (V, 3) floats; face_sizes: (F,) ints; corner_vertices: (sum of sizes,) ints.
    sharp_edges: sharpness by (vertex, vertex), in either order; other edges are smooth.
    vertex_sharpness: (V,) floats, all smooth when left out.
    Raises KeyError when a pair in ``sharp_edges`` is not an edge.
    """
    positions = np.ascontiguousarray(positions, dtype=np.float64)
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


def submesh(mesh: PolygonMesh, faces: IndexArray) -> tuple[PolygonMesh, IndexArray]:
    """The given faces with every face that shares a vertex with them (their one-ring), as a mesh of its own.

    faces: (n,) ints, each face once. Returns the submesh and (m,) intp, the face of ``mesh`` each of its faces is: the
    given ones first, in the given order, then the ring in the order of ``mesh``. Vertices and edges keep their order;
    those of no kept face are left out. Sharpness is carried over unchanged, so that the outer border of the ring,
    which is none of the mesh's, gets no rules of a boundary: one refinement step then moves everything that touches
    the given faces exactly as it would in the whole mesh, and only the ring's outer half differs.
    """
    touched = np.zeros(mesh.vertex_count, dtype=bool)
    touched[mesh.corner_vertices[corners_of_faces(mesh, faces)]] = True
    in_ring = np.zeros(mesh.face_count, dtype=bool)
    in_ring[mesh.corner_faces[touched[mesh.corner_vertices]]] = True
    in_ring[faces] = False
    kept_faces = np.concatenate([np.asarray(faces, dtype=np.intp), np.flatnonzero(in_ring)])
    kept_corners = corners_of_faces(mesh, kept_faces)
    corner_vertices, corner_edges = mesh.corner_vertices[kept_corners], mesh.corner_edges[kept_corners]
    kept_vertices, kept_edges = compact(corner_vertices, mesh.vertex_count), compact(corner_edges, mesh.edge_count)
    new_vertex = np.zeros(mesh.vertex_count, dtype=np.intp)
    new_vertex[kept_vertices] = np.arange(len(kept_vertices))
    part = PolygonMesh(
        positions=mesh.positions[kept_vertices],
        face_starts=np.concatenate([[0], np.cumsum(mesh.face_sizes[kept_faces])]).astype(np.intp),
        corner_vertices=corner_vertices,
        corner_edges=corner_edges,
        edge_vertices=new_vertex[mesh.edge_vertices[kept_edges]],
        edge_sharpness=mesh.edge_sharpness[kept_edges],
        vertex_sharpness=mesh.vertex_sharpness[kept_vertices],
        sharpness_is_explicit=mesh.sharpness_is_explicit,
    )
    return part, kept_faces


def corners_of_faces(mesh: PolygonMesh, faces: IndexArray) -> IndexArray:
    """(sum of sizes,) intp, the corners of the given faces, face by face in the given order."""
    sizes = mesh.face_sizes[faces]
    skipped = mesh.face_starts[faces] - (np.cumsum(sizes) - sizes)
    return np.arange(sizes.sum()) + np.repeat(skipped, sizes)


def compact(indices: NDArray[Any], count: int, kept: IndexArray | None = None) -> IndexArray:
    """Which of 0 … count - 1 occur in ``indices`` or are kept, in ascending order; the indices are renumbered to match,
    in place."""
    kept = np.zeros(0, dtype=np.intp) if kept is None else kept
    if SORTED_UP_TO * indices.size < count and not len(kept):
        used, found = np.unique(indices, return_inverse=True)
        indices[:] = found.reshape(indices.shape)
        return used.astype(np.intp)
    is_used = np.zeros(count, dtype=bool)
    is_used[indices] = True
    is_used[kept] = True
    renumber(indices, is_used)
    return np.flatnonzero(is_used)


def renumber(indices: NDArray[Any], used: BoolArray) -> None:
    """Count indices of what is used among what is used, in place."""
    numbers, counted = np.empty(len(used), dtype=indices.dtype), 0
    for block in blocks(len(used), INDICES_AT_ONCE):
        found = np.flatnonzero(used[block])
        numbers[block][found] = np.arange(counted, counted + len(found), dtype=indices.dtype)
        counted += len(found)
    for block in blocks(len(indices), INDICES_AT_ONCE):
        indices[block] = numbers.take(indices[block])


class InvalidMeshError(ValueError):
    """The mesh has no Catmull-Clark surface that could be measured; the message says why in a modeller's words."""


# A face counts as having no area when its fan of triangles around the centroid covers less than this part of its
# perimeter squared: what rounding leaves of a face whose vertices lie on one line.
NO_AREA = 1e-12

# Beyond this size it takes less to sort a face's vertices than to compare each with all the others.
LARGEST_COMPARED_SIZE = 6

# An angle whose parallelogram covers more than this part of its sides squared is no rounding of a straight line.
CLEAR_ANGLE = 1e-6


def validate(mesh: PolygonMesh) -> None:
    """Raise InvalidMeshError unless the mesh has faces, finite positions, creases, and no degenerate face."""
    if mesh.face_count == 0:
        raise InvalidMeshError("the mesh has no faces")
    if not np.all(np.isfinite(mesh.positions)):
        astray = ~np.isfinite(mesh.positions).all(axis=1) & (mesh.vertex_face_counts > 0)
        _refuse(astray, "vertex", "vertices", "at no finite position")
    _refuse(np.isnan(mesh.edge_sharpness), "edge", "edges", "with a crease that is no number")
    _refuse(np.isnan(mesh.vertex_sharpness), "vertex", "vertices", "with a crease that is no number")
    _refuse(_faces_with_repeated_vertices(mesh), "face", "faces", "with a repeated vertex")
    _refuse(_faces_without_area(mesh), "face", "faces", "with zero area")


def _refuse(bad: BoolArray, one: str, many: str, fault: str) -> None:
    found = np.flatnonzero(bad)
    if len(found):
        raise InvalidMeshError(f"{len(found):,} {one if len(found) == 1 else many} {fault} (first: {one} {found[0]})")


def _faces_with_repeated_vertices(mesh: PolygonMesh) -> BoolArray:
    """(F,) bool: the vertices of small faces are compared two by two, those of others once they are sorted."""
    bad = np.zeros(mesh.face_count, dtype=bool)
    for size in np.flatnonzero(np.bincount(mesh.face_sizes)).tolist():
        faces = np.flatnonzero(mesh.face_sizes == size)
        first = mesh.face_starts[faces]
        vertices = [mesh.corner_vertices.take(first + corner) for corner in range(size)]
        small = size <= LARGEST_COMPARED_SIZE
        for one, other in combinations(vertices, 2) if small else pairwise(np.sort(vertices, axis=0)):
            bad[faces[one == other]] = True
    return bad


def _faces_without_area(mesh: PolygonMesh) -> BoolArray:
    """(F,) bool: a face with an angle at its first corner has area; the others are measured whole."""
    bad = np.zeros(mesh.face_count, dtype=bool)
    first, last = mesh.face_starts[:-1], mesh.face_starts[1:] - 1
    at_first, a, b = (
        mesh.positions.take(mesh.corner_vertices.take(corner), axis=0)
        for corner in (first, np.minimum(first + 1, last), last)
    )
    a -= at_first
    b -= at_first
    squared_a, product, squared_b = (np.einsum("ij,ij->i", one, other) for one, other in ((a, a), (a, b), (b, b)))
    # The parallelogram's area squared; what cancels in it is far below the angle asked for.
    areas = squared_a * squared_b - product * product
    doubtful = np.flatnonzero(areas <= (CLEAR_ANGLE * (squared_a + squared_b)) ** 2)
    if len(doubtful):
        bad[doubtful] = _faces_collapsed(mesh, doubtful)
    return bad


def _faces_collapsed(mesh: PolygonMesh, faces: IndexArray) -> BoolArray:
    """(faces,) bool: the fan of triangles around the centroid covers nothing."""
    sizes = mesh.face_sizes[faces]
    starts = np.cumsum(sizes) - sizes
    corners = corners_of_faces(mesh, faces)
    points = mesh.positions[mesh.corner_vertices[corners]]
    following = mesh.positions[mesh.corner_vertices[mesh.next_corner[corners]]]
    centroids = np.repeat(np.add.reduceat(points, starts) / sizes[:, None], sizes, axis=0)
    areas = np.add.reduceat(_doubled_area(points - centroids, following - centroids), starts)
    perimeters = np.add.reduceat(np.linalg.norm(following - points, axis=1), starts)
    return areas <= NO_AREA * perimeters**2


def _doubled_area(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, 3) vectors each → (N,) the area of the parallelogram they span."""
    return np.linalg.norm(np.cross(a, b), axis=1)
