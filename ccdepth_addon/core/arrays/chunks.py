# SPDX-License-Identifier: GPL-3.0-or-later
"""Long arrays some entries at a time, so that what is made of them on the way stays small."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

# So many values are taken at once.
VALUES_AT_ONCE = 1 << 13


def blocks(count: int, at_once: int) -> Iterator[slice]:
    """All of ``count`` entries, at most so many at once."""
    return (slice(start, start + at_once) for start in range(0, count, at_once))


def split(indices: NDArray[np.intp], at_once: int) -> Iterator[NDArray[np.intp]]:
    """Indices in blocks of at most so many."""
    return (indices[block] for block in blocks(len(indices), at_once))


def taken(values: NDArray[Any], indices: NDArray[Any]) -> NDArray[Any]:
    """(N,): ``values[indices]``, without an array of as many long integers on the way."""
    found = np.empty(len(indices), dtype=values.dtype)
    for block in blocks(len(indices), VALUES_AT_ONCE):
        found[block] = values.take(indices[block])
    return found
