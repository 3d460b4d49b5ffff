# SPDX-License-Identifier: GPL-3.0-or-later
"""Long arrays in chunks, so that temporary arrays stay small."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

# Faces, points or indices worked through at a time: few enough for the processor's caches and for frequent progress,
# enough to hide the interpreter's overhead.
AT_ONCE = 1 << 13

# The number of entries of many numbers each: faces refined with their neighbours, pieces compared with many others.
FEW_AT_ONCE = 1 << 11


def chunks(count: int, size: int) -> Iterator[slice]:
    """Slices that cover 0 … count - 1 in order, each of at most ``size`` entries."""
    return (slice(start, start + size) for start in range(0, count, size))


def index_chunks(indices: NDArray[np.intp], size: int) -> Iterator[NDArray[np.intp]]:
    """The indices in order, at most ``size`` at a time."""
    return (indices[chunk] for chunk in chunks(len(indices), size))
