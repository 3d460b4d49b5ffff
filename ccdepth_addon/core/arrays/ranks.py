# SPDX-License-Identifier: GPL-3.0-or-later
"""Ranks among equal entries."""

from __future__ import annotations

import numpy as np

from .types import IndexArray


def ranks_among_equal(indices: IndexArray) -> IndexArray:
    """(N,) intp: for each entry of indices (N,), none negative, how many equal ones come before it."""
    order = np.argsort(indices, kind="stable")
    numbers = np.bincount(indices)
    ranks = np.empty(len(indices), dtype=np.intp)
    ranks[order] = np.arange(len(indices)) - np.repeat(np.cumsum(numbers) - numbers, numbers)
    return ranks
