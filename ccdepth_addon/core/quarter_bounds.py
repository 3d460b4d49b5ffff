# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the quarters of bicubic quads are off, each drawn by two triangles: from the coefficients of the whole quads.

Most leaves of a tree fit at a first look. Taken at their parents it needs no coefficients of their own. The bounds are
those of ``triangle_bounds.quadratic_rows``, but that the monomials are the whole quad's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .coordinates import applied, chosen_vectors
from .mesh import FloatArray
from .norms import squared_norms
from .products import product
from .templates import PLAIN, Template
from .triangle_bounds import WHOLE_QUAD, bicubic_basis, off_quadratic, regular_points, to_monomials

BoolArray = NDArray[np.bool_]

# The points of a quad, its centre the last, at the corners of the quarter at each of its own, from that one on.
CORNERS_OF_QUARTERS = [[corner, 4 + corner, 8, 4 + (corner + 3) % 4] for corner in range(4)]


@dataclass(frozen=True)
class QuarterDistances:
    """‖S - T‖ over the quarters of P quads, those at each corner, for each of the two diagonals, (4, 2, P) each.

    sampled: at the middles of the triangles' sides, so really there. bounds: at most. sides: (4, 4, P, 3), diagonals:
    (4, 2, P, 3), S - T at the middles of each quarter's sides and diagonals. points: (9, P, 3), those of the whole
    quads (``regular_points``).
    """

    sampled: FloatArray
    bounds: FloatArray
    sides: FloatArray
    diagonals: FloatArray
    points: FloatArray

    def corners_of(self, chosen: BoolArray) -> FloatArray:
        """(4, n, 3): the corners of chosen quarters, (4, P) bool, those at corner 0 first."""
        own = zip(CORNERS_OF_QUARTERS, chosen, strict=True)
        return np.concatenate([chosen_vectors(self.points[four], np.flatnonzero(some)) for four, some in own], axis=1)

    def off_of(self, chosen: BoolArray) -> FloatArray:
        """(6, n, 3): S - T at the middles of their sides and diagonals."""
        places = [np.flatnonzero(some) for some in chosen]
        parts = (
            [chosen_vectors(vectors, some) for vectors, some in zip(quarters, places, strict=True)]
            for quarters in (self.sides, self.diagonals)
        )
        return np.concatenate([np.concatenate(part, axis=1) for part in parts])


def quarter_distances(coefficients: FloatArray) -> QuarterDistances:
    """Of quads with Bernstein coefficients (16, P, 3), [i, j] → 4i + j, u along i."""
    vectors = applied(_rows(), coefficients)
    squares = squared_norms(vectors[:50])
    sampled = np.maximum(squares[:16].reshape(4, 4, -1).max(axis=1)[:, None], squares[16:24].reshape(4, 2, -1))
    quadratic = np.maximum(sampled, squares[24:40].reshape(4, 2, 2, -1).max(axis=2))
    rests = product(_weights(), np.sqrt(squares[40:])).reshape(sampled.shape)
    sides, diagonals = vectors[:16].reshape(4, 4, -1, 3), vectors[16:24].reshape(4, 2, -1, 3)
    return QuarterDistances(np.sqrt(sampled), np.sqrt(quadratic) + rests, sides, diagonals, vectors[50:])


@cache
def _rows() -> FloatArray:
    """(59, 16): for each quarter S - T at the middles of its 4 sides; then for each at the middles of the 2 diagonals;
    then for each, diagonal by diagonal, half the sums of the three at the sides of the 2 triangles; then the 10
    monomials that are more than quadratic, T having none; then the 9 points."""
    corners = [_places(corner) for corner in range(4)]
    sides = np.stack([[_off_chord(four[side], four[(side + 1) % 4]) for side in range(4)] for four in corners])
    diagonals = np.stack([[_off_chord(four[0], four[2]), _off_chord(four[1], four[3])] for four in corners])
    sums = np.empty((4, 2, 2, 16))
    for number, template in enumerate(PLAIN):
        for place, own in enumerate(_sides(template)):
            sums[:, number, place] = (sides[:, own].sum(axis=1) + diagonals[:, number]) / 2
    rows = (sides, diagonals, sums, to_monomials(), regular_points())
    return np.concatenate([part.reshape(-1, 16) for part in rows])


@cache
def _weights() -> FloatArray:
    """(8, 10): for each quarter and each diagonal, how far the monomials are off their quadratic parts there."""
    templates = [[_places(corner)[list(triangle)] for triangle in plain] for corner in range(4) for plain in PLAIN]
    return np.stack([off_quadratic(triangles) for triangles in templates])


def _places(corner: int) -> FloatArray:
    """(4, 2): the corners of the quarter at a corner, from that one on."""
    return WHOLE_QUAD.child(corner).corners()


def _sides(template: Template) -> list[list[int]]:
    """The sides of a quad that are sides of each triangle."""
    return [[side for side in range(4) if {side, (side + 1) % 4} <= {*triangle}] for triangle in template]


def _off_chord(start: FloatArray, end: FloatArray) -> FloatArray:
    """(16,): S half-way between two places, off the middle of the chord."""
    ends, middle = np.stack([start, end]), (start + end) / 2
    return bicubic_basis(middle[None])[0] - bicubic_basis(ends).mean(axis=0)
