# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranges of numbers, one after the other."""

from __future__ import annotations

import numpy as np

from .types import IndexArray


def ranges(starts: IndexArray, sizes: IndexArray) -> IndexArray:
    """(sum of sizes,) intp: from each start (N,) on as many numbers as its size (N,)."""
    first = starts - np.cumsum(sizes) + sizes
    return np.arange(int(sizes.sum())) + np.repeat(first, sizes)
