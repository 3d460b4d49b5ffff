# SPDX-License-Identifier: GPL-3.0-or-later
"""The last approximation of each node of a quadtree."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from .leaf_approximation import LeafApproximation
from .quadtree import NONE, Quadtree


class ApproximationStore:
    """The ``LeafApproximation`` of each node of a tree, and bounds along the surface."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        nothing = LeafApproximation.none(1)
        names = [field.name for field in fields(LeafApproximation)]
        self._columns = {name: tree.add_column(getattr(nothing, name)[0]) for name in names}
        self._along = tree.add_column(np.float64(np.inf))

    least = property(lambda self: self._columns["least"].values)

    def put(self, nodes: IndexArray, approximation: LeafApproximation) -> None:
        """Replace the approximation of nodes, each once, and discard their bounds along the surface."""
        for name, column in self._columns.items():
            column.values[nodes] = getattr(approximation, name)
        self._along.values[nodes] = np.inf

    def alone(self, nodes: IndexArray) -> LeafApproximation:
        """The approximation of nodes, without bounds along the surface."""
        return LeafApproximation(**{name: column.values.take(nodes) for name, column in self._columns.items()})

    def of(self, nodes: IndexArray) -> LeafApproximation:
        """The same, with bounds along the surface where there are no others."""
        found = self.alone(nodes)
        return replace(found, bounds=np.where(np.isinf(found.bounds), self.along(nodes), found.bounds))

    def unbounded(self) -> IndexArray:
        """The leaves accepted without a bound at equal parameters, in ascending order."""
        columns = self._columns
        is_unbounded = columns["accepted"].values & np.isinf(columns["bounds"].values)
        return np.flatnonzero(is_unbounded & (self._tree.first_child == NONE))

    def along(self, nodes: IndexArray) -> FloatArray:
        """(nodes,): their bounds along the surface; inf where there is none."""
        found: FloatArray = self._along.values[nodes]
        return found

    def put_along(self, nodes: IndexArray, bounds: FloatArray) -> None:
        """Record bounds along the surface of nodes (n,)."""
        self._along.values[nodes] = bounds
