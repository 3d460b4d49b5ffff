# SPDX-License-Identifier: GPL-3.0-or-later
"""The second-order norms of all patches of a mesh at once: patches beside each other share second differences, and each
one is computed once.

The second difference of a half-edge that leaves a vertex V is 2V - A - B, with A and B the ends of the edges at V on
its two sides. A regular patch has those of its four half-edges and their twins, and of the eight that come in to its
corners along the sides of the neighbouring faces. An extraordinary patch also has those of all half-edges that leave
its extraordinary vertex or come in to it (Cheng, Chen and Yong 2006, sections 2 and 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.patches import PatchKind, PatchKinds


@dataclass(frozen=True)
class MeshNorms:
    """The second differences of a mesh's patches, for any positions of its vertices.

    faces: (P,) intp, regular ones without sharp sides and extraordinary ones, rising. differences: (16, P) int32, the
    second differences that patches of both kinds have. of_valences: places among the faces, by the patch's valence (4
    for regular ones). middles, ones, others: (N,) intp, the vertices V, A and B of each difference, every one once.
    extraordinary: (Q,) intp, places among the faces, and vertices: (Q,) intp, at which of the extraordinary vertices
    each is. spokes: (S,) int32, the differences around these, one vertex after the other, from spoke_starts on.
    """

    faces: IndexArray
    differences: NDArray[np.int32]
    of_valences: dict[int, IndexArray]
    middles: IndexArray
    ones: IndexArray
    others: IndexArray
    extraordinary: IndexArray
    vertices: IndexArray
    spokes: NDArray[np.int32]
    spoke_starts: IndexArray

    @staticmethod
    def of(mesh: PolygonMesh, kinds: PatchKinds) -> MeshNorms:
        """Of a mesh and the kinds of its faces."""
        is_regular = kinds.inside & (kinds.kinds == PatchKind.REGULAR)
        faces = np.flatnonzero(is_regular | (kinds.kinds == PatchKind.EXTRAORDINARY))
        own = mesh.face_starts[faces] + np.arange(4)[:, None]
        across = mesh.twin[own]
        inward = mesh.previous_corner[across], mesh.twin[mesh.next_corner[across]]
        extraordinary = np.flatnonzero(~is_regular[faces])
        found = mesh.corner_vertices[kinds.extraordinary_corners[faces[extraordinary]]]
        centres, vertices = np.unique(found, return_inverse=True)
        spokes, spoke_starts = _spokes(mesh, centres)
        half_edges = np.concatenate([own, across, *inward])
        numbers, used = _numbered(mesh, half_edges, spokes)
        before, after = _beside(mesh)
        return MeshNorms(
            faces=faces,
            differences=numbers[half_edges],
            of_valences=_of_valences(mesh, kinds, faces),
            middles=mesh.corner_vertices[used],
            ones=before[used],
            others=after[used],
            extraordinary=extraordinary,
            vertices=vertices,
            spokes=numbers[spokes],
            spoke_starts=spoke_starts,
        )

    def values(self, positions: FloatArray) -> FloatArray:
        """(P,): the norms of the patches with the vertices at these positions (V, 3)."""
        squares = np.zeros(len(self.middles))
        for column in np.ascontiguousarray(positions.T):
            lengths = 2.0 * column.take(self.middles)
            lengths -= column.take(self.ones)
            lengths -= column.take(self.others)
            lengths *= lengths
            squares += lengths
        largest = squares.take(self.differences[0])
        for differences in self.differences[1:]:
            np.maximum(largest, squares.take(differences), out=largest)
        if len(self.extraordinary):
            around = np.maximum.reduceat(squares.take(self.spokes), self.spoke_starts).take(self.vertices)
            largest[self.extraordinary] = np.maximum(largest[self.extraordinary], around)
        return np.sqrt(largest)


def _of_valences(mesh: PolygonMesh, kinds: PatchKinds, faces: IndexArray) -> dict[int, IndexArray]:
    """The places of the faces whose patches have each valence; that of regular ones is 4."""
    valences = mesh.vertex_face_counts[mesh.corner_vertices[kinds.extraordinary_corners[faces]]]
    valences[kinds.kinds[faces] == PatchKind.REGULAR] = 4
    return {valence: np.flatnonzero(valences == valence) for valence in np.unique(valences).tolist()}


def _spokes(mesh: PolygonMesh, centres: IndexArray) -> tuple[IndexArray, IndexArray]:
    """The half-edges that leave some vertices or come in to them, vertex by vertex, and where those of each begin."""
    is_centre = np.zeros(mesh.vertex_count, dtype=bool)
    is_centre[centres] = True
    leaving = np.flatnonzero(is_centre[mesh.corner_vertices])
    leaving = leaving[np.argsort(mesh.corner_vertices[leaving], kind="stable")]
    counts = mesh.vertex_face_counts[centres]
    return np.stack([leaving, mesh.twin[leaving]], axis=1).reshape(-1), 2 * (np.cumsum(counts) - counts)


def _beside(mesh: PolygonMesh) -> tuple[IndexArray, IndexArray]:
    """(C,) each: the vertices at the ends of the edges on both sides of every half-edge, where it starts."""
    turned = mesh.next_corner[mesh.twin]
    return mesh.corner_vertices[mesh.previous_corner], mesh.corner_vertices[mesh.next_corner[turned]]


def _numbered(mesh: PolygonMesh, *used: IndexArray) -> tuple[NDArray[np.int32], IndexArray]:
    """(C,) int32: the number of the second difference of each half-edge that is used; and a half-edge of each.

    At a vertex of four faces opposite half-edges have the same one.
    """
    before, after = _beside(mesh)
    turned = mesh.next_corner[mesh.twin]
    opposite = turned[turned]
    own = np.arange(mesh.corner_count)
    is_same = (opposite[opposite] == own) & (before[opposite] == after) & (after[opposite] == before)
    first = np.where(is_same, np.minimum(own, opposite), own)
    is_used = np.zeros(mesh.corner_count, dtype=bool)
    for half_edges in used:
        is_used[first[half_edges]] = True
    numbers = np.cumsum(is_used, dtype=np.int32) - np.int32(1)
    return numbers[first], np.flatnonzero(is_used)
