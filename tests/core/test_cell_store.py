# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells found by their nodes: by brute force."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ccdepth_addon.core.cell_store import CellStore
from ccdepth_addon.core.fits import Cells
from ccdepth_addon.core.net_cells import BicubicCells, ExtraordinaryCells, NetCells


def cells(nodes: Iterable[int], valence: int) -> NetCells:
    """With nets that tell their nodes."""
    numbers = np.array([*nodes], dtype=np.intp)
    nets = np.broadcast_to(numbers[None, :, None], (2 * valence + 8, len(numbers), 3)).astype(np.float64)
    kind = BicubicCells if valence == 4 else ExtraordinaryCells
    return kind(numbers, np.zeros_like(numbers), nets)


def nodes_of(found: Iterable[Cells]) -> list[int]:
    nodes: list[int] = []
    for block in found:
        assert isinstance(block, NetCells)
        np.testing.assert_array_equal(block.nets, cells(block.nodes, (len(block.nets) - 8) // 2).nets)
        nodes += block.nodes.tolist()
    return sorted(nodes)


def test_cells_are_found_by_their_nodes_until_they_are_taken() -> None:
    generator = np.random.default_rng(3)
    store, kept = CellStore(), set[int]()
    for turn in range(40):
        first = 50 * turn
        store.extend(first + 50)
        order = first + generator.permutation(40)
        store.put(cells(order[:25], 4), np.ones(25, dtype=bool))
        wanted = generator.random(15) < turn / 40
        store.put(cells(order[25:], 5), wanted)
        order = np.concatenate([order[:25], order[25:][wanted]])
        kept |= {*order.tolist()}
        asked = generator.choice(first + 50, (first + 50) // 3, replace=False)
        there = sorted(kept & {*asked.tolist()})
        assert nodes_of(store.of(asked)) == there
        assert nodes_of(store.take(asked)) == there
        assert nodes_of(store.of(asked)) == []
        kept -= {*there}
    assert nodes_of(store.of(np.arange(2000))) == sorted(kept)
    assert nodes_of(store.of(np.arange(0))) == []
