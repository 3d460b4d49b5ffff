# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products that stay on the thread that asks for them.

The libraries behind numpy spread a large product over threads of their own, which get in the way of ``parallel``: with
both at work a product takes many times as long. Products below 2¹⁸ multiplications are left alone by all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from time import perf_counter

import numpy as np

from .blocks import blocks
from .mesh import FloatArray

MOST_MULTIPLICATIONS = 1 << 18
FEWEST_COLUMNS = 64

# So much of a row stays in the processor's cache while it is summed up.
COLUMNS_SUMMED_AT_ONCE = 1 << 12

# To find out what is faster: a product of 16 × 16 × so many, and how often it is tried.
TRIED_COLUMNS, TRIES = 1000, 7


def product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """(rows, N) = (rows, k) @ (k, N), in blocks of rows and columns."""
    rows, size = matrix.shape
    result = np.empty((rows, columns.shape[1]))
    if not has_fast_library():
        for block in blocks(columns.shape[1], COLUMNS_SUMMED_AT_ONCE):
            np.einsum("ij,jk->ik", matrix, columns[:, block], out=result[:, block])
        return result
    rows_at_once = max(1, min(rows, MOST_MULTIPLICATIONS // (FEWEST_COLUMNS * max(1, size)) - 1))
    for start in range(0, rows, rows_at_once):
        block = slice(start, start + rows_at_once)
        _by_columns(matrix[block], columns, result[block])
    return result


@cache
def has_fast_library() -> bool:
    """Whether numpy multiplies matrices faster than it sums up products itself."""
    matrix, columns = np.ones((16, 16)), np.ones((16, TRIED_COLUMNS))
    by_library = _shortest(lambda: np.matmul(matrix, columns))
    return by_library < _shortest(lambda: np.einsum("ij,jk->ik", matrix, columns))


def _shortest(work: Callable[[], object]) -> float:
    """Seconds of some tries, of which the first may have to load something."""
    times = []
    for _ in range(TRIES):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def _by_columns(matrix: FloatArray, columns: FloatArray, result: FloatArray) -> None:
    rows, size = matrix.shape
    count = columns.shape[1]
    at_once = max(1, MOST_MULTIPLICATIONS // max(1, rows * size) - 1)
    whole = count - count % at_once
    if whole:
        # All the blocks in one call, as a stack of products.
        stacks = (array[:, :whole].reshape(len(array), -1, at_once).swapaxes(0, 1) for array in (columns, result))
        np.matmul(matrix, next(stacks), out=next(stacks))
    if whole < count:
        np.matmul(matrix, columns[:, whole:], out=result[:, whole:])
