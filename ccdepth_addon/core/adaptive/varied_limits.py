# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary, over the nodes of a tree: the least over the surface of each node (docs/tolerance.md)."""

from __future__ import annotations

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.types import FloatArray, IndexArray
from ..surface.surface_points import interpolate_linearly
from ..tolerance.variation import Variation
from ..tolerance.view import View, least_around
from .node_surfaces import NodeSurfaces
from .rectangle_tree import RectangleTree


def varied_limits(
    tree: RectangleTree, surfaces: NodeSurfaces, nodes: IndexArray, limit: float, variation: Variation
) -> FloatArray:
    """(n,): the largest distances allowed over nodes. limit: a length, or with views a number of pixels."""
    measures = [_least_measures(tree, surfaces, nodes, view) for view in variation.views]
    return variation.tolerances(limit * _least_factors(tree, nodes, variation.factors), measures)


def _least_factors(tree: RectangleTree, nodes: IndexArray, factors: FloatArray | None) -> FloatArray:
    """(n,): the least factors over nodes, by factors (C,) at the control mesh's corners."""
    if factors is None:
        return np.ones(len(nodes))
    mesh, logarithms = tree.mesh, np.log(factors)
    found = np.minimum.reduceat(logarithms, mesh.face_starts[:-1])[tree.base_faces[nodes]]
    is_quad = tree.is_quad(nodes)
    points = tree.points_at(nodes[is_quad], [(corner, False) for corner in range(4)])
    found[is_quad] = np.minimum.reduce([interpolate_linearly(mesh, logarithms[:, None], each)[:, 0] for each in points])
    return np.exp(found)


def _least_measures(tree: RectangleTree, surfaces: NodeSurfaces, nodes: IndexArray, view: View) -> FloatArray:
    """(11, n): the least measures of a view over hulls of the surface over nodes."""
    found, is_quad = np.empty((11, len(nodes))), tree.is_quad(nodes)
    is_bicubic = surfaces.are_bicubic(nodes)
    for own in index_chunks(np.flatnonzero(is_bicubic), AT_ONCE):
        found[:, own] = view.measures(surfaces.coefficients(nodes[own])).min(axis=1)
    for others in (np.flatnonzero(is_quad & ~is_bicubic), np.flatnonzero(~is_quad)):
        for places, refinement in surfaces.refinements(nodes[others]):
            measures = view.measures(refinement.mesh.positions)
            found[:, others[places]] = least_around(refinement.mesh, measures, len(places))
    return found
