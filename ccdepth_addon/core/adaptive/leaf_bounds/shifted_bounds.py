# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of bicubic quads from the triangles of templates, at parameters shifted along them (docs/adaptive.md, At
shifted parameters).

At equal parameters a quad of uneven spacing is off its triangles along them, which costs nothing. So a point of the
surface is compared with the triangles at parameters shifted by polynomials that are 0 at the sides they would leave:
the surface less its shift is bicubic again, and is bounded as at equal parameters.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...arrays.chunks import chunks
from ...arrays.matrix_products import matrix_product
from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import dot_products, selected_vectors, squared_norms, transformed_nets
from ..templates import QUAD_POINTS, template_groups, templates
from .leaf_distance import LEAVES_AT_ONCE
from .triangle_bounds import barycentric, barycentric_rows, bicubic_rows

# The largest shifts, as factors of u(1 - u) and of 16 u(1 - u) v(1 - v): with these all parameters stay in the quad.
MOST_AT_SIDES = 1 / 2
MOST_AT_CENTRE = 1 / 8

# The sides along which the first four shifts are, each with the number of the direction in which it goes.
SIDES = ((0, 0), (2, 0), (3, 1), (1, 1))


def shifted_distances(coefficients: FloatArray, points: FloatArray, numbers: IndexArray) -> FloatArray:
    """(P,): upper bounds of the distance in both directions between quads and the triangles of the template of each, by
    its number (``template_numbers``), for Bernstein coefficients (16, P, 3), [i, j] → 4i + j, u along i.

    points: (9, P, 3), those of the quads (``templates.QUAD_POINTS``) and their centres.
    """
    found = np.empty(len(numbers))
    for pattern, alternative, own in template_groups(numbers):
        rows = _rows(pattern, alternative)
        for chunk in chunks(len(own), LEAVES_AT_ONCE):
            chosen = own[chunk]
            columns = np.empty((21, 3, len(chosen)))
            np.take(coefficients.swapaxes(1, 2), chosen, axis=2, out=columns[:16])
            columns[16:], rest = _shifts(selected_vectors(points, chosen), pattern, alternative)
            vectors = matrix_product(rows, columns.reshape(21, -1)).reshape(len(rows), 3, -1)
            vectors *= vectors
            found[chosen] = np.sqrt(vectors.sum(axis=1).max(axis=0)) + rest
    return found


def _shifts(points: FloatArray, pattern: int, alternative: int) -> tuple[FloatArray, FloatArray]:
    """The shifts of P quads with points (9, P, 3), vectors (5, 3, P) for ``_basis``; and (P,) how far the triangles may
    be from what the shifts suppose."""
    a, b, c, d = points[:4]
    directions = ((b - a) + (c - d)) / 2, ((d - a) + (c - b)) / 2
    squares, mixed = [squared_norms(each) for each in directions], dot_products(*directions)
    at_sides, shifts = np.zeros((4, len(mixed))), np.zeros((5, 3, len(mixed)))
    for number, (side, way) in enumerate(SIDES):
        # At the middle of a split side the triangles have a vertex where it belongs.
        if not pattern >> side & 1:
            off = points[4 + side] - (points[side] + points[(side + 1) % 4]) / 2
            factors = 4 * dot_products(off, directions[way]) / _divisor(squares[way])
            at_sides[number] = np.clip(factors, -MOST_AT_SIDES, MOST_AT_SIDES)
            shifts[number] = directions[way].T * at_sides[number]
    centre, derivatives = _centre_and_derivatives(pattern, alternative)
    # What is left at the centre, as a combination of both directions.
    left = points[8] - transformed_nets(centre[None], points[:8])[0] - shifts[:4].sum(axis=0).T / 8
    products = [dot_products(left, each) for each in directions]
    divisor, largest = _divisor(squares[0] * squares[1] - mixed**2), np.zeros(len(mixed))
    by_derivative = transformed_nets(derivatives.reshape(-1, 8), points[:8]).reshape(2, -1, *points.shape[1:])
    for way, direction in enumerate(directions):
        factors = (products[way] * squares[1 - way] - products[1 - way] * mixed) / divisor
        at_centre = np.clip(factors, -MOST_AT_CENTRE, MOST_AT_CENTRE)
        shifts[4] += direction.T * at_centre
        farthest = np.abs(at_sides[2 * way : 2 * way + 2]).max(axis=0) / 4 + np.abs(at_centre)
        largest = largest + farthest * np.sqrt(squared_norms(by_derivative[way] - direction))
    return shifts, largest.max(axis=0)


def _divisor(squares: FloatArray) -> FloatArray:
    """Squares to divide by, those that are 0 replaced: any shift will do there."""
    return np.where(squares > 0, squares, 1.0)


@lru_cache(maxsize=64)
def _centre_and_derivatives(pattern: int, alternative: int) -> tuple[FloatArray, FloatArray]:
    """(8,) a template's centre, and (2, T, 8) derivatives of its triangles along u and v: from a quad's points."""
    template = templates(pattern)[alternative]
    centre, derivatives = np.zeros(8), np.zeros((2, len(template), 8))
    for number, triangle in enumerate(template):
        corners = QUAD_POINTS[list(triangle)]
        weights = barycentric(corners, np.array([0.5, 0.5]))
        if np.all(weights >= 0):
            centre[:] = 0.0
            centre[list(triangle)] = weights
        opposite, doubled_area = barycentric_rows(corners)
        derivatives[:, number, list(triangle)] = opposite[:2] / doubled_area
    return centre, derivatives


@lru_cache(maxsize=64)
def _rows(pattern: int, alternative: int) -> FloatArray:
    """(R, 21): those of ``bicubic_rows``, also for the five shifts, which are subtracted. Triangles have the same where
    they meet."""
    rows = bicubic_rows(pattern, alternative)
    _, kept = np.unique(rows.places, axis=0, return_index=True)
    return np.hstack([rows.matrix[kept], -rows.matrix[kept] @ _basis().T])


def _basis() -> FloatArray:
    """(5, 16): the Bernstein coefficients of u(1 - u)(1 - v), u(1 - u)v, (1 - u)v(1 - v), uv(1 - v) and
    16 u(1 - u) v(1 - v)."""
    bump, low, high = np.array([[0, 1, 1, 0], [3, 2, 1, 0], [0, 1, 2, 3]]) / 3
    pairs = ((bump, low), (bump, high), (low, bump), (high, bump), (16 * bump, bump))
    return np.stack([np.outer(one, other).ravel() for one, other in pairs])
