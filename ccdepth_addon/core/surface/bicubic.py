# SPDX-License-Identifier: GPL-3.0-or-later
"""Bicubic B-spline patches in Bernstein form.

Nets are (4, 4, P, 3); coefficients are (rows, P, 3), or (4, 4, P, 3) for a whole patch. Functionals of a net are
(rows, 16) matrices, its points counted [i, j] → 4i + j.
"""

from __future__ import annotations

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import FloatArray
from ..arrays.vectors import squared_norms

SPLINE_TO_BERNSTEIN = np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6
FIRST_DIFFERENCE = np.array([[-1, 1, 0, 0], [0, -1, 1, 0], [0, 0, -1, 1]], dtype=np.float64)
SECOND_DIFFERENCE = np.array([[1, -2, 1, 0], [0, 1, -2, 1]], dtype=np.float64)
FIRST_HALF = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8
HALVES = (FIRST_HALF, FIRST_HALF[::-1, ::-1])
SPLINE_HALVES = (
    np.array([[4, 4, 0, 0], [1, 6, 1, 0], [0, 4, 4, 0], [0, 1, 6, 1]]) / 8,
    np.array([[1, 6, 1, 0], [0, 4, 4, 0], [0, 1, 6, 1], [0, 0, 4, 4]]) / 8,
)

# (16, 16) each: the Bernstein coefficients of a patch's quarters at corners 0, 3, 1 and 2.
QUARTERS = tuple(np.kron(one, other) for one in HALVES for other in HALVES)

# The coefficients at corners 0 to 3 of a face, and the points of its net there.
CORNERS = np.array([0, 12, 15, 3])
NET_CORNERS = np.array([5, 9, 10, 6])

# (16, 2): the parameters of the Bernstein coefficients.
GREVILLE = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])


def apply(functionals: FloatArray, net: FloatArray) -> FloatArray:
    """(rows, P, 3): the values of functionals (rows, 16) on nets (4, 4, P, 3)."""
    return matrix_product(functionals, net.reshape(16, -1, 3))


def tensor(along_u: FloatArray, along_v: FloatArray) -> FloatArray:
    """(a · b, 16): the tensor products of all pairs of rows of (a, 4) and (b, 4)."""
    return np.einsum("ai,bj->abij", along_u, along_v).reshape(-1, 16)


def cubic_blossoms(arguments: FloatArray) -> FloatArray:
    """(4, n): the weights of a cubic's Bernstein coefficients over [0, 1] in its blossom at arguments (3, n)."""
    weights = np.zeros((4, arguments.shape[1]))
    weights[0] = 1.0
    for argument in arguments:
        # Each step takes in one argument; the last weight is still none before the last of them.
        weights = (1 - argument) * weights + argument * np.roll(weights, 1, axis=0)
    return weights


def largest_norm(vectors: FloatArray) -> FloatArray:
    """(P,): the longest of the vectors (rows, P, 3) of each patch."""
    return np.sqrt(squared_norms(vectors).max(axis=0))


def second_derivatives() -> FloatArray:
    """(20, 16): functionals for S_uu (2 × 4) and S_vv (4 × 2) in Bernstein form, and S_uuvv (2 × 2), knots 1 apart."""
    return np.concatenate(
        [
            tensor(SECOND_DIFFERENCE, SPLINE_TO_BERNSTEIN),
            tensor(SPLINE_TO_BERNSTEIN, SECOND_DIFFERENCE),
            tensor(SECOND_DIFFERENCE, SECOND_DIFFERENCE),
        ]
    )


def elevated(ends: FloatArray) -> FloatArray:
    """(4, …): linear coefficients (2, …) raised to cubic ones."""
    first, last = ends
    return np.stack([first, (2 * first + last) / 3, (first + 2 * last) / 3, last])


def bilinear_coefficients(corners: FloatArray) -> FloatArray:
    """(4, 4, …): the bicubic Bernstein coefficients of bilinear facets over corners (4, …) in a face's order."""
    first, second, third, fourth = corners
    ends = np.stack([elevated(np.stack([first, fourth])), elevated(np.stack([second, third]))])
    return elevated(ends)


# (16, 16): Bernstein coefficients from a net.
NET_TO_BERNSTEIN = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)


def patch_coefficients(net: FloatArray) -> FloatArray:
    """(4, 4, P, 3): the Bernstein coefficients of the patches."""
    return apply(NET_TO_BERNSTEIN, net).reshape(net.shape)
