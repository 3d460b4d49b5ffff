# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the vertices of a quadtree lie on the limit surface: each is found once, by whoever comes by first.

Whoever looks at a bicubic quad knows its points. These are convex combinations of control points like those of
``limit_surface``, so rounding is covered alike (``depth.rounding_allowance``).
"""

from __future__ import annotations

import numpy as np

from .limit_surface import limit_values
from .mesh import FloatArray, IndexArray
from .quadtree import Column, Quadtree


class VertexPositions:
    """Positions of a tree's vertices, as far as they are known by now, in the space of its mesh."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        self._positions = Column(np.zeros((0, 3)))

    def put(self, vertices: IndexArray, positions: FloatArray) -> None:
        """Vertices (…) lie at positions (…, 3)."""
        self._extend()
        self._positions.values[vertices] = positions

    def of(self, vertices: IndexArray) -> FloatArray:
        """(N, 3): where vertices (N,) lie, all of which have faces."""
        self._extend()
        found = self._positions.values[vertices]
        unknown = np.flatnonzero(np.isnan(found[:, 0]))
        if len(unknown):
            mesh, points = self._tree.mesh, self._tree.vertex_points(vertices[unknown])
            found[unknown] = limit_values(mesh, mesh.positions, points)
            self._positions.values[vertices[unknown]] = found[unknown]
        return found

    def make_room(self, count: int) -> None:
        """That so many more vertices take no more time than they have to, when they come some at a time."""
        self._positions.make_room(count)

    def _extend(self) -> None:
        """There are as many vertices as the tree has by now."""
        self._positions.extend(len(self._tree.vertex_edges) - len(self._positions.values), np.nan)
