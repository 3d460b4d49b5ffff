# SPDX-License-Identifier: GPL-3.0-or-later
"""Long arrays some entries at a time, so that what is made of them on the way stays small."""

from __future__ import annotations

from collections.abc import Iterator

from .mesh import IndexArray


def blocks(count: int, at_once: int) -> Iterator[slice]:
    """All of ``count`` entries, at most so many at once."""
    return (slice(start, start + at_once) for start in range(0, count, at_once))


def split(indices: IndexArray, at_once: int) -> Iterator[IndexArray]:
    """Indices in blocks of at most so many."""
    return (indices[block] for block in blocks(len(indices), at_once))
