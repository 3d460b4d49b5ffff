# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of vectors (…, P, 3), the component-major layout, and columns (…, 3, N).

An array of vectors is *component-major* when it lies in memory as (…, 3, P): all x, then all y, then all z. Indexing,
shapes and results are the same as in any other layout; only the time differs, because numpy works along whole runs of
one component. ``selected_vectors`` and ``transformed_nets`` make such arrays; ``cross_products`` and elementwise
arithmetic keep the layout. No function requires it. Columns are the same arrays with both last axes exchanged: each
value of all things next to each other, so that sums and maxima run along them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .matrix_products import matrix_product
from .types import FloatArray, IndexArray


def selected_vectors(vectors: FloatArray, indices: IndexArray) -> FloatArray:
    """(…, n, 3), component-major: the vectors (…, P, 3) at the indices (n,)."""
    return vectors.swapaxes(-1, -2).take(indices, axis=-1).swapaxes(-1, -2)


def component_major(vectors: FloatArray) -> FloatArray:
    """Vectors (…, P, 3) in the component-major layout."""
    return np.ascontiguousarray(vectors.swapaxes(-1, -2)).swapaxes(-1, -2)


def joined_vectors(vectors: Sequence[FloatArray]) -> FloatArray:
    """(…, sum of P, 3), component-major: several (…, P, 3), one after the other."""
    return np.concatenate([each.swapaxes(-1, -2) for each in vectors], axis=-1).swapaxes(-1, -2)


def transformed_nets(matrix: FloatArray, nets: FloatArray) -> FloatArray:
    """(R, P, 3), component-major: the rows of a matrix (R, N) as combinations of the points of nets (N, P, 3)."""
    return matrix_product(matrix, nets.swapaxes(1, 2)).swapaxes(1, 2)


def squared_norms(vectors: FloatArray) -> FloatArray:
    """(…): the squared lengths of vectors (…, 3)."""
    squares = vectors * vectors
    # Three strided sums are faster than a reduction over an axis of three.
    total = squares[..., 0] + squares[..., 1]
    total += squares[..., 2]
    return total


def lengths(vectors: FloatArray) -> FloatArray:
    """(…): the lengths of vectors (…, 3)."""
    return np.sqrt(squared_norms(vectors))


def units(vectors: FloatArray) -> FloatArray:
    """(…, 3): vectors of length 1, zero for vectors without a direction."""
    length = lengths(vectors)
    return vectors / np.where(length > 0, length, 1.0)[..., None]


def dot_products(a: FloatArray, b: FloatArray) -> FloatArray:
    """(…): the scalar products of vectors (…, 3), faster than numpy's own on component-major vectors."""
    dots = a[..., 0] * b[..., 0]
    dots += a[..., 1] * b[..., 1]
    dots += a[..., 2] * b[..., 2]
    return dots


def cross_products(a: FloatArray, b: FloatArray) -> FloatArray:
    """(…, 3): the cross products of vectors (…, 3), several times as fast as numpy's own."""
    product = np.empty_like(max(a, b, key=np.ndim), shape=np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[..., j], b[..., k], out=product[..., i])
        product[..., i] -= a[..., k] * b[..., j]
    return product


def angles_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(…): the angles between unit vectors (…, 3), well-conditioned near 0."""
    found: FloatArray = 2 * np.arcsin(np.minimum(lengths(a - b) / 2, 1.0))
    return found


def columns(rows: FloatArray) -> FloatArray:
    """(N, …) → (…, N): rows as columns."""
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def products(one: FloatArray, other: FloatArray) -> FloatArray:
    """(…, N): the scalar products of columns (…, 3, N)."""
    return dot_products(one.swapaxes(-1, -2), other.swapaxes(-1, -2))


def crosses(one: FloatArray, other: FloatArray) -> FloatArray:
    """(…, 3, N): the cross products of columns (…, 3, N)."""
    return cross_products(one.swapaxes(-1, -2), other.swapaxes(-1, -2)).swapaxes(-1, -2)


def applied(functionals: FloatArray, points: FloatArray) -> FloatArray:
    """(k, m, N): the values of linear functionals (k, 3, N) of points (3, m, N)."""
    values = np.empty((len(functionals), *points.shape[1:]))
    product = np.empty(points.shape[1:])
    for functional, value in zip(functionals, values, strict=True):
        np.multiply(functional[0], points[0], out=value)
        for axis in (1, 2):
            value += np.multiply(functional[axis], points[axis], out=product)
    return values


def sums_by_index(indices: IndexArray, vectors: FloatArray, count: int) -> FloatArray:
    """(count, 3): row i is the sum of the vectors (N, 3) whose entry in ``indices`` (N,) is i."""
    return np.stack([np.bincount(indices, weights=column, minlength=count) for column in vectors.T], axis=1)
