# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary, over the nodes of a tree: the least over the surface of each node (docs/tolerance.md)."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..surface.surface_points import interpolate_linearly
from ..tolerance.variation import Variation
from .rectangle_tree import RectangleTree


def varied_limits(tree: RectangleTree, nodes: IndexArray, limit: float, variation: Variation) -> FloatArray:
    """(n,): the largest distances allowed over nodes. limit: for a factor of 1."""
    mesh, logarithms = tree.mesh, np.log(variation.factors)
    found = np.minimum.reduceat(logarithms, mesh.face_starts[:-1])[tree.base_faces[nodes]]
    is_quad = tree.is_quad(nodes)
    points = tree.points_at(nodes[is_quad], [(corner, False) for corner in range(4)])
    found[is_quad] = np.minimum.reduce([interpolate_linearly(mesh, logarithms[:, None], each)[:, 0] for each in points])
    limits: FloatArray = limit * np.exp(found)
    return limits
