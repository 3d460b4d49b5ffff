# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary, over the nodes of a tree: the least over the surface of each node (docs/tolerance.md)."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..surface.surface_points import interpolate_linearly
from ..tolerance.variation import Variation
from .node_surfaces import NodeSurfaces
from .rectangle_tree import RectangleTree

# Pixels whose lengths differ by no more than this part over a node are not measured again over its descendants.
ALIKE = 0.05


class VariedLimits:
    """The largest distances allowed over nodes. Columns hold for each node: the least length of a pixel, and the
    greatest one, or those of an ancestor with lengths alike."""

    def __init__(self, tree: RectangleTree, surfaces: NodeSurfaces, limit: float, variation: Variation) -> None:
        """limit: for a factor of 1."""
        self._tree, self._surfaces, self._limit, self._variation = tree, surfaces, limit, variation
        self._logarithms = np.log(variation.factors)
        self._least, self._greatest = tree.add_column(np.float64(1.0)), tree.add_column(np.float64(np.inf))

    def inherit(self, parents: IndexArray, children: IndexArray) -> None:
        """Give children (n,) the lengths of their parents (n,)."""
        for column in (self._least, self._greatest):
            column.values[children] = column.values[parents]

    def of(self, nodes: IndexArray) -> FloatArray:
        """(n,): the limits of nodes."""
        tree, mesh = self._tree, self._tree.mesh
        found = np.minimum.reduceat(self._logarithms, mesh.face_starts[:-1])[tree.base_faces[nodes]]
        is_quad, corners = tree.is_quad(nodes), [(corner, False) for corner in range(4)]
        points = tree.points_at(nodes[is_quad], corners)
        of_corners = [interpolate_linearly(mesh, self._logarithms[:, None], each)[:, 0] for each in points]
        found[is_quad] = np.minimum.reduce(of_corners)
        limits: FloatArray = self._limit * np.exp(found) * self._pixels(nodes)
        return limits

    def _pixels(self, nodes: IndexArray) -> FloatArray:
        """(n,): the least lengths of a pixel over nodes, in parts of the unit."""
        least, greatest, pixels = self._least.values, self._greatest.values, self._variation.pixels
        if pixels is not None:
            wanted = nodes[greatest[nodes] > (1 + ALIKE) * least[nodes]]
            least[wanted], greatest[wanted] = pixels.extremes(*self._surfaces.boxes(wanted))
        return least[nodes]
