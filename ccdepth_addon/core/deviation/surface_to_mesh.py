# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest distances from points of the surface to the mesh: bounds of Bézier pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import FEW_AT_ONCE, index_chunks
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, lengths, units
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces
from .box_tree import first_of_each
from .covering_triangles import over_triangles
from .findings import Findings
from .spread import NONE
from .triangles import Triangles

# The number of pieces of each block whose corners are tried for reached distances.
LOOKED_AT = 64

# The share of pieces and time for this way.
SHARE_OF_LIMITS = 0.6

# A covered piece larger than this many times the goal is hardly within the goal of one triangle.
SMALL_FOR_ONE = 4.0

# A bound of up to this many times the goal may reach the goal along another direction.
NEARLY = 1.5


@dataclass(frozen=True)
class NearestTriangles(Table):
    """The distances (P,) float64, the nearest triangles (P,) intp, and the nearest points (P, 3)."""

    distances: FloatArray
    which: IndexArray
    points: FloatArray


def nearest_triangles(triangles: Triangles, places: FloatArray) -> NearestTriangles:
    """The triangles nearest to points (P, 3); no distance is longer than the true one, but for a part that ``Findings``
    subtracts."""
    owners, which = triangles.tree.near(places, lambda some, tried: triangles.distances(some, tried)[0])
    distances, points = triangles.distances(places[owners], which)
    distances = np.maximum(distances - triangles.slack[which], 0.0)
    first = first_of_each(owners, distances, len(places))
    return NearestTriangles(distances[first], which[first], points[first])


class SurfaceToMesh:
    """The search from the surface to the mesh. upper: (N,) float64, the proved reduced distance of each piece;
    triangles: (N,) intp, the triangle of this bound; nearest: (N,) intp, the triangle nearest to the piece's middle."""

    def __init__(self, pieces: BezierPieces, mesh: Triangles, findings: Findings, whole: float) -> None:
        self.pieces, self.mesh, self.findings = pieces, mesh, findings
        self.upper = np.full(pieces.count, whole)
        self.triangles = np.zeros(pieces.count, dtype=np.intp)
        self.nearest = np.zeros(pieces.count, dtype=np.intp)

    def settle(self, active: IndexArray) -> None:
        """Split pieces, first the given ones, until proved and reached distances are near each other."""
        self.findings.rounds = 0
        while len(active):
            # The largest reached distance tells which bounds are good enough.
            for work, share in ((self._look, 0.0), (self._bound, 0.5)):
                for done, block in enumerate(index_chunks(active, FEW_AT_ONCE)):
                    if self.findings.must_end(self.pieces.count, SHARE_OF_LIMITS):
                        return
                    work(block)
                    done_here = min((done + 1) * FEW_AT_ONCE / len(active), 1.0)
                    self.findings.report_round(0, share + done_here / 2)
            active = self.split(active[self._is_too_far(active)])
            self.findings.rounds += 1

    def split(self, pieces: IndexArray) -> IndexArray:
        """(4n,) intp: the children of those of some pieces that are not split yet, with the bounds of their parents."""
        pieces = pieces[self.pieces.first_child[pieces] == NONE]
        if not len(pieces):
            return pieces
        children = self.pieces.split(pieces)
        first = self.pieces.children(pieces)
        for name in ("upper", "triangles", "nearest"):
            grown = np.resize(getattr(self, name), self.pieces.count)
            grown[first] = grown[pieces][:, None]
            setattr(self, name, grown)
        return children

    def _is_too_far(self, pieces: IndexArray) -> BoolArray:
        return self.upper[pieces] > self._goals(pieces)

    def _look(self, block: IndexArray) -> None:
        """Find the distances of the pieces' middles."""
        pieces = self.pieces
        middles, is_bilinear = pieces.middles[block], pieces.is_bilinear(block)
        nearest = nearest_triangles(self.mesh, middles)
        self.nearest[block] = nearest.which
        factors = pieces.factors_at(block, np.full((1, 4), 0.25), middles)
        off = np.where(is_bilinear, pieces.excess[block], 0.0)
        np.maximum.at(self.findings.in_faces, pieces.faces[block], (nearest.distances - off) / factors)
        on_surface = np.flatnonzero(~is_bilinear)
        self._note(block[on_surface], middles[on_surface], nearest.at(on_surface), factors[on_surface])

    def _bound(self, block: IndexArray) -> None:
        pieces, findings = self.pieces, self.findings
        block = block[self.upper[block] > self._goals(block)]
        if not len(block):
            return
        which = self.nearest[block]
        covered = self._bound_by_heights(block, which)
        sizes = lengths(pieces.high[block] - pieces.low[block]) / pieces.least[block]
        is_small = sizes < SMALL_FOR_ONE * self._goals(block)
        left = np.flatnonzero((self.upper[block] > self._goals(block)) & (is_small | ~covered))
        self._improve(block[left], self._by_one_triangle(block[left], which[left]), which[left])
        upper = self.upper[block]
        farthest = np.argsort(-upper)[:LOOKED_AT]
        farthest = block[farthest[upper[farthest] > self._goals(block[farthest])]]
        if len(farthest):
            corners = pieces.coefficients[farthest][:, :, CORNERS].swapaxes(1, 2).reshape(-1, 3)
            found = nearest_triangles(self.mesh, corners)
            factors = pieces.factors_at(farthest, np.eye(4), corners)
            self._note(np.repeat(farthest, 4), corners, found, factors)
            np.maximum.at(findings.in_faces, np.repeat(pieces.faces[farthest], 4), found.distances / factors)

    def _goals(self, block: IndexArray) -> FloatArray:
        return self.findings.goals(self.pieces.faces[block])

    def _bound_by_heights(self, block: IndexArray, nearest: IndexArray) -> BoolArray:
        """Bound pieces by heights along the normal of the nearest triangle, and if the bound is not near enough along
        the piece's own. Returns (n,) bool, whether triangles cover the pieces, as far as examined."""
        pieces = self.pieces
        last = np.full(len(block), np.inf)
        for directions in (self.mesh.normals[nearest], self.normals(block)):
            goals = self._goals(block)
            # Another direction makes up for a lack of covering, or for a little.
            helps = (np.isinf(last) | (last < NEARLY * goals)) & directions.any(axis=1)
            left = np.flatnonzero((self.upper[block] > goals) & helps)
            found = over_triangles(
                pieces,
                block[left],
                directions[left],
                self.mesh,
                nearest[left],
                goals[left] - self.findings.allowance,
                self.findings.margin,
            )
            self.findings.tick()
            last[left] = found[0]
            self._improve(block[left], *found)
        return np.isfinite(last)

    def normals(self, block: IndexArray) -> FloatArray:
        """(n, 3): the approximate normals of the pieces' middles; zero without a normal."""
        a, b, c, d = np.moveaxis(self.pieces.coefficients[block][:, :, CORNERS], 2, 0)
        return units(cross_products(c - a, d - b))

    def _improve(self, block: IndexArray, upper: FloatArray, which: IndexArray) -> None:
        upper = upper + self.findings.allowance
        better = upper < self.upper[block]
        self.upper[block[better]] = upper[better]
        self.triangles[block[better]] = which[better]

    def _note(self, block: IndexArray, points: FloatArray, nearest: NearestTriangles, factors: FloatArray) -> None:
        reduced, faces = nearest.distances / factors, self.pieces.faces[block]
        self.findings.note(reduced, points, nearest.points, faces, nearest.which, surface_to_mesh=True)

    def _by_one_triangle(self, block: IndexArray, which: IndexArray) -> FloatArray:
        """(n,): reduced bounds by one triangle: the distance to a triangle is convex, and so no longer than at the
        farthest coefficient."""
        coefficients = self.pieces.coefficients[block].swapaxes(1, 2).reshape(-1, 3)
        distances = self.mesh.distances(coefficients, np.repeat(which, 16))[0]
        return (distances.reshape(-1, 16).max(axis=1) + self.pieces.excess[block]) / self.pieces.least[block]
