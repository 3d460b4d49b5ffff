# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of the children of bicubic quads, each approximated by two triangles: from the coefficients of the parents.

They settle most leaves of a tree, which then need no coefficients of their own. The bounds are those of
``triangle_bounds.quadratic_rows``, but with the monomials of the whole quad.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...arrays.matrix_products import matrix_product
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, squared_norms, transformed_nets
from ...surface.squares import WHOLE_QUAD
from ...surface.triangle_coefficients import bicubic_basis
from ..templates import PLAIN, Triangle
from .triangle_bounds import (
    BICUBIC_POINTS,
    off_quadratic,
    to_monomials,
)

# The points of a quad, its centre the last, that are the corners of the child at each of its own, from that one on.
CORNERS_OF_CHILDREN = [[corner, 4 + corner, 8, 4 + (corner + 3) % 4] for corner in range(4)]


@dataclass(frozen=True)
class ChildDistances:
    """‖S - T‖ over the children of P quads, those at each corner, for each of the two diagonals, (4, 2, P) each.

    sampled: at the middles of the triangles' sides, so lower bounds. bounds: upper bounds. points: (9, P, 3), those of
    the quads (``BICUBIC_POINTS``). far: the children whose samples exceed the limit along both diagonals.
    """

    sampled: FloatArray
    bounds: FloatArray
    points: FloatArray
    far: ChildSamples


@dataclass(frozen=True)
class ChildSamples:
    """n children of quads, and S - T over them.

    at_corners, of_quads: (n,), the corner and the quad of each. corners: (4, n, 3), their own. off: (6, n, 3), S - T at
    the middles of their sides and diagonals.
    """

    at_corners: IndexArray
    of_quads: IndexArray
    corners: FloatArray
    off: FloatArray


def child_distances(coefficients: FloatArray, limit: float) -> ChildDistances:
    """Of quads with Bernstein coefficients (16, P, 3), [i, j] → 4i + j, u along i."""
    vectors = transformed_nets(_rows(), coefficients)
    squares = squared_norms(vectors[:50])
    largest = np.maximum(squares[:16].reshape(4, 4, -1).max(axis=1)[:, None], squares[16:24].reshape(4, 2, -1))
    quadratic = np.maximum(largest, squares[24:40].reshape(4, 2, 2, -1).max(axis=2))
    rests = matrix_product(_weights(), np.sqrt(squares[40:])).reshape(largest.shape)
    sampled = np.sqrt(largest)
    far = _child_samples(vectors, sampled.min(axis=1) > limit)
    return ChildDistances(sampled, np.sqrt(quadratic) + rests, vectors[50:], far)


def _child_samples(vectors: FloatArray, wanted: BoolArray) -> ChildSamples:
    """Some children, (4, P) bool, of P quads; vectors: (59, P, 3), of ``_rows``."""
    parts = (vectors[:16].reshape(4, 4, -1, 3), vectors[16:24].reshape(4, 2, -1, 3))
    off = np.concatenate([_of_each(part, wanted) for part in parts])
    at_corners, of_quads = np.nonzero(wanted)
    return ChildSamples(at_corners, of_quads, corners_of_children(vectors[50:], wanted), off)


def corners_of_children(points: FloatArray, wanted: BoolArray) -> FloatArray:
    """(4, n, 3): the corners of some children, (4, P) bool, of quads with points (9, P, 3), those at corner 0 first."""
    return _of_each((points[four] for four in CORNERS_OF_CHILDREN), wanted)


def _of_each(vectors: Iterable[FloatArray], wanted: BoolArray) -> FloatArray:
    """(…, n, 3): those of some children, (4, P) bool, of vectors (…, P, 3) for each corner."""
    places = map(np.flatnonzero, wanted)
    return np.concatenate([selected_vectors(own, some) for own, some in zip(vectors, places, strict=True)], axis=-2)


@cache
def _rows() -> FloatArray:
    """(59, 16): for each child S - T at the middles of its 4 sides; then for each at the middles of the 2 diagonals;
    then for each, diagonal by diagonal, half the sums of the three at the sides of the 2 triangles; then the 10
    monomials that are more than quadratic, T having none; then the 9 points."""
    corners = [_places(corner) for corner in range(4)]
    sides = np.stack([[_off_chord(four[side], four[(side + 1) % 4]) for side in range(4)] for four in corners])
    diagonals = np.stack([[_off_chord(four[0], four[2]), _off_chord(four[1], four[3])] for four in corners])
    sums = np.empty((4, 2, 2, 16))
    for number, template in enumerate(PLAIN):
        for place, triangle in enumerate(template):
            sums[:, number, place] = (sides[:, _sides(triangle)].sum(axis=1) + diagonals[:, number]) / 2
    rows = (sides, diagonals, sums, to_monomials(), BICUBIC_POINTS)
    return np.concatenate([part.reshape(-1, 16) for part in rows])


def _weights() -> FloatArray:
    """(8, 10): for each child and each diagonal, how far the monomials are off their quadratic parts there."""
    templates = [[_places(corner)[list(triangle)] for triangle in plain] for corner in range(4) for plain in PLAIN]
    return np.stack([off_quadratic(triangles) for triangles in templates])


def _places(corner: int) -> FloatArray:
    """(4, 2): the corners of the child at a corner, from that one on."""
    return WHOLE_QUAD.child(corner).corners()


def _sides(triangle: Triangle) -> list[int]:
    """The sides of a quad that are sides of a triangle."""
    return [side for side in range(4) if {side, (side + 1) % 4} <= {*triangle}]


def _off_chord(start: FloatArray, end: FloatArray) -> FloatArray:
    """(16,): S half-way between two places, off the middle of the chord."""
    ends, middle = np.stack([start, end]), (start + end) / 2
    return bicubic_basis(middle[None])[0] - bicubic_basis(ends).mean(axis=0)
