# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface and the drawn triangles of templates as functionals of Bernstein coefficients.

Over a part of a triangle S - T is a polynomial of total degree 6, and no longer than the longest of its 28 Bernstein
coefficients there. The distance at equal parameters holds in both directions (docs/adaptive.md, Triangles on the
surface). All parameters are multiples of 1/16 of the square, so the sums below are exact in double precision, and each
weight is off by the rounding of one division (docs/adaptive.md, Rounding).
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import lengths, selected_vectors, transformed_nets
from ..surface.squares import WHOLE_QUAD, Square
from ..surface.triangle_coefficients import DEGREE, bicubic_basis, coefficients_over, counts_of
from .templates import QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES, template_groups

# The factor by which the largest coefficient over a triangle exceeds the largest distance where the surface is
# quadratic; coefficients over quarters are nearer.
MOST_OVER = 1.2

# (8, 16): the points of a bicubic quad from its Bernstein coefficients.
BICUBIC_POINTS = bicubic_basis(QUAD_POINTS)


def bounds_at_equal(coefficients: FloatArray, numbers: IndexArray, limits: FloatArray) -> FloatArray:
    """(P,): upper bounds of ‖S - T‖ for bicubic quads with coefficients (16, P, 3) and template numbers (P,), as tight
    as a comparison with the limits (P,) needs."""
    found = np.empty(len(numbers))
    for pattern, alternative, own in template_groups(numbers):
        number, nets = 16 * alternative + pattern, selected_vectors(coefficients, own)
        bounds = lengths(transformed_nets(_off_template(number), nets)).max(axis=0)
        doubtful = np.flatnonzero((bounds > limits[own]) & (bounds <= MOST_OVER * limits[own]))
        if len(doubtful):
            fine = transformed_nets(_off_template(number, fine=True), selected_vectors(nets, doubtful))
            bounds[doubtful] = lengths(fine).max(axis=0)
        found[own] = bounds
    return found


@lru_cache(maxsize=128)
def _off_template(number: int, *, fine: bool = False) -> FloatArray:
    """(R, 16): the coefficients of S - T over the triangles of a template, or over their quarters if ``fine``."""
    rows = []
    for triangle in TRIANGLES[number, : TRIANGLE_COUNTS[number]]:
        corners = QUAD_POINTS[triangle]
        for part in quartered(corners) if fine else [corners]:
            of_surface, of_corners = functionals(part, WHOLE_QUAD, corners)
            rows.append(of_surface - of_corners @ BICUBIC_POINTS[triangle])
    # S - T vanishes at the vertices, and triangles share coefficients on their sides.
    found = np.unique(np.concatenate(rows), axis=0)
    return np.ascontiguousarray(found[np.any(found != 0, axis=1)])


def barycentric_rows(triangle: FloatArray) -> tuple[FloatArray, float]:
    """(3, 3): the matrix from places (u, v, 1) to the weights of a triangle's vertices (3, 2), times twice the area;
    and twice the area. Both are exact for parameters."""
    (bx, by), (cx, cy) = np.roll(triangle, -1, axis=0).T, np.roll(triangle, -2, axis=0).T
    opposite = np.stack([by - cy, cx - bx, bx * cy - by * cx])
    return opposite, float(triangle[0] @ opposite[:2, 0] + opposite[2, 0])


def functionals(part: FloatArray, square: Square, triangle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(28, 16) and (28, 3): the coefficients of S and of T over a part (3, 2) of a triangle (3, 2).

    S by its Bernstein coefficients over the square that holds the part, T by its values at the triangle's vertices.
    """
    opposite, doubled_area = barycentric_rows(triangle)
    domain_points = counts_of(DEGREE).astype(np.float64) @ np.column_stack([part, np.ones(3)])
    return coefficients_over(square.from_parent(part)), (domain_points @ opposite) / (DEGREE * doubled_area)


def clipped(triangle: FloatArray, square: Square) -> list[FloatArray]:
    """The part of a triangle inside a square, as triangles (3, 2)."""
    corners = square.corners()
    polygon = list(triangle)
    for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = following - corner
        heights = [float(side[0] * (p - corner)[1] - side[1] * (p - corner)[0]) for p in polygon]
        clipped = []
        for i, (point, height) in enumerate(zip(polygon, heights, strict=True)):
            previous, previous_height = polygon[i - 1], heights[i - 1]
            if height * previous_height < 0:
                # All of these are dyadic fractions, and the quotient is one: nothing is rounded.
                crossing = previous_height * point - height * previous
                clipped.append(crossing / (previous_height - height))
            if height >= 0:
                clipped.append(point)
        polygon = clipped
    fans = [np.array([polygon[0], b, c]) for b, c in pairwise(polygon[1:])]
    return [fan for fan in fans if _has_area(fan)]


def _has_area(triangle: FloatArray) -> bool:
    """Whether the corners (3, 2) are not on one line. numpy 2.5 takes no cross product of vectors in a plane."""
    one, other = triangle[1:] - triangle[0]
    return bool(one[0] * other[1] != one[1] * other[0])


def quartered(triangle: FloatArray) -> list[FloatArray]:
    """A triangle's four quarters."""
    a, b, c = triangle
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return [np.array(part) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
