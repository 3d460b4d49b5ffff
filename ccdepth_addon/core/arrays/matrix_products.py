# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products on the calling thread.

The libraries behind numpy's products spread large ones over threads of their own, which compete with those of
``threads``; products of a few columns at a time stay on the calling thread.
"""

from __future__ import annotations

import numpy as np

from .chunks import chunks
from .types import FloatArray

# The largest number of multiplications for which OpenBLAS uses one thread.
ON_ONE_THREAD = 1 << 18


def matrix_product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """(rows, …) = (rows, k) @ (k, …), in chunks of columns."""
    flat = columns.reshape(len(columns), -1)
    result = np.empty((len(matrix), flat.shape[1]))
    for chunk in chunks(flat.shape[1], max(1, ON_ONE_THREAD // matrix.size)):
        np.matmul(matrix, flat[:, chunk], out=result[:, chunk])
    return result.reshape(len(matrix), *columns.shape[1:])
