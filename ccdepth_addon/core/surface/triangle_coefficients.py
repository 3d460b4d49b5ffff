# SPDX-License-Identifier: GPL-3.0-or-later
"""Bernstein coefficients of bicubics over triangles of their parameters, where they are polynomials of total degree 6.

The coefficients over a part come from blossoms, not from solving equations. A bicubic S has a blossom s(u₁, u₂, u₃;
v₁, v₂, v₃), symmetric and affine in each u and in each v, which at (u, u, u; v, v, v) is S(u, v); its values are
averages of the 16 tensor coefficients, by de Casteljau with another argument at each step. As a polynomial of total
degree 6, S has the blossom that is the mean, over the 20 ways to choose three of six places, of s at their u and at the
other three's v: that is symmetric, affine in each place, and S where all six are one. Its values at the vertices of the
part, i, j and k times, are the coefficients. So within the square every coefficient is a convex combination of the 16.
"""

from __future__ import annotations

from functools import cache, lru_cache
from itertools import combinations_with_replacement
from math import comb

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from .bicubic import cubic_blossoms, tensor

DEGREE = 6


@cache
def arguments_of(degree: int) -> IndexArray:
    """(28, 6) for degree 6: the vertices of a triangle at which the blossom of a polynomial is each of its Bernstein
    coefficients, in order."""
    return np.array([*combinations_with_replacement(range(3), degree)])


def counts_of(degree: int) -> IndexArray:
    """(28, 3) for degree 6: the multiplicity of each vertex in each coefficient."""
    return (arguments_of(degree)[:, :, None] == np.arange(3)).sum(axis=1)


@cache
def _ways_to_share() -> FloatArray:
    """(28, 100): among the 20 ways to choose three of a coefficient's six arguments, the number in which the chosen
    arguments belong to one cubic coefficient, and the others to another, [a, b] → 10a + b."""
    whole = counts_of(6)[:, None, None]
    chosen, others = counts_of(3)[None, :, None], counts_of(3)[None, None]
    choose = np.array([[comb(n, k) for k in range(4)] for n in range(7)])
    ways = choose[whole, chosen].prod(axis=-1) * np.all(chosen + others == whole, axis=-1)
    return ways.reshape(len(ways), -1).astype(np.float64)


def bicubic_basis(points: FloatArray) -> FloatArray:
    """(N, 16): the bicubic Bernstein basis at parameters (N, 2)."""
    along, across = (cubic_blossoms(np.stack([each] * 3)) for each in points.T)
    return np.einsum("in,jn->nij", along, across).reshape(len(points), 16)


def coefficients_over(part: FloatArray) -> FloatArray:
    """(28, 16): from the Bernstein coefficients of a bicubic, [i, j] → 4i + j, to those of total degree 6 over a
    triangle (3, 2) of its parameters.

    None is negative within [0, 1]², and a row sums to 1.
    """
    return _coefficients_over(tuple(part.ravel().tolist()))


@lru_cache(maxsize=4096)
def _coefficients_over(places: tuple[float, ...]) -> FloatArray:
    """The coefficients by the parameters of the triangle's vertices: squares of a quad are cut alike in their own."""
    along, across = (cubic_blossoms(each[arguments_of(3).T]) for each in np.array(places).reshape(3, 2).T)
    return _ways_to_share() @ tensor(along.T, across.T) / comb(6, 3)


def triangle_quarters() -> tuple[FloatArray, ...]:
    """Four (28, 28): from the Bernstein coefficients of total degree 6 over a triangle to those over its quarters, with
    corners that are corners and middles of sides.

    The blossom at six places is the sum over all choices of one corner for each place, weighted by the barycentric
    coordinates there; the coefficient depends on the number of times each corner is chosen.
    """
    corners = np.eye(3)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    quarters = [np.stack([corners[k], middles[k], middles[k - 1]]) for k in range(3)]
    return tuple(_from_whole(quarter) for quarter in (*quarters, middles))


def _from_whole(quarter: FloatArray) -> FloatArray:
    """(28, 28): the rows for one quarter, by its corners' barycentric coordinates (3, 3)."""
    weights = np.zeros((len(arguments_of(DEGREE)), DEGREE + 2, DEGREE + 2))
    weights[:, 0, 0] = 1.0
    for place in quarter[arguments_of(DEGREE)].swapaxes(0, 1)[..., None, None]:
        # The number of times corners 1 and 2 are chosen; corner 0 is the rest. The last row and column stay empty.
        one_more = np.roll(weights, 1, axis=1), np.roll(weights, 1, axis=2)
        weights = place[:, 0] * weights + place[:, 1] * one_more[0] + place[:, 2] * one_more[1]
    return weights[:, *counts_of(DEGREE)[:, 1:].T]
