# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface over parts of triangles, as hulls of points, with the drawn points there. Hulls and drawn
points are component-major (``vectors``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import lengths, transformed_nets

# The sides of squares and triangles, by the number of drawn points: the corners of each side among the points, and the
# points on the side. Four drawn points have a hull of another order.
SIDES: dict[int, list[tuple[int, int, list[int]]]] = {
    3: [(0, 1, [0, 1]), (1, 2, [1, 2]), (2, 0, [2, 0])],
    4: [(0, 1, [0, 1]), (1, 2, [1, 2]), (2, 3, [2, 3]), (3, 0, [3, 0])],
    16: [(0, 12, [0, 4, 8, 12]), (12, 15, [12, 13, 14, 15]), (15, 3, [15, 11, 7, 3]), (3, 0, [3, 2, 1, 0])],
    28: [(0, 21, [0, 1, 3, 6, 10, 15, 21]), (21, 27, [21, 22, 23, 24, 25, 26, 27]), (27, 0, [27, 20, 14, 9, 5, 2, 0])],
}

# The drawn points at corners, by the number of drawn points: their hull holds all drawn points.
CORNERS_OF = {count: [start for start, _, _ in sides] for count, sides in SIDES.items()}


@dataclass(frozen=True)
class Pieces(Table, hulls=-2, flats=-2):
    """P pieces of the surface. triangles: (P,) intp, of a shell. hulls: (R, P, 3), points whose hull holds the piece.
    flats: (R', P, 3), points of the triangle's plane whose hull holds the drawn points at equal parameters; R' is R
    where both are coefficients of the same order."""

    triangles: IndexArray
    hulls: FloatArray
    flats: FloatArray

    def divided(self, parts: Sequence[FloatArray]) -> Pieces:
        """The parts of pieces, as of ``part``: all first parts, then all second parts, and so on."""
        first, *others = (self.part(rows) for rows in parts)
        return first.joined(others)

    def part(self, rows: FloatArray) -> Pieces:
        """A part of each piece. rows: (R, R), from the coefficients of a piece to the coefficients of the part."""
        return Pieces(self.triangles, *(transformed_nets(rows, each) for each in (self.hulls, self.flats)))


def are_alike(pieces: Pieces) -> bool:
    """Whether the drawn points are coefficients of the same order as the hulls."""
    return len(pieces.hulls) == len(pieces.flats)


def all_points(pieces: Pieces) -> FloatArray:
    """(R + r, P, 3): the points of hulls, and drawn points whose hull holds all of these."""
    flats = pieces.flats[CORNERS_OF.get(len(pieces.flats), slice(None))]
    return np.concatenate([each.swapaxes(1, 2) for each in (pieces.hulls, flats)]).swapaxes(1, 2)


def off_at_equal(pieces: Pieces) -> FloatArray:
    """(P,): bounds of the distance between pieces and drawn points at equal parameters."""
    if are_alike(pieces):
        return lengths(pieces.hulls - pieces.flats).max(axis=0)
    return np.max([lengths(pieces.hulls - each).max(axis=0) for each in pieces.flats], axis=0)
