# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawn quads over convex polygons of the plane: both triangles, and parts of the triangles across their sides.
docs/distance.md, Lemma 11."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import columns, cross_products, dot_products, lengths, products, units
from .triangles import to_quads, to_triangles

# Two triangles over a square, the diagonal along the first axis from the origin; and the least turn at a corner of an
# unfolded pair, in parts of its longest side squared. Less than that rounding might hide.
SQUARE = np.array([[0.0, 0.0], [0.5, -0.5], [1.0, 0.0], [0.5, 0.5]])
LEAST_TURN = 2.0**-20

# The least sine of a triangle's angle, squared, that tells points beside each other across the triangle.
LEAST_AREA = 2.0**-40


@dataclass(frozen=True)
class Charts:
    """The two triangles of K leaves over a convex quad of the plane, linear over both parts. corners: (K, 4, 3), the
    diagonal from corner 0 to 2; places: (K, 4, 2), of these in the plane, the diagonal along the first axis from the
    origin. along: (K, 3), how fast points change along the diagonal; across: (K, 2, 3), how fast away from the diagonal
    on the first triangle and on the second one. is_unfolded: (K,) bool, whether the quad is the unfolded pair.

    flaps: none, or four: beyond the sides from each corner to the next.
    """

    corners: FloatArray
    places: FloatArray
    along: FloatArray
    across: FloatArray
    is_unfolded: BoolArray
    flaps: tuple[Flaps, ...] = ()

    @staticmethod
    def over(quads: FloatArray, is_turned: BoolArray) -> Charts:
        """The triangles of quads (K, 4, 3), with the diagonal from corner 0 to 2, or (K,) bool from corner 1 to 3:
        unfolded into the plane, or over a square where the unfolded pair is not convex."""
        corners = np.where(is_turned[:, None, None], np.roll(quads, -1, axis=1), quads)
        off = corners - corners[:, :1]
        along = units(off[:, 2])
        heights = lengths(cross_products(along[:, None], off)) * [0.0, -1.0, 0.0, 1.0]
        places = np.stack([dot_products(off, along[:, None]), heights], axis=2)
        is_unfolded = turn_left(places).all(axis=1)
        places[~is_unfolded] = SQUARE
        along = off[:, 2] / places[:, 2, :1]
        across = off[:, [1, 3]] - places[:, [1, 3], :1] * along[:, None]
        return Charts(corners, places, along, across / np.abs(places[:, [1, 3], 1:]), is_unfolded)

    def at(self, chosen: IndexArray) -> Charts:
        """Chosen ones, without flaps."""
        corners, places, along = self.corners[chosen], self.places[chosen], self.along[chosen]
        return Charts(corners, places, along, self.across[chosen], self.is_unfolded[chosen])

    def points(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 4, 3): the points of the triangles of leaves (N,) at places (N, 4, 2)."""
        side, off = places[..., :1], places[..., 1:]
        first, second = self.across[leaves].swapaxes(0, 1)
        found: FloatArray = self.corners[leaves, :1] + side * self.along[leaves][:, None]
        found += np.maximum(-off, 0.0) * first[:, None] + np.maximum(off, 0.0) * second[:, None]
        for flaps in self.flaps:
            found += np.maximum(flaps.heights(places, leaves), 0.0)[..., None] * flaps.folds[leaves, None]
        return found

    def bends(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N,): how far bilinear combinations of the points at places (N, 4, 2) are at most from the points at the
        combinations of the places."""
        found = _weights(places[..., 1]) * lengths(self.across.sum(axis=1))[leaves]
        for flaps in self.flaps:
            found += _weights(flaps.heights(places, leaves)) * lengths(flaps.folds)[leaves]
        return found

    def nearest(self, points: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 2): about the places of the triangles' points nearest to points (N, 3); in any case places of the
        quad."""
        corners, points = columns(self.corners[leaves]), columns(points)
        distances, nearest, is_first = to_quads(points, corners)
        off = nearest - corners[0]
        side, diagonal = np.where(is_first, corners[1], corners[3]) - corners[0], corners[2] - corners[0]
        a, b, c = products(side, side), products(side, diagonal), products(diagonal, diagonal)
        p, q = products(side, off), products(diagonal, off)
        scale = a * c - b * b
        # Without area, the points along the longer side.
        is_flat = scale <= LEAST_AREA * a * c
        shares = np.where(is_flat, np.stack([p * (a > c), q * (a <= c)]), np.stack([c * p - b * q, a * q - b * p]))
        scale = np.where(is_flat, np.maximum(a, c), scale)
        shares = np.divide(shares, scale, out=np.zeros_like(shares), where=scale > 0)
        shares = np.clip(shares, 0.0, 1.0)
        shares /= np.maximum(shares.sum(axis=0), 1.0)
        of_side = np.where(is_first[:, None], self.places[leaves, 1], self.places[leaves, 3])
        found: FloatArray = shares[0][:, None] * of_side + shares[1][:, None] * self.places[leaves, 2]
        for flaps in self.flaps:
            own, places = flaps.nearer(points, leaves, distances)
            found[own] = places
        return found


@dataclass(frozen=True)
class Flaps:
    """Parts of the triangles across one side of each of K leaves, unfolded beyond this side of the chart. is_there:
    (K,) bool. starts, towards: (K, 2), the place where the side starts, and the direction of the side. corners: (K, 3,
    3), the start and the end of the side, and the tip. folds: (K, 3), the jump of the derivative across the side, zero
    without a flap."""

    is_there: BoolArray
    starts: FloatArray
    towards: FloatArray
    corners: FloatArray
    folds: FloatArray

    def heights(self, places: FloatArray, leaves: IndexArray) -> FloatArray:
        """(N, 4): how far beyond the side of leaves (N,) places (N, 4, 2) are."""
        off, towards = places - self.starts[leaves, None], self.towards[leaves, None]
        found: FloatArray = off[..., 0] * towards[..., 1] - off[..., 1] * towards[..., 0]
        return found

    def nearer(self, points: FloatArray, leaves: IndexArray, distances: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Those of points (3, N) that are nearer to the flaps than distances (N,), which are lowered, and about the
        places (n, 2) of their nearest points there."""
        own = np.flatnonzero(self.is_there[leaves])
        found, nearest = to_triangles(points[:, own], columns(self.corners[leaves[own]]))
        is_nearer = found < distances[own]
        own, off = own[is_nearer], nearest.T[is_nearer]
        distances[own] = found[is_nearer]
        start, end, _ = self.corners[leaves[own]].swapaxes(0, 1)
        along, off = units(end - start), off - start
        share = dot_products(off, along)[:, None]
        beyond, towards = lengths(off - share * along)[:, None], self.towards[leaves[own]]
        return own, self.starts[leaves[own]] + share * towards + beyond * outwards(towards)


def outwards(towards: FloatArray) -> FloatArray:
    """(…, 2): the directions away from a chart, across sides with directions (…, 2)."""
    return towards[..., ::-1] * [1.0, -1.0]


def turn_left(corners: FloatArray) -> BoolArray:
    """(K, m) bool: whether the border of polygons with corners (K, m, 2) turns left at the corner after each, by more
    than rounding might hide."""
    sides = np.roll(corners, -1, axis=1) - corners
    following = np.roll(sides, -1, axis=1)
    turns = sides[..., 0] * following[..., 1] - sides[..., 1] * following[..., 0]
    found: BoolArray = turns > LEAST_TURN * (sides * sides).sum(axis=2).max(axis=1)[:, None]
    return found


def _weights(heights: FloatArray) -> FloatArray:
    """(N,): PN / (P + N), with P and N the greatest of heights (N, 4) on either side, at least 0."""
    over, under = (np.maximum(each * heights, 0.0).max(axis=1) for each in (-1, 1))
    found: FloatArray = np.divide(over * under, over + under, out=np.zeros_like(over), where=over * under > 0)
    return found
