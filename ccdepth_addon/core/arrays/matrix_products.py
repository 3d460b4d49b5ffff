# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products that stay on the thread that asks for them, and whose bits depend on nothing but the numbers.

The libraries behind numpy's own products differ from one Blender to the next. Some spread a large product over threads
of their own, which get in the way of ``threads``, and share it out by how many processors there are; some are slow.
numpy's sums of products do neither, and take as long as the fast ones for matrices as small as those here.
"""

from __future__ import annotations

import numpy as np

from .chunks import blocks
from .types import FloatArray

# So much of a row stays in the processor's cache while it is summed up.
COLUMNS_AT_ONCE = 1 << 12


def product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """(rows, N) = (rows, k) @ (k, N), in blocks of columns."""
    result = np.empty((len(matrix), columns.shape[1]))
    for block in blocks(columns.shape[1], COLUMNS_AT_ONCE):
        np.einsum("ij,jk->ik", matrix, columns[:, block], out=result[:, block])
    return result
