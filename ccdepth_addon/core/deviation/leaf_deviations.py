# SPDX-License-Identifier: GPL-3.0-or-later
"""The distances of a level's leaves, both ways: from the surface over each leaf to the triangles around, and from its
triangles to the surface around.

Distances to a part of the triangles or the surface are no less than to the whole. docs/deviation.md, Leaves of a level.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from time import perf_counter

import numpy as np

from ..arrays.ranges import ranges
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import columns, dot_products, units
from ..bounds.norm_bounds import Vertices
from ..mesh.level_quads import QUAD_TRIANGLES, may_be_folded
from ..progress import no_report
from ..surface.refinement import Refinement
from .bezier_pieces import BezierPieces
from .findings import Findings
from .leaf_maps import mapped_bounds
from .leaf_samples import ON_GRID, seen_from
from .measure import MARGIN
from .mesh_to_surface import Facets, Leaves, MeshToSurface
from .surface_to_mesh import SurfaceToMesh, nearest_triangles
from .triangles import Triangles, to_quads

# The largest number of pieces and parts for each leaf, and these besides: undecided leaves are then near the limit, and
# one more level takes no longer.
PIECES_OF_EACH, PIECES_BESIDES = 96, 1 << 12

# Rounds after which nothing more is decided, mostly.
MOST_ROUNDS = 20

# (9, 16): points of the surface that are tried, from the coefficients of a piece.
SAMPLED = ON_GRID[[0, 2, 4, 10, 12, 14, 20, 22, 24]]

# The sides of a quad as triangles without area.
SIDES = np.array([[0, 1, 1], [1, 2, 2], [2, 3, 3], [3, 0, 0]])


@dataclass
class LeafFindings(Findings):
    """The findings for leaves: whether each is within the limit. groups: (K,) intp, of each leaf. A leaf beyond the
    limit ends the search for all of its group."""

    groups: IndexArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    @property
    def target(self) -> float:
        """The limit: no reached distance is sought."""
        return np.inf

    def goals(self, faces: IndexArray) -> FloatArray:
        """(N,): the limit, or no bound for leaves beyond the limit or undecided after many rounds."""
        reached = _largest(self.groups, self.in_faces)[faces]
        return np.where((reached > self.limit) | (self.rounds >= MOST_ROUNDS), np.inf, self.limit)


@dataclass(frozen=True)
class DrawnLeaves:
    """K drawn quads of a level, the descendants of a refinement. points: (K, 4, 3), their corners. is_turned: (K,)
    bool, whether the drawn diagonal is from corner 1 to 3; is_folded: (K,) bool, whether the other diagonal may be
    drawn."""

    refinement: Refinement
    points: FloatArray
    is_turned: BoolArray
    is_folded: BoolArray

    @property
    def are_quads(self) -> bool:
        """Whether all leaves, and all faces around them, are quads."""
        return bool(np.all(self.refinement.mesh.face_sizes == 4))

    @cached_property
    def pieces(self) -> BezierPieces:
        """The surface over the leaves: if ``are_quads``, a piece of each comes first, in their order."""
        return self._unsplit_pieces()

    def _unsplit_pieces(self) -> BezierPieces:
        units, owners = self.refinement, np.arange(len(self.points))
        if not self.are_quads:
            units, owners = units.refined(), np.repeat(owners, 4)
        return BezierPieces(units, owners, lambda: None)

    def _pieces_of(self, chosen: IndexArray) -> tuple[IndexArray, IndexArray]:
        """(N,) intp twice: the rows of chosen leaves (n,), and the pieces, not split, over each."""
        which = self.pieces.leaves()
        which = which[np.argsort(self.pieces.faces[which], kind="stable")]
        first, end = (np.searchsorted(self.pieces.faces[which], chosen, side) for side in ("left", "right"))
        return np.repeat(np.arange(len(chosen)), end - first), which[ranges(first, end - first)]

    @staticmethod
    def of(refinement: Refinement, is_turned: BoolArray, vertices: Vertices, axes: FloatArray | None) -> DrawnLeaves:
        """The drawn leaves of a refinement. axes: of the space in which diagonals are chosen, as of ``PolygonMesh``."""
        points = vertices.at_corners(refinement).reshape(-1, 4, 3)
        return DrawnLeaves(refinement, points, is_turned, may_be_folded(points, is_turned, axes))

    def keep(self, wanted: BoolArray) -> DrawnLeaves:
        """Keep the wanted leaves alone: (K,) bool."""
        refinement = self.refinement.keep(wanted)
        return DrawnLeaves(refinement, self.points[wanted], self.is_turned[wanted], self.is_folded[wanted])

    def at_equal_parameters(self, rounded: float) -> FloatArray:
        """(K,): bounds of the distance between surface and triangles of each leaf at equal parameters, with either
        diagonal. rounded: the rounding allowance."""
        count = len(self.points)
        if not self.are_quads:
            return np.full(count, np.inf)
        off = self.refinement.limits_at_corners.reshape(-1, 4, 3) - self.points
        found: FloatArray = Facets.of(self.pieces, np.arange(count)).off + np.sqrt((off * off).sum(axis=2).max(axis=1))
        return found + rounded

    def mapped(self, limit: float, rounded: float) -> FloatArray:
        """(K,): bounds of the distance between surface and triangles of each leaf, both ways, by a map; infinite
        without a bound within the limit. rounded: the rounding allowance."""
        if not self.are_quads:
            return np.full(len(self.points), np.inf)
        found = mapped_bounds(self._unsplit_pieces(), self.points, self.is_turned, limit - rounded)
        if np.any(either := self.is_folded & (found <= limit - rounded)):
            # Either diagonal may be drawn.
            some = self.keep(either)
            others = mapped_bounds(some._unsplit_pieces(), some.points, ~some.is_turned, limit - rounded)
            found[either] = np.maximum(found[either], others)
        return found + rounded

    def surface_beyond(self, chosen: IndexArray, drawn: DrawnLeaves, limit: float) -> tuple[IndexArray, FloatArray]:
        """Those of chosen leaves (n,) with a point of the surface that seems farther than the limit from the triangles
        of ``drawn``, by the point of a piece that is farthest from the leaf's own, and these distances; leaves may be
        repeated. Nothing is proved by that."""
        rows, which = self._pieces_of(chosen)
        points, excess = np.matmul(self.pieces.coefficients[which], SAMPLED.T), self.pieces.excess[which]
        corners = columns(np.repeat(self._quads(chosen)[rows], len(SAMPLED), axis=0))
        places = columns(points.swapaxes(1, 2).reshape(-1, 3))
        off = to_quads(places, corners)[0].reshape(-1, len(SAMPLED))
        far = np.flatnonzero(off.max(axis=1) - excess > limit)
        farthest = points[far, :, off[far].argmax(axis=1)]
        found = nearest_triangles(drawn._around(), farthest).distances if len(far) else excess[far]
        found = found - excess[far]
        return chosen[rows[far[found > limit]]], found[found > limit]

    def drawn_beyond(self, chosen: IndexArray, limit: float) -> IndexArray:
        """Those of chosen leaves (n,) with a corner, or a middle of a side or of the diagonal, that seems farther than
        the limit from the surface over all leaves, by the point farthest from the leaf's own. Nothing is proved by
        that."""
        quads = self._quads(chosen)
        points = np.concatenate([quads, (quads[:, [0, 1, 2, 3, 0]] + quads[:, [1, 2, 3, 0, 2]]) / 2], axis=1)
        rows, which = self._pieces_of(chosen)
        rows, which = (rows[:, None] * 9 + np.arange(9)).ravel(), np.repeat(which, 9)
        off = seen_from(points.reshape(-1, 3), rows, which, self.pieces).reshape(-1, 9)
        far = np.flatnonzero(off.max(axis=1) > limit)
        if not len(far):
            return chosen[:0]
        farthest = points[far, off[far].argmax(axis=1)]
        rows, which = Leaves.of(self.pieces, lambda: None).near(farthest, 1.0)
        return chosen[far[seen_from(farthest, rows, self.pieces.leaves()[which], self.pieces) > limit]]

    def _quads(self, chosen: IndexArray) -> FloatArray:
        """(n, 4, 3): the corners of chosen leaves (n,), the diagonal from corner 0 to 2."""
        points = self.points[chosen]
        return np.where(self.is_turned[chosen, None, None], np.roll(points, -1, axis=1), points)

    def deviations(
        self, on_surface: BoolArray, drawn: BoolArray, groups: IndexArray, limit: float, rounded: float
    ) -> FloatArray:
        """(K,): bounds of the distance from the surface over chosen leaves (K,) bool to the triangles of all leaves,
        and from the triangles of chosen leaves (K,) bool, with both diagonals where either may be drawn, to the surface
        over all; infinite without a bound within the limit. groups: (K,) intp below K, of each leaf: a group with one
        leaf beyond the limit may be infinite as a whole. rounded: the rounding allowance."""
        count = len(self.points)
        size = float(np.abs(self.refinement.mesh.positions).max(initial=0.0))
        findings = LeafFindings(
            accuracy=0.0,
            limit=limit,
            floor=0.0,
            enough=limit,
            allowance=rounded,
            margin=MARGIN * size,
            max_pieces=PIECES_OF_EACH * count + PIECES_BESIDES,
            began=perf_counter(),
            time_limit=np.inf,
            report=no_report,
            in_faces=np.zeros(count),
            groups=groups,
        )
        pieces = self._unsplit_pieces()
        surface = SurfaceToMesh(pieces, self._around(), findings, np.inf)
        surface.settle(_over(pieces, on_surface))
        found = np.zeros(count)
        leaves = _over(pieces, on_surface)
        np.maximum.at(found, pieces.faces[leaves], surface.upper[leaves])
        thin = self.along_segments(pieces) + rounded
        is_near = drawn & (thin <= limit)
        found[is_near] = np.maximum(found, thin)[is_near]
        chosen = np.flatnonzero(drawn & ~is_near & (_largest(groups, found) <= limit))
        if len(chosen):
            mesh, owners = self._of(chosen)
            other_way = MeshToSurface(surface, mesh, count, np.inf, owners)
            other_way.settle(np.arange(mesh.count))
            np.maximum.at(found, owners, other_way.upper)
        return np.where(found <= limit, found, np.inf)

    def along_segments(self, pieces: BezierPieces) -> FloatArray:
        """(K,): bounds of the distance from the triangles of each leaf, along either diagonal, to the surface over the
        leaf, from its pieces: near where both are as thin as a segment. docs/deviation.md, Leaves without area."""
        every = np.arange(len(self.points))
        apart = self.points[:, None] - self.points[:, :, None]
        ends = np.stack(np.divmod((apart * apart).sum(axis=3).reshape(-1, 16).argmax(axis=1), 4))
        start, along = self.points[every, ends[0]], units(apart[every, ends[0], ends[1]])

        def aside(places: FloatArray, leaves: IndexArray) -> FloatArray:
            off = places - start[leaves, None]
            off -= dot_products(off, along[leaves, None])[..., None] * along[leaves, None]
            found: FloatArray = np.sqrt((off * off).sum(axis=2).max(axis=1))
            return found

        gaps = (self.refinement.limits_at_corners.reshape(-1, 4, 3) - self.points)[every, ends]
        found = np.sqrt((gaps * gaps).sum(axis=2).max(axis=0))
        parts = pieces.leaves()
        owners = pieces.faces[parts]
        np.maximum.at(found, owners, aside(pieces.coefficients[parts].swapaxes(1, 2), owners) + pieces.excess[parts])
        return found + aside(self.points, every)

    def _around(self) -> Triangles:
        """The triangles certainly drawn: triangles of the leaves, and sides of leaves that may be folded."""
        known, folded = np.flatnonzero(~self.is_folded), np.flatnonzero(self.is_folded)
        quads = self.refinement.corner_vertices().reshape(-1, 4)
        triangles = np.take_along_axis(
            quads[known][:, None], QUAD_TRIANGLES[self.is_turned[known].astype(np.intp)], axis=2
        )
        corners = np.concatenate([triangles.reshape(-1, 3), quads[folded][:, SIDES].reshape(-1, 3)])
        return Triangles.of(self._positions(), corners)

    def _of(self, chosen: IndexArray) -> tuple[Triangles, IndexArray]:
        """The triangles of chosen leaves, along both diagonals of leaves that may be folded, and the leaf of each."""
        folded = chosen[self.is_folded[chosen]]
        leaves = np.concatenate([chosen, folded])
        is_turned = np.concatenate([self.is_turned[chosen], ~self.is_turned[folded]]).astype(np.intp)
        quads = self.refinement.corner_vertices().reshape(-1, 4)[leaves]
        corners = np.take_along_axis(quads[:, None], QUAD_TRIANGLES[is_turned], axis=2).reshape(-1, 3)
        return Triangles.of(self._positions(), corners), np.repeat(leaves, 2)

    def _positions(self) -> FloatArray:
        """(V, 3): the drawn positions of the refinement's vertices."""
        found = np.zeros_like(self.refinement.mesh.positions)
        found[self.refinement.corner_vertices()] = self.points.reshape(-1, 3)
        return found


def _largest(groups: IndexArray, values: FloatArray) -> FloatArray:
    """(K,): the largest of the values (K,) in the group of each."""
    found = np.zeros(len(values))
    np.maximum.at(found, groups, values)
    return found[groups]


def _over(pieces: BezierPieces, chosen: BoolArray) -> IndexArray:
    """The pieces, not split, over chosen leaves."""
    found = pieces.leaves()
    return found[chosen[pieces.faces[found]]]
