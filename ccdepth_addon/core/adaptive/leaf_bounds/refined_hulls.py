# SPDX-License-Identifier: GPL-3.0-or-later
"""Hull points (``leaf_distance.Hull``) of faces of any kind, by refinement, as in ``irregular_bounds``.

A bicubic descendant is in the hull of its 16 Bernstein coefficients; any other is near the bilinear facet over its
control points, and is refined again while that counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...arrays.ranks import ranks_among_equal
from ...arrays.types import FloatArray, IndexArray
from ..quadtree import NONE
from .descent import Descent, Squares
from .irregular_bounds import NEAR_FACET
from .leaf_distance import Hull

# The coefficients along the sides of a bicubic piece, from corner to corner.
ALONG_SIDES = np.array([[0, 4, 8, 12], [12, 13, 14, 15], [15, 11, 7, 3], [3, 2, 1, 0]])

# After so many the rest around an irregular vertex is small against a leaf.
REFINEMENTS = 13

# The leaves of pieces, and for each of the sides of a square which half side of the leaf it is part of, two a side, or
# NONE inside.
HalfSides = Callable[[Squares], tuple[IndexArray, IndexArray]]


def hull_of_quads(descent: Descent, chosen: IndexArray, corners: FloatArray, limit: float) -> Hull:
    """Of P chosen quads, the bases of a descent; corners: (4 or more, P, 3), the first four on the surface.

    limit: the distance that a bound is going to be compared with.
    """

    def half_sides(squares: Squares) -> tuple[IndexArray, IndexArray]:
        starts, ends, sides = _border_sides(squares)
        # Along sides 0 and 1 parameters rise, along 2 and 3 they fall.
        along = (starts + ends)[np.arange(4)[:, None], np.arange(sides.shape[1]), sides % 2] / 2
        second = (along > 0.5) == (sides < 2)
        return np.searchsorted(chosen, squares.bases), np.where(sides == NONE, NONE, 2 * sides + second)

    return _hull(descent, chosen, half_sides, corners[:4], limit)


def hull_of_fans(descent: Descent, chosen: IndexArray, corners: FloatArray, limit: float) -> Hull:
    """Of P chosen faces of n corners, n quarters of each being bases of a descent; corners: (n, P, 3) on the
    surface."""
    size = len(corners)

    def half_sides(squares: Squares) -> tuple[IndexArray, IndexArray]:
        _, _, sides = _border_sides(squares)
        corner = squares.bases % size
        first, last = 2 * corner, 2 * ((corner - 1) % size) + 1
        leaves = np.searchsorted(chosen, squares.bases // size)
        return leaves, np.where(sides == 0, first, np.where(sides == 3, last, NONE))

    return _hull(descent, chosen, half_sides, corners, limit)


def _border_sides(squares: Squares) -> tuple[FloatArray, FloatArray, IndexArray]:
    """(4, N, 2) twice, from where to where the sides of squares go; and (4, N) the side of the whole that they are part
    of, or NONE. All parameters are dyadic fractions, and exact."""
    starts = squares.corners()
    ends = np.roll(starts, -1, axis=0)
    found = np.full(starts.shape[:2], NONE)
    for side, (axis, value) in enumerate([(1, 0.0), (0, 1.0), (1, 1.0), (0, 0.0)]):
        found[(starts[..., axis] == value) & (ends[..., axis] == value)] = side
    return starts, ends, found


@dataclass(frozen=True)
class _Pieces:
    """N pieces: their leaves (N,), points (16, N, 3) whose hulls hold them, and for each of their four sides the half
    side along it (4, N) and points (4, 8, N, 3) whose hull holds the curve there."""

    leaves: IndexArray
    points: FloatArray
    half_sides: IndexArray
    curves: FloatArray

    @staticmethod
    def bicubic(leaves: IndexArray, half_sides: IndexArray, coefficients: FloatArray) -> _Pieces:
        """With Bernstein coefficients (16, N, 3)."""
        curves = coefficients[ALONG_SIDES]
        return _Pieces(leaves, coefficients, half_sides, np.concatenate([curves, curves], axis=1))

    @staticmethod
    def near_facets(leaves: IndexArray, half_sides: IndexArray, facets: FloatArray, near: FloatArray) -> _Pieces:
        """Within some distance (N,) of bilinear facets with corners (4, N, 3): in boxes around these."""
        boxes = _boxes(facets, near)
        sides = np.stack([_boxes(facets[[side, (side + 1) % 4]], near) for side in range(4)])
        return _Pieces(leaves, np.concatenate([boxes, boxes]), half_sides, sides)


def _boxes(points: FloatArray, near: FloatArray) -> FloatArray:
    """(8, N, 3): the corners of boxes that hold everything within some distance (N,) of hulls of points (R, N, 3)."""
    ends = np.stack([points.min(axis=0) - near[:, None], points.max(axis=0) + near[:, None]])
    corners = np.indices((2, 2, 2)).reshape(3, 8)
    return np.stack([ends[end, :, axis] for axis, end in enumerate(corners)], axis=-1)


def _hull(descent: Descent, chosen: IndexArray, half_sides: HalfSides, corners: FloatArray, limit: float) -> Hull:
    found: list[_Pieces] = []
    wanted = descent.start(chosen)
    for level in range(REFINEMENTS):
        own = descent.pieces(level, wanted)
        exact = own.at(np.flatnonzero(own.near == 0))
        found.append(_Pieces.bicubic(*half_sides(exact.squares), exact.coefficients))
        settled = (own.near <= NEAR_FACET * limit) | (level == REFINEMENTS - 1)
        last = own.at(np.flatnonzero(settled & (own.near > 0)))
        found.append(_Pieces.near_facets(*half_sides(last.squares), last.facets(), last.near))
        if np.all(settled):
            break
        wanted = descent.children(level, wanted[~settled])
    pieces = _Pieces(
        np.concatenate([part.leaves for part in found]),
        np.concatenate([part.points for part in found], axis=1),
        np.concatenate([part.half_sides for part in found], axis=1),
        np.concatenate([part.curves for part in found], axis=2),
    )
    return _padded(pieces, corners)


def _padded(pieces: _Pieces, corners: FloatArray) -> Hull:
    """With as many rows for each leaf as for the one with most pieces; corners fill what is left."""
    size, count = corners.shape[:2]
    place = ranks_among_equal(pieces.leaves)
    most = int(place.max(initial=-1)) + 1
    points = np.empty((most, 16, count, 3))
    points[:] = corners[0]
    points[place, :, pieces.leaves] = pieces.points.swapaxes(0, 1)
    rows = [points.reshape(-1, count, 3)]
    sides: list[list[IndexArray]] = [[] for _ in range(size)]
    first = 16 * most
    for half_side in range(2 * size):
        own, along = np.nonzero(np.equal(pieces.half_sides.T, half_side))
        leaves = pieces.leaves[own]
        place = ranks_among_equal(leaves)
        longest = int(place.max(initial=-1)) + 1
        of_side = np.empty((longest, 8, count, 3))
        of_side[:] = corners[half_side // 2] if half_side % 2 == 0 else corners[(half_side // 2 + 1) % size]
        of_side[place, :, leaves] = pieces.curves[along, :, own]
        rows.append(of_side.reshape(-1, count, 3))
        sides[half_side // 2].append(np.arange(first, first + 8 * longest))
        first += 8 * longest
    parts = np.arange(16 * most).reshape(-1, 16)
    return Hull(np.concatenate(rows), parts, sides, np.zeros(first, dtype=bool), np.zeros((0, count, 3)))
