# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays of vectors (…, P, 3), and the component-major layout.

An array of vectors is *component-major* when it lies in memory as (…, 3, P): all x, then all y, then all z. Indexing,
shapes and results are the same as in any other layout; only the time differs, because numpy works along whole runs of
one component. ``selected_vectors`` and ``transformed_nets`` make such arrays; ``cross_products`` and elementwise
arithmetic keep the layout. No function requires it.
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
    columns = nets.swapaxes(1, 2).reshape(len(nets), -1)
    return matrix_product(matrix, columns).reshape(len(matrix), 3, -1).swapaxes(1, 2)


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
    product = np.empty_like(a, shape=np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(a[..., j], b[..., k], out=product[..., i])
        product[..., i] -= a[..., k] * b[..., j]
    return product


def angles_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """(…): the angles between unit vectors (…, 3), well-conditioned near 0."""
    found: FloatArray = 2 * np.arcsin(np.minimum(lengths(a - b) / 2, 1.0))
    return found


def sums_by_index(indices: IndexArray, vectors: FloatArray, count: int) -> FloatArray:
    """(count, 3): row i is the sum of the vectors (N, 3) whose entry in ``indices`` (N,) is i."""
    return np.stack([np.bincount(indices, weights=column, minlength=count) for column in vectors.T], axis=1)
