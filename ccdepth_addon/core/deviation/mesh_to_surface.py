# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest distances from points of the mesh to the surface: bounds of triangles and their parts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, chunks, index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths, squared_norms
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.bicubic import CORNERS
from ..tolerance.variation import Variation
from .bezier_pieces import BezierPieces, bezier_pieces, bilinear_pieces
from .box_tree import BoxTree, first_of_each
from .columns import Table, columns
from .covering_pieces import EXCESS_SHARE, over_pieces
from .piece_factors import PieceFactors
from .surface_to_mesh import SurfaceToMesh
from .triangles import Triangles, distance_slack, to_quads, to_triangles

# The number of parts with corners tried for reached distances, the number of corners measured then, and the relative
# accuracy.
LOOKED_AT, MEASURED, MEASURED_SHARE = 512, 16, 0.005

# Pieces larger than this part of the triangle they are compared with are split for it; where they are below the other
# part, so is the triangle.
FINE_SHARE, COARSE_SHARE = 0.25, 0.5

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

# Surface and triangle are seen along the surface's normal where the cosine between both normals is less.
TILTED = 0.98

# Triangles with a height below this part of their longest side are cut along that side alone.
LONG = 0.25

# Pieces with too large an excess are split up to this many times at once: parts wait for them.
DEEPER = 5

# A new tree is made when the number of pieces has grown by this factor.
GROWN = 1.5


@dataclass(frozen=True)
class Facets(Table):
    """Pieces, each as two triangles over its corners. pieces: (L,) intp; corners: (L, 4, 3); off: (L,) float64, bounds
    of the distance between surface and triangles at equal parameters, with ``distance_slack``; least, greatest: (L,)
    float64, the factors on the tolerance. docs/deviation.md, Facets."""

    pieces: IndexArray
    corners: FloatArray
    off: FloatArray
    least: FloatArray
    greatest: FloatArray

    @staticmethod
    def of(pieces: BezierPieces, chosen: IndexArray, tick: Callable[[], None] = lambda: None) -> Facets:
        """The facets of chosen pieces. tick: called again and again; it may raise to stop."""
        corners, off = np.empty((len(chosen), 4, 3)), np.empty(len(chosen))
        for block in chunks(len(chosen), AT_ONCE):
            coefficients = pieces.coefficients[chosen[block]]
            corners[block] = coefficients[:, :, CORNERS].swapaxes(1, 2)
            apart = coefficients - bilinear_pieces(corners[block])
            off[block] = np.sqrt((apart * apart).sum(axis=1).max(axis=1))
            tick()
        twist = corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]
        off += lengths(twist) / 4 + pieces.excess[chosen]
        points = corners.swapaxes(0, 1)
        off += np.maximum(distance_slack(points[[0, 1, 2]]), distance_slack(points[[0, 2, 3]]))
        return Facets(chosen, corners, off, pieces.least[chosen], pieces.greatest[chosen])

    def distances(self, places: FloatArray, which: IndexArray) -> tuple[FloatArray, FloatArray]:
        """The distances (N,) from places (N, 3) to the nearer of a piece's triangles, and the nearest points (N, 3)."""
        found, nearest = np.empty(len(places)), np.empty((len(places), 3))
        for some in chunks(len(places), AT_ONCE):
            found[some], points, _ = to_quads(columns(places[some]), columns(self.corners[which[some]]))
            nearest[some] = points.T
        return found, nearest


@dataclass(frozen=True)
class Leaves:
    """Facets of pieces that cover the surface, in a tree of boxes. The children of a piece split since then stand for
    the piece."""

    pieces: BezierPieces
    facets: Facets
    tree: BoxTree
    count: int

    @staticmethod
    def of(pieces: BezierPieces, tick: Callable[[], None]) -> Leaves:
        """The facets of the present leaves."""
        leaves = pieces.leaves()
        facets = Facets.of(pieces, leaves, tick)
        return Leaves(pieces, facets, BoxTree.around(pieces.low[leaves], pieces.high[leaves]), pieces.count)

    def near(self, places: FloatArray, share: float) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: places (P, 3) and the facets of pieces that can be nearest by reduced distance, by distance
        as well; or with a share of 1 of the distances between surface and facets, of pieces with a leaf that can be
        nearest."""
        most = self.facets.greatest.max()

        def farthest(some: FloatArray, tried: IndexArray) -> FloatArray:
            bounds = self.facets.distances(some, tried)[0] + share * self.facets.off[tried]
            return bounds * (most / self.facets.least[tried])

        return self.tree.near(places, farthest)

    def nearest(self, places: FloatArray) -> tuple[Facets, IndexArray, IndexArray, FloatArray]:
        """Leaves, and which of them (P,) have the triangles nearest to places (P, 3) by distance, which (P,) by reduced
        distance, and these reduced distances (P,)."""
        owners, which = self.near(places, 0.0)
        facets = self.facets
        if self.pieces.count > self.count:
            owners, now = self.pieces.leaves_of(owners, facets.pieces[which])
            used, which = np.unique(now, return_inverse=True)
            facets = Facets.of(self.pieces, used)
        distances = facets.distances(places[owners], which)[0]
        reduced = distances / facets.least[which]
        first, least = (first_of_each(owners, each, len(places)) for each in (distances, reduced))
        return facets, which[first], which[least], reduced[least]


def factors_near(
    control: PolygonMesh, variation: Variation, places: FloatArray, tick: Callable[[], None]
) -> FloatArray:
    """(P,): the factors on the tolerance at the surface near places (P, 3), at most, or about; nothing is proved by
    that. tick: called again and again; it may raise to stop."""
    factors = PieceFactors(variation, control, np.zeros(3), 0.0)
    leaves, found = Leaves.of(bezier_pieces(control, len(places) // 4, tick, factors), tick), np.empty(len(places))
    for some in chunks(len(places), AT_ONCE):
        facets, which, *_ = leaves.nearest(places[some])
        found[some] = facets.least[which]
        tick()
    return found


@dataclass(frozen=True)
class Parts(Table):
    """N parts of triangles. corners: (N, 3, 3); owners: (N,) intp, the triangle; bounds: (N,) float64, the proved
    reduced distance; leaves: (N,) intp, the nearest piece; is_waiting: (N,) bool, whether pieces with too large an
    excess lie over the part."""

    corners: FloatArray
    owners: IndexArray
    bounds: FloatArray
    leaves: IndexArray
    is_waiting: BoolArray

    @staticmethod
    def unknown(corners: FloatArray, owners: IndexArray, bounds: FloatArray) -> Parts:
        """Parts with only bounds known."""
        return Parts(corners, owners, bounds, np.zeros_like(owners), np.zeros(len(owners), dtype=bool))

    def quarters(self) -> Parts:
        """The four parts of each part, with the bound of the whole; long parts are cut along their longest side."""
        corners = np.einsum("qij,njd->nqid", QUARTERS, self.corners)
        edges = np.roll(self.corners, -1, axis=1) - self.corners
        squares = squared_norms(edges.reshape(-1, 3)).reshape(-1, 3)
        areas = squared_norms(np.cross(edges[:, 0], edges[:, 1]))
        long = np.flatnonzero(areas < LONG**2 * squares.max(axis=1) ** 2)
        corners[long] = halves(halves(self.corners[long])).reshape(-1, 4, 3, 3)
        return Parts.unknown(corners.reshape(-1, 3, 3), np.repeat(self.owners, 4), np.repeat(self.bounds, 4))


def halves(corners: FloatArray) -> FloatArray:
    """(2n, 3, 3): triangles (n, 3, 3) cut through the middles of their longest sides."""
    squares = squared_norms((np.roll(corners, -1, axis=1) - corners).reshape(-1, 3)).reshape(-1, 3)
    turned = (squares.argmax(axis=1)[:, None] + np.arange(3)) % 3
    first, second, third = np.moveaxis(np.take_along_axis(corners, turned[:, :, None], axis=1), 1, 0)
    middle = (first + second) / 2
    return np.stack([first, middle, third, middle, second, third], axis=1).reshape(-1, 3, 3)


class MeshToSurface:
    """The search from the mesh to the surface. upper: (T,) float64, the proved reduced distance of each triangle;
    face_upper: (F,) float64, of the parts compared with each control face."""

    def __init__(
        self, surface: SurfaceToMesh, mesh: Triangles, face_count: int, whole: float, owners: IndexArray | None = None
    ) -> None:
        """owners: (T,) intp, the face that each triangle's distances are findings of; the nearest face if there are
        none."""
        self.surface, self.findings, self.mesh, self.owners = surface, surface.findings, mesh, owners
        self.whole = whole
        self.upper = np.zeros(self.mesh.count)
        self.face_upper = np.zeros(face_count)

    def settle(self, triangles: IndexArray) -> None:
        """Split triangles, first the given ones, and pieces until proved and reached distances are near each other."""
        self.findings.rounds = 0
        corners = self.mesh.points[:, triangles].swapaxes(0, 1)
        parts = Parts.unknown(corners, triangles, np.full(len(triangles), self.whole))
        leaves = Leaves.of(self.surface.pieces, self.findings.tick)
        while len(parts.owners):
            self.blamed = np.zeros(0, dtype=np.intp)
            if self.surface.pieces.count > GROWN * leaves.count:
                leaves = Leaves.of(self.surface.pieces, self.findings.tick)
            for done, block in enumerate(index_chunks(np.arange(len(parts.owners)), FEW_AT_ONCE)):
                if self.findings.must_end(self.surface.pieces.count + len(parts.owners)):
                    self._record(parts)
                    return
                self._bound(leaves, parts, block)
                self.findings.report_round(1, done * FEW_AT_ONCE / len(parts.owners))
            self._reach(leaves, parts)
            wanted = parts.bounds > self._goals(parts)
            self._record(parts.at(~wanted))
            parts = self._split(parts.at(wanted))
            self.findings.rounds += 1

    def _split(self, parts: Parts) -> Parts:
        """Split the pieces with too large an excess, those that are large beside their parts, and other parts."""
        pieces = self.surface.pieces
        sizes = lengths(np.ptp(parts.corners, axis=1))
        of_leaves = lengths(pieces.high[parts.leaves] - pieces.low[parts.leaves])
        self._split_blamed(EXCESS_SHARE * self._goals(parts).min(initial=np.inf))
        self.surface.split(np.unique(parts.leaves[of_leaves > FINE_SHARE * sizes]))
        fine = (of_leaves <= COARSE_SHARE * sizes) & ~parts.is_waiting
        return parts.at(~fine).joined([parts.at(fine).quarters()])

    def _split_blamed(self, most: float) -> None:
        """Split the pieces over parts that have too large an excess, and their children with an excess beyond most."""
        for _ in range(DEEPER):
            children = self.surface.split(self.blamed)
            self.blamed = children[self.surface.pieces.excess[children] > most * self.surface.pieces.least[children]]

    def _record(self, parts: Parts) -> None:
        np.maximum.at(self.upper, parts.owners, parts.bounds)
        np.maximum.at(self.face_upper, self.surface.pieces.faces[parts.leaves], parts.bounds)

    def _goals(self, parts: Parts) -> FloatArray:
        return self.findings.goals(self._faces(parts))

    def _faces(self, parts: Parts) -> IndexArray:
        """(N,): the face that the distances of each part are findings of."""
        return self.surface.pieces.faces[parts.leaves] if self.owners is None else self.owners[parts.owners]

    def _bound(self, leaves: Leaves, parts: Parts, block: IndexArray) -> None:
        corners = parts.corners[block]
        facets, which, best, reduced = leaves.nearest(corners.mean(axis=1))
        self.findings.tick()
        parts.leaves[block], parts.is_waiting[block] = facets.pieces[which], False
        off = facets.off[best] / facets.least[best]
        np.maximum.at(self.findings.in_faces, self._faces(parts.at(block)), reduced - off)
        self._bound_by_heights(parts, block, self._directions(parts, block))
        place = np.flatnonzero(parts.bounds[block] > self._goals(parts.at(block)))
        left = block[place]
        bounds = self._by_one_piece(facets.at(best[place]), parts.corners[left]) + self.findings.allowance
        parts.bounds[left] = np.minimum(parts.bounds[left], bounds)

    def _reach(self, leaves: Leaves, parts: Parts) -> None:
        """Record distances really there, at corners of the parts with the largest bounds."""
        far = np.argsort(-parts.bounds)[:LOOKED_AT]
        far = far[parts.bounds[far] > self.findings.target]
        if not len(far):
            return
        places, owners = parts.corners[far].reshape(-1, 3), np.repeat(parts.owners[far], 3)
        farthest = np.argsort(-leaves.nearest(places)[-1])[:MEASURED]
        places, owners = places[farthest], owners[farthest]
        pieces = self.surface.pieces
        rows, which = leaves.near(places, 1.0)
        rows, which = pieces.leaves_of(rows, leaves.facets.pieces[which])
        while True:
            facets = Facets.of(pieces, which)
            distances, points = facets.distances(places[rows], np.arange(len(rows)))
            least = np.full(len(places), np.inf)
            np.minimum.at(least, rows, (distances + facets.off) / facets.least)
            reduced = (distances - facets.off) / facets.greatest
            nearby = reduced <= least[rows]
            rows, which, points, reduced = rows[nearby], which[nearby], points[nearby], reduced[nearby]
            facets = facets.at(nearby)
            coarse = facets.off > np.maximum(MEASURED_SHARE * least[rows], self.findings.floor) * facets.least
            coarse |= facets.greatest > (1 + MEASURED_SHARE) * facets.least
            coarse &= least[rows] > self.findings.reached
            self.findings.tick()
            if not coarse.any() or self.findings.is_exhausted(pieces.count):
                break
            self.surface.split(np.unique(which[coarse]))
            children = pieces.children(which[coarse])
            which = np.concatenate([which[~coarse], children.ravel()])
            rows = np.concatenate([rows[~coarse], np.repeat(rows[coarse], 4)])
        first = first_of_each(rows, reduced, len(places))
        found = np.maximum(reduced[first], 0.0)
        faces = pieces.faces[which[first]]
        np.maximum.at(self.findings.in_faces, faces, found)
        self.findings.note(found, places, points[first], faces, owners, surface_to_mesh=False)

    def _directions(self, parts: Parts, block: IndexArray) -> FloatArray:
        """(n, 3): the directions in which to look at parts: the normals of their triangles, or of the nearest pieces
        where these differ."""
        along = self.mesh.normals[parts.owners[block]]
        of_pieces = self.surface.normals(parts.leaves[block])
        is_tilted = of_pieces.any(axis=1) & (np.abs(dot_products(of_pieces, along)) < TILTED)
        return np.where(is_tilted[:, None], of_pieces, along)

    def _bound_by_heights(self, parts: Parts, block: IndexArray, directions: FloatArray) -> None:
        if self.findings.is_late() or not len(block):
            return
        corners = parts.corners[block]
        normals = self.mesh.normals[parts.owners[block]]
        goals = self._goals(parts.at(block)) - self.findings.allowance
        units = self.surface.pieces.units[parts.leaves[block]]
        over = over_pieces(self.surface.pieces, corners, normals, directions, units, goals, self.findings.margin)
        self.findings.tick()
        if over is None:
            for half, along in zip(np.array_split(block, 2), np.array_split(directions, 2), strict=True):
                self._bound_by_heights(parts, half, along)
            return
        found, leaves, waiting, blamed = over
        self.blamed = np.union1d(self.blamed, blamed)
        parts.is_waiting[block[waiting]] = True
        found += self.findings.allowance
        better = np.flatnonzero(found < parts.bounds[block])
        parts.bounds[block[better]] = found[better]
        has_leaf = better[leaves[better] >= 0]
        parts.leaves[block[has_leaf]] = leaves[has_leaf]

    def _by_one_piece(self, facets: Facets, corners: FloatArray) -> FloatArray:
        """(n,): reduced bounds by one piece: the distance to a flat triangle is convex, and so longest at a corner."""
        facet = columns(facets.corners)
        places = columns(corners)
        first = np.max([to_triangles(place, facet[[0, 1, 2]])[0] for place in places], axis=0)
        second = np.max([to_triangles(place, facet[[0, 2, 3]])[0] for place in places], axis=0)
        return (np.minimum(first, second) + facets.off) / facets.least
