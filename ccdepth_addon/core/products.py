# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products that stay on the thread that asks for them.

The libraries behind numpy spread a large product over threads of their own, which get in the way of ``parallel``: with
both at work a product takes many times as long. Products below 2¹⁸ multiplications are left alone by all of them.
"""

from __future__ import annotations

import numpy as np

from .mesh import FloatArray

MOST_MULTIPLICATIONS = 1 << 18
FEWEST_COLUMNS = 64


def product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """(rows, N) = (rows, k) @ (k, N), in blocks of rows and columns."""
    rows, size = matrix.shape
    result = np.empty((rows, columns.shape[1]))
    rows_at_once = max(1, min(rows, MOST_MULTIPLICATIONS // (FEWEST_COLUMNS * max(1, size)) - 1))
    for start in range(0, rows, rows_at_once):
        block = slice(start, start + rows_at_once)
        _by_columns(matrix[block], columns, result[block])
    return result


def _by_columns(matrix: FloatArray, columns: FloatArray, result: FloatArray) -> None:
    rows, size = matrix.shape
    count = columns.shape[1]
    at_once = max(1, MOST_MULTIPLICATIONS // max(1, rows * size) - 1)
    whole = count - count % at_once
    if whole:
        # All the blocks in one call, as a stack of products.
        blocks = (array[:, :whole].reshape(len(array), -1, at_once).swapaxes(0, 1) for array in (columns, result))
        np.matmul(matrix, next(blocks), out=next(blocks))
    if whole < count:
        np.matmul(matrix, columns[:, whole:], out=result[:, whole:])
