# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of pieces of the surface as polynomials, and proved bounds of their angles with interpolated normals.

A polynomial is a grid (I, J, …, P). Over a square of degree (p, q), entry (i, j) is the Bernstein coefficient times
C(p, i) C(q, j); over a triangle of degree n, it is the coefficient with exponents i and j of the second and the third
vertex times their trinomial coefficient, and zero where i + j > n. With these factors the product of two polynomials is
the convolution of their grids, over squares and over triangles alike.

The angle between N and m is at most θ < 90° where |N × m| ≤ tan θ (N · m). Vectors (w, s) with |w| ≤ tan θ s are a
convex cone, and values of a polynomial are convex combinations of its coefficients. So the angle is at most θ over the
whole piece if all coefficients of (N × m, N · m) are in the cone (docs/normals.md).
"""

from __future__ import annotations

from functools import cache
from itertools import product
from math import comb

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from .triangle_coefficients import DEGREE, counts_of

# Coefficients this much shorter than the longest are zero up to rounding: the surface has no normal there.
NO_NORMAL = 1e-12

# Rows of a grid multiplied together: few enough for the caches, and to pass over the zeros of a triangle's grid.
ROWS = 3


def _binomials(degree: int) -> FloatArray:
    return np.array([comb(degree, i) for i in range(degree + 1)], dtype=np.float64)


@cache
def _factors(rows: int, columns: int, *, triangle: bool) -> FloatArray:
    """(rows, columns, 1, 1): the factors of a grid."""
    if not triangle:
        return np.outer(_binomials(rows - 1), _binomials(columns - 1))[:, :, None, None]
    degree = rows - 1
    found = [
        [comb(degree, i) * comb(degree - i, j) if i + j <= degree else 0 for j in range(rows)] for i in range(rows)
    ]
    return np.array(found, dtype=np.float64)[:, :, None, None]


@cache
def _places() -> tuple[IndexArray, IndexArray]:
    """The grid indices of the 28 coefficients over a triangle."""
    counts = counts_of(DEGREE)
    return counts[:, 1], counts[:, 2]


def _unscaled(points: FloatArray) -> FloatArray:
    """(I, J, D, P): the coefficients (R, D, P) of a piece in a grid, without factors."""
    if len(points) == 16:
        return points.reshape(4, 4, *points.shape[1:])
    found = np.zeros((DEGREE + 1, DEGREE + 1, *points.shape[1:]))
    found[_places()] = points
    return found


def is_triangle(points: FloatArray) -> bool:
    """Whether the coefficients of a piece are those over a triangle, rather than over a square."""
    return len(points) != 16


def grid_of(points: FloatArray) -> FloatArray:
    """(I, J, D, P): the grid of a polynomial with coefficients (R, D, P), 16 over a square or 28 over a triangle."""
    found = _unscaled(points)
    return found * _factors(*found.shape[:2], triangle=is_triangle(points))


def linear_grid(corners: FloatArray) -> FloatArray:
    """(2, 2, D, P): the grid of a linear polynomial, by its values (3, D, P) or (4, D, P) at the corners of a triangle
    or a square."""
    if len(corners) == 4:
        return np.stack([corners[[0, 3]], corners[[1, 2]]])
    return np.stack([np.stack([corners[0], corners[2]]), np.stack([corners[1], np.zeros_like(corners[1])])])


def normal_grid(points: FloatArray) -> FloatArray:
    """(I, J, 3, P): the grid of a positive multiple of S_u × S_v, from the coefficients (R, 3, P) of S."""
    net, triangle = _unscaled(points), is_triangle(points)
    if triangle:
        # With exponents in the grid, a difference goes from the first vertex to another.
        start = net[:-1, :-1]
        along, across = net[1:, :-1] - start, net[:-1, 1:] - start
    else:
        along, across = np.diff(net, axis=0), np.diff(net, axis=1)
    along = along * _factors(*along.shape[:2], triangle=triangle)
    across = across * _factors(*across.shape[:2], triangle=triangle)
    (rows, columns), count = across.shape[:2], points.shape[-1]
    found = np.zeros((len(along) + rows - 1, along.shape[1] + columns - 1, 3, count))
    for i, j in product(range(rows), range(columns)):
        if triangle and i + j >= rows:
            continue
        own = found[i : i + len(along), j : j + along.shape[1]]
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            own[:, :, a] += along[:, :, b] * across[i, j, c]
            own[:, :, a] -= along[:, :, c] * across[i, j, b]
    return found


def largest_angles(normals: FloatArray, directions: FloatArray, *, triangle: bool) -> tuple[FloatArray, FloatArray]:
    """(P,) twice, in radians: upper bounds of the angle between polynomials by their grids (I, J, 3, P), normals of the
    surface and interpolated normals, and the largest angle at a corner of the piece. Bounds are π where no angle below
    a right angle is proved."""
    rows, columns = directions.shape[:2]
    count = normals.shape[-1]
    turned = np.zeros((len(normals) + rows - 1, normals.shape[1] + columns - 1, 4, count))
    for first, i, j in product(range(0, len(normals), ROWS), range(rows), range(columns)):
        if triangle and i + j >= rows:
            continue
        some = normals[first : first + ROWS, : len(normals) - first] if triangle else normals[first : first + ROWS]
        own, m = turned[first + i : first + i + len(some), j : j + some.shape[1]], directions[i, j]
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            own[:, :, a] += some[:, :, b] * m[c]
            own[:, :, a] -= some[:, :, c] * m[b]
            own[:, :, 3] += some[:, :, a] * m[a]
    cosines = turned[:, :, 3]
    sines = turned[:, :, 0] ** 2 + turned[:, :, 1] ** 2 + turned[:, :, 2] ** 2
    squares = cosines**2
    longest = (sines + squares).max(axis=(0, 1))
    counted = sines + squares > NO_NORMAL**2 * longest
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = np.where(counted, np.where(cosines > 0, sines / squares, np.inf), 0.0)
    corners = [(0, 0), (-1, 0), (0, -1)] if triangle else [(0, 0), (-1, 0), (-1, -1), (0, -1)]
    reached = np.max([tangents[place] for place in corners], axis=0)
    bounds = np.where(longest > 0, tangents.max(axis=(0, 1)), np.inf)
    return _angles(bounds), _angles(reached)


def _angles(squared_tangents: FloatArray) -> FloatArray:
    return np.where(np.isfinite(squared_tangents), np.arctan(np.sqrt(squared_tangents)), np.pi)
