# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of the distance between the surface and the triangles of a shell, piece by piece, by convex hulls.

A piece is a part of the surface over a part of one triangle. Every point of a piece has a place in the shell: over the
triangle or a triangle across a side, or near a corner over a triangle that shares the corner. The distance along the
shell's vectors is at most the height over the plane of the place's triangle, divided by a cosine. docs/distance.md,
Lemmas 5 to 8, has the notation.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray
from .beside_bounds import RANGE_FOR_HEIGHT, bounds_beside
from .corner_bounds import bounds_around, bounds_near_corner
from .framed_pieces import ON_VECTOR, ROUNDING, FramedPieces
from .piece_hulls import Pieces
from .shells import Shell
from .side_bounds import Beside, raised_at_sides


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def shell_bounds(shell: Shell, pieces: Pieces, beside: Beside | None = None) -> FloatArray:
    """(P,): bounds of the distance between the points of each piece and their places on the triangles, and between its
    curves over closed sides and these sides; infinite where no place within the shell is proved.

    beside: the sides with another comparison beyond; bounds include the strips there (docs/distance.md, Lemma 10).
    """
    own = pieces.triangles
    seen = FramedPieces.of(shell, pieces)
    # A thin shell has the smallest margins, if the piece fits.
    thin = np.minimum(RANGE_FOR_HEIGHT * seen.heights / shell.cosines[own], shell.ranges[own])
    bounds = bounds_beside(shell, seen, thin)
    rest = np.flatnonzero(np.isinf(bounds) & (thin < shell.ranges[own]))
    if len(rest):
        bounds[rest] = bounds_beside(shell, seen.at(rest), shell.ranges[own[rest]])
    rest = np.flatnonzero(np.isinf(bounds))
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = np.minimum.reduce([bounds_near_corner(shell, some, corner) for corner in range(3)])
        rest = rest[np.isinf(bounds[rest])]
    if len(rest):
        bounds[rest] = bounds_around(shell, pieces.at(rest))
    bounds = np.where(shell.ranges[own] > 0, bounds, np.inf)
    bounds = raised_at_sides(shell, pieces, bounds, beside)
    return bounds * (1 + ROUNDING) + 2 * ON_VECTOR * seen.sizes
