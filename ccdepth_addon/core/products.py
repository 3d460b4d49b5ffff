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
    """(rows, N) = (rows, k) @ (k, N), in blocks of columns."""
    rows, size = matrix.shape
    at_once = max(FEWEST_COLUMNS, MOST_MULTIPLICATIONS // max(1, rows * size) - 1)
    result = np.empty((rows, columns.shape[1]))
    for start in range(0, columns.shape[1], at_once):
        block = slice(start, start + at_once)
        np.matmul(matrix, columns[:, block], out=result[:, block])
    return result
