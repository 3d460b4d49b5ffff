# SPDX-License-Identifier: GPL-3.0-or-later
"""How far points of the mesh are from the surface at most: bounds of triangles and their parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..blocks import split
from ..mesh import FloatArray, IndexArray
from ..norms import squared_norms
from .bezier_pieces import CORNERS, BezierPieces, bilinear_pieces
from .box_tree import BoxTree, overlapping
from .findings import Findings
from .surface_to_mesh import SHARE_OF_LARGEST, SurfaceToMesh, first_of_each
from .triangles import Triangles, to_triangles

PARTS_AT_ONCE = 1 << 13
TRIED = 6

# The corners of a triangle's quarters, as sums of its own.
QUARTERS = (
    np.array(
        [
            [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
            [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
            [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
            [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
        ]
    )
    / 2
)


@dataclass(frozen=True)
class Facets:
    """The leaves of the surface, each as two triangles over its corners. leaves: (L,) intp; corners: (L, 4, 3); off:
    (L,) float64, how far surface and triangles are apart at equal parameters; tree: of boxes around both."""

    leaves: IndexArray
    corners: FloatArray
    off: FloatArray
    tree: BoxTree

    @staticmethod
    def of(pieces: BezierPieces) -> Facets:
        """Of all the leaves there are. docs/deviation.md, Facets."""
        leaves = pieces.leaves()
        corners = pieces.coefficients[leaves][:, :, CORNERS].swapaxes(1, 2)
        off = np.empty(len(leaves))
        for block in split(np.arange(len(leaves)), 1 << 14):
            apart = pieces.coefficients[leaves[block]] - bilinear_pieces(corners[block])
            off[block] = np.sqrt(squared_norms(apart.swapaxes(1, 2)).max(axis=1))
        twist = corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]
        off += np.sqrt(squared_norms(twist)) / 4 + pieces.excess[leaves]
        return Facets(leaves, corners, off, BoxTree.around(pieces.low[leaves], pieces.high[leaves]))

    def distances(self, places: FloatArray, which: IndexArray) -> tuple[FloatArray, FloatArray]:
        """(N,) from places (N, 3) to the nearer one of a leaf's triangles, and (N, 3) the nearest point."""
        a, b, c, d = self.corners[which].swapaxes(0, 1)
        first, at_first = to_triangles(places, a, b, c)
        second, at_second = to_triangles(places, a, c, d)
        return np.minimum(first, second), np.where((first <= second)[:, None], at_first, at_second)


@dataclass(frozen=True)
class Parts:
    """N parts of triangles. corners: (N, 3, 3); owners: (N,) intp, the triangle; bounds: (N,) float64, what is proved of
    each; leaves: (N,) intp, the piece that is nearest; near: (N,) float64, about how far that is."""

    corners: FloatArray
    owners: IndexArray
    bounds: FloatArray
    leaves: IndexArray
    near: FloatArray

    @staticmethod
    def unknown(corners: FloatArray, owners: IndexArray, bounds: FloatArray) -> Parts:
        """Of which nothing is known but these bounds."""
        return Parts(corners, owners, bounds, np.zeros(len(owners), dtype=np.intp), np.zeros(len(owners)))

    def at(self, chosen: FloatArray) -> Parts:
        """Some of them."""
        return Parts(*(column[chosen] for column in vars(self).values()))

    def quarters(self) -> Parts:
        """Four of each, whose bounds are that of the whole."""
        corners = np.einsum("qij,njd->nqid", QUARTERS, self.corners).reshape(-1, 3, 3)
        return Parts.unknown(corners, np.repeat(self.owners, 4), np.repeat(self.bounds, 4))


class MeshToSurface:
    """upper: (T,) float64, what is proved of each triangle; face_upper: (F,) float64, likewise of the parts that were
    compared with each control face."""

    def __init__(self, surface: SurfaceToMesh, face_count: int, whole: float) -> None:
        self.surface, self.findings, self.mesh = surface, surface.findings, surface.mesh
        self.whole = whole
        self.upper = np.zeros(self.mesh.count)
        self.face_upper = np.zeros(face_count)

    def settle(self) -> None:
        """Split triangles and pieces until what is proved is near what is reached."""
        count = self.mesh.count
        parts = Parts.unknown(self.mesh.points.swapaxes(0, 1), np.arange(count), np.full(count, self.whole))
        while len(parts.owners):
            facets = Facets.of(self.surface.pieces)
            for block in split(np.arange(len(parts.owners)), PARTS_AT_ONCE):
                if self.findings.is_exhausted(self.surface.pieces.count + len(parts.owners)):
                    self._record(parts)
                    return
                self._bound(facets, parts, block)
                self.findings.report(0.5)
            wanted = self._is_too_far(parts)
            self._record(parts.at(~wanted))
            parts = parts.at(wanted)
            used = np.unique(parts.leaves)
            self.surface.split(used[self.surface.pieces.first_child[used] < 0])
            parts = parts.quarters()

    def _record(self, parts: Parts) -> None:
        np.maximum.at(self.upper, parts.owners, parts.bounds)
        np.maximum.at(self.face_upper, self.surface.pieces.faces[parts.leaves], parts.bounds)

    def _is_too_far(self, parts: Parts) -> FloatArray:
        rough = parts.bounds > np.maximum(parts.near + SHARE_OF_LARGEST * self.findings.reached, self.findings.floor)
        return (parts.bounds > self.findings.target) | rough

    def _bound(self, facets: Facets, parts: Parts, block: IndexArray) -> None:
        corners = parts.corners[block]
        nearest, near = _nearest_facets(facets, corners.mean(axis=1))
        parts.near[block], parts.leaves[block] = near, facets.leaves[nearest]
        bounds = self._by_one_piece(facets, corners, nearest) + self.findings.allowance
        parts.bounds[block] = np.minimum(parts.bounds[block], bounds)

    def _by_one_piece(self, facets: Facets, corners: FloatArray, which: IndexArray) -> FloatArray:
        """(n,): the distance to a flat triangle is convex, and so longest at a corner."""
        a, b, c, d = facets.corners[which].swapaxes(0, 1)
        places = corners.swapaxes(0, 1)
        first = np.max([to_triangles(place, a, b, c)[0] for place in places], axis=0)
        second = np.max([to_triangles(place, a, c, d)[0] for place in places], axis=0)
        return np.minimum(first, second) + facets.off[which]


def _nearest_facets(facets: Facets, places: FloatArray) -> tuple[IndexArray, FloatArray]:
    """(P,) intp the leaves whose triangles are nearest to places (P, 3), and (P,) the distances."""
    tried = facets.tree.beside(places, TRIED)
    owners = np.repeat(np.arange(len(places)), TRIED)
    reach = (facets.distances(places[owners], tried.ravel())[0] + facets.off[tried.ravel()]).reshape(tried.shape)
    reach = reach.min(axis=1) * (1 + 1e-12) + np.finfo(float).tiny
    queries = BoxTree.around(places - reach[:, None], places + reach[:, None])
    owners, which = overlapping(queries, facets.tree)
    distances = facets.distances(places[owners], which)[0]
    first = first_of_each(owners, distances, len(places))
    return which[first], distances[first]
