# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products on the calling thread, the same for a column whatever stands beside it.

The libraries behind numpy's own products differ between Blender versions. Some spread a large product over threads of
their own, which compete with those of ``threads``, and split it by the number of processors; some are slow. ``einsum``
does neither, and is as fast as the fast ones for matrices of the sizes used here.
"""

from __future__ import annotations

import numpy as np

from .chunks import chunks
from .types import FloatArray

# So many columns of a row stay in the processor's cache while they are summed.
COLUMNS_AT_ONCE = 1 << 12


def matrix_product(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """(rows, N) = (rows, k) @ (k, N), in chunks of columns."""
    result = np.empty((len(matrix), columns.shape[1]))
    for chunk in chunks(columns.shape[1], COLUMNS_AT_ONCE):
        np.einsum("ij,jk->ik", matrix, columns[:, chunk], out=result[:, chunk])
    return result
