# SPDX-License-Identifier: GPL-3.0-or-later
"""The store of cells by their nodes.

Nets are large, and most leaves are approximated only once. So the store keeps children of cells with nets only where
their parents' coefficients could not decide (``growth.approximate_new``), and makes the others again from their parents
on demand.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from ...arrays.types import BoolArray, IndexArray
from ...surface.stencils import Valences
from ..leaf_approximation import Cells
from ..quadtree import NONE, Quadtree
from .irregular_cells import RefinedCells
from .patch_cells import CELLS_AT_ONCE, BicubicCells, NetCells


class CellStore:
    """Cells in blocks; and for each node of a tree the block of its cell and its index there, if the node has one."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        self._blocks: list[Cells] = []
        self._numbers = tree.add_column(np.int32(NONE))
        self._places = tree.add_column(np.int32(NONE))

    def put(self, cells: Cells) -> None:
        """Keep cells: for their own nodes and, if they have nets, for their children."""
        self._numbers.values[cells.nodes] = len(self._blocks)
        self._places.values[cells.nodes] = np.arange(len(cells.nodes))
        self._blocks.append(cells)

    def keeps(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) of which it keeps the cells themselves: of all that have nets and have been split, for example."""
        return self._numbers.values[nodes] != NONE

    def of(self, nodes: IndexArray) -> Iterator[Cells]:
        """The cells of nodes. The store has to keep each, or its parent; of halves their parents."""
        is_half = nodes >= self._tree.first_half
        if np.any(is_half):
            yield from self._of_halves(nodes[is_half])
            nodes = nodes[~is_half]
        is_kept = self.keeps(nodes)
        yield from self._found(nodes[is_kept])
        children = nodes[~is_kept]
        if not len(children):
            return
        is_wanted = np.zeros(len(self._numbers.values), dtype=bool)
        is_wanted[children] = True
        for cells in self._found(np.unique(self._tree.parents[children])):
            assert isinstance(cells, NetCells)
            yield from cells.children(self._tree, is_wanted[self._tree.children_of_quads(cells.nodes)])

    def _of_halves(self, halves: IndexArray) -> Iterator[Cells]:
        tree = self._tree
        quads = tree.parents[halves]
        sides = tree.covered[halves - tree.first_half, 0] - tree.first_child[quads]
        for side in range(4):
            chosen = np.flatnonzero(sides == side)
            of_quads = halves[chosen[np.argsort(quads[chosen], kind="stable")]]
            for cells in self._found(np.sort(quads[chosen])):
                assert isinstance(cells, BicubicCells)
                places = np.searchsorted(tree.parents[of_quads], cells.nodes)
                yield cells.halves(side, of_quads[places])

    def _found(self, nodes: IndexArray) -> Iterator[Cells]:
        """The kept cells of nodes, block by block."""
        assert np.all(self._numbers.values[nodes] != NONE)
        nodes = nodes[np.argsort(self._numbers.values[nodes], kind="stable")]
        numbers, places = self._numbers.values[nodes], self._places.values[nodes]
        for start, end in pairwise([0, *(np.flatnonzero(np.diff(numbers)) + 1), len(nodes)]):
            if start < end:
                block = self._blocks[numbers[start]]
                yield block if end - start == len(block.nodes) else block.at(places[start:end])


def some(cells: Cells, wanted: BoolArray) -> list[Cells]:
    """The wanted cells, if there are any."""
    if np.all(wanted):
        return [cells]
    chosen = np.flatnonzero(wanted)
    return [cells.at(chosen)] if len(chosen) else []


def in_blocks(cells: Iterable[Cells]) -> Iterator[Cells]:
    """The same cells; those of quads in blocks of about ``CELLS_AT_ONCE`` of one kind, as nets are of one kind where
    valences are the same."""
    waiting: defaultdict[Valences | None, list[Any]] = defaultdict(list)
    counts = Counter[Valences | None]()
    for block in cells:
        if not isinstance(block, NetCells | RefinedCells):
            yield block
            continue
        kind = block.valences if isinstance(block, NetCells) else None
        waiting[kind].append(block)
        counts[kind] += len(block.nodes)
        if counts[kind] >= CELLS_AT_ONCE / 2:
            yield from _cut(_joined(waiting.pop(kind)))
            counts[kind] = 0
    for same in waiting.values():
        yield _joined(same)


def _joined(blocks: list[Any]) -> Any:
    return blocks[0] if len(blocks) == 1 else blocks[0].joined(blocks[1:])


def _cut(cells: Cells) -> Iterator[Cells]:
    """Cells in blocks of at most half as many again, or else about as many."""
    if len(cells.nodes) <= 1.5 * CELLS_AT_ONCE:
        yield cells
        return
    for chosen in np.array_split(np.arange(len(cells.nodes)), round(len(cells.nodes) / CELLS_AT_ONCE)):
        yield cells.at(chosen)
