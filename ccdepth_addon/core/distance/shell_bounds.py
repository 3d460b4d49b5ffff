# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest distances of the surface from the triangles of a shell, in the shell: piece by piece, by convex hulls.

A piece is a part of the surface over a part of one triangle. Every point of it has a place in the shell, over the
triangle or one that shares a side with it, or near a corner over one that shares the corner; its distance along the
shell's vectors is at most the height over that triangle's plane by a cosine. docs/distance.md, Lemmas 5 to 8; letters
are those used there.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray
from .beside_bounds import RANGE_FOR_HEIGHT, bounds_beside
from .corner_bounds import bounds_around, bounds_near_corner
from .framed_pieces import ON_VECTOR, ROUNDING, FramedPieces
from .piece_hulls import Pieces
from .shells import Shell
from .side_bounds import raised_at_sides


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def shell_bounds(shell: Shell, pieces: Pieces, off_beyond: FloatArray | None = None) -> FloatArray:
    """(P,): at least how far all points of each piece are from the points of the triangles at their places, and those
    of its curves over closed sides from points of these sides; infinite where no place within the shell is proved.

    off_beyond: (M, 3), how far the surface is at most from what is drawn beyond sides where it is compared at equal
    parameters, infinite at other sides; ways to what is compared there count as well (docs/distance.md, Lemma 10).
    """
    own = pieces.triangles
    seen = FramedPieces.of(shell, pieces)
    # A thin shell has the least margins, if it is thick enough.
    thin = np.minimum(RANGE_FOR_HEIGHT * seen.heights / shell.cosines[own], shell.ranges[own])
    bounds = bounds_beside(shell, seen, thin)
    rest = np.flatnonzero(np.isinf(bounds))
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = bounds_beside(shell, FramedPieces.of(shell, some), shell.ranges[some.triangles])
        rest = rest[np.isinf(bounds[rest])]
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = np.minimum.reduce([bounds_near_corner(shell, some, corner) for corner in range(3)])
        rest = rest[np.isinf(bounds[rest])]
    if len(rest):
        bounds[rest] = bounds_around(shell, pieces.at(rest))
    bounds = np.where(shell.ranges[own] > 0, bounds, np.inf)
    bounds = raised_at_sides(shell, pieces, bounds, off_beyond)
    return bounds * (1 + ROUNDING) + 2 * ON_VECTOR * seen.sizes
