# SPDX-License-Identifier: GPL-3.0-or-later
"""Vectors with their coordinates apart: arrays (…, P, 3) that lie in memory as (…, 3, P), where numpy is fastest.

Expressions made of such arrays element by element are such arrays again. Nothing depends on it but time.
"""

from __future__ import annotations

import numpy as np

from .matrix_products import product
from .types import FloatArray, IndexArray


def coordinates_apart(vectors: FloatArray) -> FloatArray:
    """The same vectors (…, P, 3), laid out anew where they are not apart."""
    return np.ascontiguousarray(vectors.swapaxes(-1, -2)).swapaxes(-1, -2)


def chosen_vectors(vectors: FloatArray, chosen: IndexArray) -> FloatArray:
    """(…, n, 3): some of (…, P, 3), by index, with their coordinates apart."""
    return vectors.swapaxes(-1, -2).take(chosen, axis=-1).swapaxes(-1, -2)


def applied(matrix: FloatArray, nets: FloatArray) -> FloatArray:
    """(R, P, 3): a matrix (R, N) applied to nets (N, P, 3), with its coordinates apart."""
    columns = nets.swapaxes(1, 2).reshape(len(nets), -1)
    return product(matrix, columns).reshape(len(matrix), 3, -1).swapaxes(1, 2)
