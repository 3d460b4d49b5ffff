# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of a mesh that are moved copies of one another, as an Array modifier or Join make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.ranges import ranges
from ..arrays.types import BoolArray, IndexArray
from ..bounds.rounding import rounded_size, smallest_step
from ..deviation.box_tree import BoxTree, overlapping
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces, faces_alone

# The largest number of parts of which all pairs may be near.
MOST_PARTS = 1 << 12

# The number of different parts with equal numbers of faces, corners and vertices that are looked for.
MOST_KINDS = 8

# The largest part of the faces for which looking at one of each part pays.
LARGEST_SHARE = 0.5


@dataclass(frozen=True)
class LikeParts:
    """One of each part of a mesh. mesh: these parts alone. faces: (F,) intp, for each face of the whole mesh the like
    face of ``mesh``. off: the largest distance between a vertex and its like vertex, once the part is moved there."""

    mesh: PolygonMesh
    faces: IndexArray
    off: float

    def like(self, faces: IndexArray, found: IndexArray) -> tuple[IndexArray, IndexArray]:
        """(n,) intp twice: those of some faces of the whole mesh that are like one of the faces found of ``mesh``, and
        the place of the like face among these."""
        place = np.full(self.mesh.face_count, -1)
        place[found] = np.arange(len(found))
        places = place[self.faces[faces]]
        return faces[places >= 0], places[places >= 0]

    def in_all(self, values: BoolArray) -> BoolArray:
        """Whether values (F,) bool hold for all faces of the whole mesh that are like a face of ``mesh``."""
        found = np.ones(self.mesh.face_count, dtype=bool)
        found[self.faces[~values]] = False
        return found


def like_parts(mesh: PolygonMesh, largest_off: float, reach: float) -> LikeParts:
    """One of each part of a mesh; the mesh itself if hardly any parts are alike, or any may be near another: what is
    found of a part beside another does not hold for its copies. largest_off: the largest distance between vertices of
    like parts, in the unit of the positions; never more than a ``smallest_step``. reach: half of the least distance
    between parts.

    Parts have neither faces in common nor vertices, and their vertices follow one another in the mesh.
    """
    alone = LikeParts(mesh, np.arange(mesh.face_count), 0.0)
    parts = _Parts.of(mesh) if mesh.face_count else None
    if parts is None:
        return alone
    likes, off = np.arange(len(parts.face_counts)), 0.0
    for alike in parts.of_equal_size():
        found, farthest = parts.likes(mesh, alike, min(largest_off, smallest_step(mesh)))
        likes[alike], off = alike[found], max(off, farthest)
    is_kept = likes == np.arange(len(likes))
    if parts.face_counts[is_kept].sum() > LARGEST_SHARE * mesh.face_count or not parts.are_apart(mesh, reach):
        return alone
    kept = np.sort(parts.faces_of(np.flatnonzero(is_kept)))
    of_faces = np.empty(mesh.face_count, dtype=np.intp)
    of_faces[parts.faces_of(np.arange(len(likes)))] = np.searchsorted(kept, parts.faces_of(likes))
    own = faces_alone(mesh, kept).changed(axes=mesh.axes, rounded_size=rounded_size(mesh))
    return LikeParts(own, of_faces, off)


@dataclass(frozen=True)
class _Parts:
    """P parts of a mesh. faces: (F,) intp, the faces part by part; face_starts, face_counts: (P,) intp, the place of
    the first face of each part there, and the number of its faces; corner_counts: (P,) intp, of its corners.
    first_vertices, vertex_counts: (P,) intp, its range of vertices."""

    faces: IndexArray
    face_starts: IndexArray
    face_counts: IndexArray
    corner_counts: IndexArray
    first_vertices: IndexArray
    vertex_counts: IndexArray

    @staticmethod
    def of(mesh: PolygonMesh) -> _Parts | None:
        """The parts of a mesh with faces, or None if it has one only."""
        first, last = (each.reduceat(mesh.corner_vertices, mesh.face_starts[:-1]) for each in (np.minimum, np.maximum))
        begun, ended = (np.bincount(each, minlength=mesh.vertex_count) for each in (first, last))
        # No face has vertices both up to such a vertex and after it.
        is_last = np.cumsum(begun - ended) == 0
        of_vertices = np.cumsum(is_last) - is_last
        of_faces = of_vertices[first]
        if of_faces.min() == of_faces.max():
            return None
        of_faces = np.unique(of_faces, return_inverse=True)[1]
        faces = np.argsort(of_faces, kind="stable")
        counts = np.bincount(of_faces)
        starts = np.cumsum(counts) - counts
        corner_counts, firsts, lasts = (
            each.reduceat(values[faces], starts)
            for each, values in ((np.add, mesh.face_sizes), (np.minimum, first), (np.maximum, last))
        )
        return _Parts(faces, starts, counts, corner_counts, firsts, lasts - firsts + 1)

    def faces_of(self, parts: IndexArray) -> IndexArray:
        """The faces of some parts, part by part."""
        return self.faces[ranges(self.face_starts[parts], self.face_counts[parts])]

    def of_equal_size(self) -> list[IndexArray]:
        """The parts, ascending, that have equal numbers of faces, corners and vertices, where there are several."""
        sizes = np.stack([self.face_counts, self.corner_counts, self.vertex_counts], axis=1)
        kinds = np.unique(sizes, axis=0, return_inverse=True)[1].reshape(-1)
        order = np.argsort(kinds, kind="stable")
        groups = np.split(order, np.flatnonzero(np.diff(kinds[order])) + 1)
        return [group for group in groups if len(group) > 1]

    def likes(self, mesh: PolygonMesh, parts: IndexArray, largest_off: float) -> tuple[IndexArray, float]:
        """(n,) intp: for each of some parts of equal size (n,) the first one that it is like, or itself; and the
        largest distance between their vertices, at most ``largest_off``."""
        vertices = self.first_vertices[parts][:, None] + np.arange(self.vertex_counts[parts[0]])
        positions, joints = mesh.positions[vertices], self._joints(mesh, parts, vertices)
        likes, off, left = np.arange(len(parts)), 0.0, np.arange(len(parts))
        for _ in range(MOST_KINDS):
            if len(left) < 2:
                break
            offsets = positions[left] - positions[left[0]]
            distances = np.linalg.norm(np.ptp(offsets, axis=1), axis=1) / 2
            is_like = (joints[left] == joints[left[0]]).all(axis=1) & (distances <= largest_off)
            likes[left[is_like]], off = left[0], max(off, float(distances[is_like].max(initial=0.0)))
            is_like[0] = True
            left = left[~is_like]
        return likes, off

    def are_apart(self, mesh: PolygonMesh, reach: float) -> bool:
        """Whether parts are known to be farther than twice ``reach`` from one another, with all their levels and the
        surface, which stay in the box of their vertices."""
        low, high = (each.reduceat(mesh.positions, self.first_vertices) for each in (np.minimum, np.maximum))
        tree = BoxTree.around(low - reach, high + reach)
        return len(low) <= MOST_PARTS and len(overlapping(tree, tree)[0]) == len(low)

    def _joints(self, mesh: PolygonMesh, parts: IndexArray, vertices: IndexArray) -> IndexArray:
        """(n, m) integers: the sizes, vertices and sharpness of parts, in the order of their faces; equal in like
        parts."""
        faces = self.faces_of(parts)
        corners = corners_of_faces(mesh, faces)
        count = len(parts)
        sharpness = (mesh.edge_sharpness[mesh.corner_edges[corners]], mesh.vertex_sharpness[vertices])
        rows = [
            mesh.face_sizes[faces].reshape(count, -1),
            mesh.corner_vertices[corners].reshape(count, -1) - self.first_vertices[parts][:, None],
            *(np.ascontiguousarray(each + 0.0).view(np.int64).reshape(count, -1) for each in sharpness),
        ]
        return np.concatenate(rows, axis=1)
