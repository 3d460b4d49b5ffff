# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranges of numbers or entries, one after the other."""

from __future__ import annotations

import numpy as np

from .types import BoolArray, IndexArray


def ranges(starts: IndexArray, sizes: IndexArray) -> IndexArray:
    """(sum of sizes,) intp: from each start (N,) on as many numbers as its size (N,)."""
    first = starts - np.cumsum(sizes) + sizes
    return np.arange(int(sizes.sum())) + np.repeat(first, sizes)


def any_of_ranges(values: BoolArray, counts: IndexArray) -> BoolArray:
    """(N,) whether any value is true in each range: values (sum of counts,), range by range; counts: (N,), not 0."""
    if len(values) == 4 * len(counts) and np.all(counts == 4):
        first, second, third, fourth = values.reshape(-1, 4).T
        return first | second | third | fourth
    return np.logical_or.reduceat(values, np.cumsum(counts) - counts)
