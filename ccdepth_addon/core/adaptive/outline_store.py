# SPDX-License-Identifier: GPL-3.0-or-later
"""Outlines and hulls of leaves near the borders of flat parts, which are looked at again whenever the tree has changed.

Each is computed once for as long as the leaf is a leaf and its sides are split alike.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays.types import IndexArray
from .cells.cell_store import CellStore, in_blocks
from .leaf_bounds.leaf_distance import Hull, Outline
from .quadtree import Column, Quadtree


@dataclass(frozen=True)
class OutlineBlock:
    """n leaves with outlines of one shape. nodes: (n,); slots: (sides, n), those of their sides in the order of the
    outlines."""

    nodes: IndexArray
    slots: IndexArray
    outline: Outline
    hull: Hull

    def at(self, chosen: IndexArray) -> OutlineBlock:
        """Some of them, by index."""
        return OutlineBlock(self.nodes[chosen], self.slots[:, chosen], self.outline.at(chosen), self.hull.at(chosen))


class OutlineStore:
    """Blocks of outlines; and of each leaf in them, by a key made of its node and the number of its split sides, which
    never falls: the block and the index there, -1 where it has no outline."""

    def __init__(self, tree: Quadtree, cells: CellStore, split_sides: Column) -> None:
        """split_sides: (nodes,) the number of a leaf's split sides."""
        self._tree, self._cells, self._split_sides = tree, cells, split_sides
        # A quad has four sides, whatever the faces of the control mesh.
        self._most_sides = int(tree.mesh.face_sizes.max(initial=4))
        self._blocks: list[OutlineBlock] = []
        self._keys, self._numbers, self._places = np.zeros((3, 0), dtype=np.intp)

    def of(self, leaves: IndexArray, limit: float) -> Iterator[OutlineBlock]:
        """In blocks, those of some leaves that have outlines (``Cells.outlines``)."""
        keys = self._most_sides * leaves + np.minimum(self._split_sides.values[leaves], self._most_sides - 1)
        is_new = ~np.isin(keys, self._keys)
        if np.any(is_new):
            self._put(leaves[is_new], keys[is_new], limit)
        found = np.searchsorted(self._keys, keys)
        numbers, places = self._numbers[found], self._places[found]
        for number in np.unique(numbers[numbers >= 0]).tolist():
            yield self._blocks[number].at(places[numbers == number])

    def _put(self, leaves: IndexArray, keys: IndexArray, limit: float) -> None:
        """Compute and keep those of leaves."""
        tree = self._tree
        numbers, places = np.full((2, len(leaves)), -1)
        order = np.argsort(leaves)
        for cells in in_blocks(self._cells.of(leaves)):
            for chosen, turns, outline, hull in cells.outlines(tree.hanging(tree.slots(cells.nodes)), limit):
                nodes, size = cells.nodes[chosen], len(outline.corners)
                slots = tree.first_slots(nodes) + (np.arange(size)[:, None] + turns) % size
                own = order[np.searchsorted(leaves, nodes, sorter=order)]
                numbers[own], places[own] = len(self._blocks), np.arange(len(nodes))
                self._blocks.append(OutlineBlock(nodes, slots, outline, hull))
        keys, numbers, places = (
            np.concatenate(both) for both in ((self._keys, keys), (self._numbers, numbers), (self._places, places))
        )
        order = np.argsort(keys)
        self._keys, self._numbers, self._places = keys[order], numbers[order], places[order]
