# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the cells of leaves are kept: in blocks, and to be found by their nodes."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .fits import Cells
from .mesh import IndexArray
from .net_cells import CELLS_AT_ONCE, NetCells
from .quadtree import NONE, Column

# Where less than this part of a block is wanted it is copied without the rest.
LEAST_PART = 0.75

# Cells of one kind have nets of as many points.
Kind = tuple[type[NetCells], int]


class CellStore:
    """Cells in blocks as they came; and for each node of a tree the block and the place of its cell, if it has one."""

    def __init__(self) -> None:
        self._blocks: list[Cells | None] = []
        self._left: list[int] = []
        self._numbers = Column(np.zeros(0, dtype=np.int32))
        self._places = Column(np.zeros(0, dtype=np.int32))

    def extend(self, count: int) -> None:
        """There are so many nodes by now."""
        more = count - len(self._numbers.values)
        self._numbers.extend(more, NONE)
        self._places.extend(more, NONE)

    def put(self, cells: Cells, wanted: NDArray[np.bool_]) -> None:
        """Keep the wanted of some cells, whose nodes have none here."""
        places = np.flatnonzero(wanted)
        if not len(places):
            return
        self._numbers.values[cells.nodes[places]] = len(self._blocks)
        self._places.values[cells.nodes[places]] = places
        self._blocks.append(cells)
        self._left.append(len(places))

    def of(self, nodes: IndexArray) -> Iterator[Cells]:
        """The cells of those nodes that have some, block by block."""
        for _, cells in self._found(nodes):
            yield cells

    def take(self, nodes: IndexArray) -> Iterator[Cells]:
        """The same, which are not kept any longer."""
        for number, cells in self._found(nodes):
            self._numbers.values[cells.nodes] = NONE
            self._left[number] -= len(cells.nodes)
            self._tidy(number)
            yield cells

    def _found(self, nodes: IndexArray) -> Iterator[tuple[int, Cells]]:
        """For each block that has cells of these nodes: its number, and these cells."""
        nodes = nodes[self._numbers.values[nodes] != NONE]
        if not len(nodes):
            return
        nodes = nodes[np.argsort(self._numbers.values[nodes], kind="stable")]
        numbers, places = self._numbers.values[nodes], self._places.values[nodes]
        for start, end in pairwise([0, *(np.flatnonzero(np.diff(numbers)) + 1), len(nodes)]):
            block = self._blocks[numbers[start]]
            assert block is not None
            whole = end - start == len(block.nodes)
            yield int(numbers[start]), block if whole else block.at(places[start:end])

    def _tidy(self, number: int) -> None:
        """Give back the memory of a block that is used no more, or for the most part."""
        block, left = self._blocks[number], self._left[number]
        if block is None or left >= LEAST_PART * len(block.nodes):
            return
        self._blocks[number] = None
        if left:
            self.put(*trimmed(block, self._numbers.values[block.nodes] == number))


def some(cells: Cells, wanted: NDArray[np.bool_]) -> list[Cells]:
    """The wanted cells, if there are any."""
    if np.all(wanted):
        return [cells]
    chosen = np.flatnonzero(wanted)
    return [cells.at(chosen)] if len(chosen) else []


def trimmed(cells: Cells, wanted: NDArray[np.bool_]) -> tuple[Cells, NDArray[np.bool_]]:
    """The wanted cells alone, where they are less than a good part of all, and which are wanted then."""
    places = np.flatnonzero(wanted)
    if len(places) >= LEAST_PART * len(wanted):
        return cells, wanted
    return cells.at(places), np.ones(len(places), dtype=bool)


def in_blocks(cells: Iterable[Cells], at_once: int = CELLS_AT_ONCE) -> Iterator[Cells]:
    """The same cells; those with nets in blocks of about so many of one kind."""
    waiting: defaultdict[Kind, list[NetCells]] = defaultdict(list)
    counts = Counter[Kind]()
    for block in cells:
        if not isinstance(block, NetCells):
            yield block
            continue
        kind = type(block), len(block.nets)
        waiting[kind].append(block)
        counts[kind] += len(block.nodes)
        if counts[kind] >= at_once / 2:
            yield from _cut(_joined(waiting.pop(kind)), at_once)
            counts[kind] = 0
    for same in waiting.values():
        yield _joined(same)


def _joined(blocks: list[NetCells]) -> NetCells:
    return blocks[0] if len(blocks) == 1 else type(blocks[0]).joined(blocks)


def _cut(cells: NetCells, at_once: int) -> Iterator[NetCells]:
    """Cells in blocks of at most half as many again, or else about as many."""
    if len(cells.nodes) <= 1.5 * at_once:
        yield cells
        return
    for chosen in np.array_split(np.arange(len(cells.nodes)), round(len(cells.nodes) / at_once)):
        yield cells.at(chosen)
