# SPDX-License-Identifier: GPL-3.0-or-later
"""Chunks cover every entry once, in order, and are no longer than they may be."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.arrays.chunks import chunks, index_chunks


@pytest.mark.parametrize(("count", "size"), [(0, 3), (1, 3), (3, 3), (7, 3), (9, 1)])
def test_chunks_cover_everything_once(count: int, size: int) -> None:
    entries = [*range(count)]
    parts = [entries[chunk] for chunk in chunks(count, size)]
    assert [entry for part in parts for entry in part] == entries
    assert all(0 < len(part) <= size for part in parts)


def test_index_chunks_keep_the_order() -> None:
    indices = np.array([5, 2, 9, 9, 0])
    assert [part.tolist() for part in index_chunks(indices, 2)] == [[5, 2], [9, 9], [0]]
