# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads that Blender may triangulate along their second diagonal."""

from __future__ import annotations

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import cross_products, dot_products, squared_norms

# Blender triangulates a quad along its first diagonal unless the triangles there face away from each other. Single
# precision must not decide that, so the cosine between their normals has to be this large.
LEAST_COSINE = 1e-3


def is_folded(corners: FloatArray, *spaces: FloatArray) -> BoolArray:
    """(P,) whether the triangles of quads (4, P, 3), split from corner 0, face apart or nearly, in any of the spaces.

    spaces: (3, 3) each, with the axes of a space as columns, in coordinates of the quads.
    """
    a, b, c, d = corners
    first, second = cross_products(b - a, c - a), cross_products(c - a, d - a)
    folded = np.zeros(len(a), dtype=bool)
    for axes in spaces:
        one, other = _normals_in(first, axes), _normals_in(second, axes)
        cosines = dot_products(one, other)
        folded |= cosines <= LEAST_COSINE * np.sqrt(squared_norms(one) * squared_norms(other))
    return folded


def _normals_in(normals: FloatArray, axes: FloatArray) -> FloatArray:
    """(P, 3): normals of planes in a space with given axes, up to length, by the transposed matrix."""
    return normals if np.array_equal(axes, np.eye(3)) else matrix_product(axes.T, normals.T).T
