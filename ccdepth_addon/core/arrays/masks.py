# SPDX-License-Identifier: GPL-3.0-or-later
"""Chosen entries as masks."""

from __future__ import annotations

import numpy as np

from .types import BoolArray, IndexArray


def mask(count: int, chosen: IndexArray | BoolArray) -> BoolArray:
    """(count,) bool: the chosen ones."""
    found = np.zeros(count, dtype=bool)
    found[chosen] = True
    return found
