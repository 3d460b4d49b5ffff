# SPDX-License-Identifier: GPL-3.0-or-later
"""The last approximation of each node of a quadtree.

Most leaves are within the limit at equal parameters. Error bounds along normals and across them, and star bounds, are
kept only for the others and the leaves around these.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from .leaf_approximation import LeafApproximation
from .leaf_bounds.triangle_bounds import ErrorBounds
from .quadtree import NONE, Column, Quadtree

OF_ALL_NODES = ("accepted", "bounds", "alone", "patterns", "alternatives", "turns", "folded", "thickness", "least")


class ApproximationStore:
    """The ``LeafApproximation`` of each node of a tree, and star bounds, which take the neighbours into account."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        nothing = LeafApproximation.none(1)
        self._columns = {name: tree.add_column(getattr(nothing, name)[0]) for name in OF_ALL_NODES}
        # The entry of a node in the columns along the surface, or NONE; and the node of each entry.
        self._entries = tree.add_column(np.int32(NONE))
        self._nodes = Column(np.zeros(0, dtype=np.intp))
        self._normal, self._tangential, self._star_bounds = (Column(np.zeros(0)) for _ in range(3))

    least = property(lambda self: self._columns["least"].values)
    thickness = property(lambda self: self._columns["thickness"].values)

    def put(self, nodes: IndexArray, approximation: LeafApproximation) -> None:
        """Replace the approximation of nodes, each once, and discard their star bounds."""
        for name, column in self._columns.items():
            column.values[nodes] = getattr(approximation, name)
        self._entries.values[nodes] = NONE
        chosen = np.flatnonzero(approximation.accepted & np.isinf(approximation.bounds))
        self._append(nodes[chosen], approximation.normal[chosen], approximation.tangential[chosen])

    def without_neighbours(self, nodes: IndexArray) -> LeafApproximation:
        """The approximation of nodes, without star bounds; ``normal``, ``tangential`` and ``least`` have their
        defaults."""
        nothing = LeafApproximation.none(1)
        stored = {name: self._columns[name].values.take(nodes) for name in OF_ALL_NODES[:-1]}
        rest = {name: np.broadcast_to(getattr(nothing, name), len(nodes)) for name in ("normal", "tangential", "least")}
        return LeafApproximation(**stored, **rest)

    def without_star_bounds(self, nodes: IndexArray) -> LeafApproximation:
        """The same, with the error bounds that there are."""
        normal, tangential = self.error_bounds(nodes)
        return replace(self.without_neighbours(nodes), normal=normal, tangential=tangential)

    def of(self, nodes: IndexArray) -> LeafApproximation:
        """The same, with star bounds where there are no others."""
        approximation = self.without_neighbours(nodes)
        unbounded = np.flatnonzero(np.isinf(approximation.bounds))
        unbounded = unbounded[self._entries.values[nodes[unbounded]] != NONE]
        approximation.bounds[unbounded] = self.star_bounds(nodes[unbounded])
        return approximation

    def unbounded(self) -> IndexArray:
        """The leaves accepted without a bound of their own, in ascending order."""
        nodes = self._nodes.values
        is_last = self._entries.values[nodes] == np.arange(len(nodes))
        nodes = nodes[is_last & (self._tree.first_child[nodes] == NONE)]
        return np.sort(nodes[np.isinf(self._columns["bounds"].values[nodes])])

    def error_bounds(self, nodes: IndexArray) -> tuple[FloatArray, FloatArray]:
        """(nodes,) twice: error bounds along the normals and across; inf where there are none."""
        entries = self._entries.values[nodes]
        stored = np.flatnonzero(entries != NONE)
        normal, tangential = np.full((2, len(nodes)), np.inf)
        normal[stored], tangential[stored] = (
            column.values.take(entries[stored]) for column in (self._normal, self._tangential)
        )
        return normal, tangential

    def put_error_bounds(self, nodes: IndexArray, error_bounds: ErrorBounds) -> None:
        """Record error bounds of nodes; none is above the node's bound at equal parameters, if it has one."""
        bounds = np.where(self._columns["alone"].values[nodes], np.inf, self._columns["bounds"].values[nodes])
        normal, tangential = np.minimum(error_bounds.normal, bounds), np.minimum(error_bounds.tangential, bounds)
        entries = self._entries.values[nodes]
        stored = np.flatnonzero(entries != NONE)
        self._normal.values[entries[stored]] = normal[stored]
        self._tangential.values[entries[stored]] = tangential[stored]
        new = np.flatnonzero(entries == NONE)
        self._append(nodes[new], normal[new], tangential[new])

    def star_bounds(self, nodes: IndexArray) -> FloatArray:
        """(nodes,): the star bounds of nodes with error bounds; inf where there is none."""
        return self._star_bounds.values[self._entries.values[nodes]]

    def put_star_bounds(self, nodes: IndexArray, drawn: IndexArray, bounds: FloatArray) -> None:
        """Record star bounds of nodes, from those of their triangles: (T,) the node of each, and its bound. A node
        without triangles has none."""
        entries, largest = self._entries.values[drawn], self._star_bounds.values
        largest[self._entries.values[nodes]] = np.inf
        largest[entries] = 0.0
        np.maximum.at(largest, entries, bounds)

    def _append(self, nodes: IndexArray, normal: FloatArray, tangential: FloatArray) -> None:
        self._entries.values[nodes] = len(self._nodes.values) + np.arange(len(nodes))
        for column, values in ((self._nodes, nodes), (self._normal, normal), (self._tangential, tangential)):
            column.append(values)
        self._star_bounds.extend(len(nodes), np.inf)
