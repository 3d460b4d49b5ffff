# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit positions of a tree's vertices: recorded when leaves are approximated, or evaluated on demand.

The points of a bicubic quad are convex combinations of control points, like those of ``evaluation``, so the same
allowance covers rounding (``rounding.rounding_allowance``). Quads that share a vertex may differ by rounding; the
last position recorded counts.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..surface.evaluation import limit_values
from .rectangle_tree import NONE, RectangleTree


class VertexPositions:
    """The positions of a tree's vertices recorded so far, in the space of the mesh."""

    def __init__(self, tree: RectangleTree) -> None:
        self._tree = tree
        # Single numbers are written and read several times as fast as rows of three.
        self._coordinates = [tree.add_vertex_column(np.float64(np.nan)) for _ in range(3)]
        loose = np.flatnonzero(tree.mesh.vertex_face_counts == 0)
        self.put(loose, tree.mesh.positions[loose])

    def put(self, vertices: IndexArray, positions: FloatArray) -> None:
        """Record the positions (…, 3) of vertices (…)."""
        for axis, column in enumerate(self._coordinates):
            column.values[vertices] = positions[..., axis]

    def of(self, vertices: IndexArray) -> FloatArray:
        """(N, 3): the positions of vertices (N,)."""
        found = np.empty((len(vertices), 3))
        for axis, column in enumerate(self._coordinates):
            found[:, axis] = column.values[vertices]
        unknown = np.flatnonzero(np.isnan(found[:, 0]))
        if len(unknown):
            mesh, points = self._tree.mesh, self._tree.vertex_points(vertices[unknown])
            found[unknown] = limit_values(mesh, mesh.positions, points)
            self.put(vertices[unknown], found[unknown])
        return found

    def in_space_of(self, control_positions: FloatArray, vertices: IndexArray) -> FloatArray:
        """(N, 3): the positions of vertices (N,) in the space where the control vertices have positions (V, 3).
        Vertices without faces keep their positions."""
        mesh = self._tree.mesh
        if np.array_equal(control_positions, mesh.positions):
            return self.of(vertices)
        positions, points = np.empty((len(vertices), 3)), self._tree.vertex_points(vertices)
        is_loose = points.corners == NONE
        positions[is_loose] = control_positions[vertices[is_loose]]
        positions[~is_loose] = limit_values(mesh, control_positions, points.at(~is_loose))
        return positions
