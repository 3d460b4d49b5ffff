# SPDX-License-Identifier: GPL-3.0-or-later
"""The rings of leaves around leaves. Each ring shares a vertex with the leaves inside."""

from __future__ import annotations

import numpy as np

from ..arrays.ranges import any_of_ranges
from ..arrays.types import BoolArray, FloatArray, IndexArray
from .rectangle_tree import NONE, RectangleTree


def largest_around(tree: RectangleTree, leaves: IndexArray, values: FloatArray) -> FloatArray:
    """(n,): for each leaf the largest of the values (n,) over all given leaves that share a vertex."""
    slots, counts = tree.slots(leaves), tree.slot_counts(leaves)
    # Whole sides have no middle: the values written there are never read.
    vertices = np.concatenate([tree.slot_vertices[slots], tree.midpoints[tree.slot_edges[slots]]])
    at_vertices = np.full(len(tree.vertex_edges) + 1, -np.inf)
    np.maximum.at(at_vertices, vertices, np.tile(np.repeat(values, counts), 2))
    at_vertices[NONE] = -np.inf
    starts = np.cumsum(counts) - counts
    found: FloatArray = np.maximum(*(np.maximum.reduceat(at_vertices[each], starts) for each in np.split(vertices, 2)))
    return found


def with_rings(tree: RectangleTree, leaves: IndexArray, rings: int) -> IndexArray:
    """Leaves and a number of rings of leaves around them, in ascending order."""
    for _ in range(rings):
        if len(leaves):
            around = np.flatnonzero(_faces_around(tree, leaves).take(tree.base_faces) & (tree.first_child == NONE))
            leaves = around[tree.share_a_vertex(around, leaves)]
    return leaves


def _faces_around(tree: RectangleTree, nodes: IndexArray) -> BoolArray:
    """(control faces,) bool: whether a control face shares a vertex with a face of the nodes. Every node that shares a
    vertex with the given nodes lies on such a face."""
    mesh = tree.mesh
    marked = np.zeros(mesh.face_count, dtype=bool)
    marked[tree.base_faces[nodes]] = True
    at_vertices = np.zeros(mesh.vertex_count, dtype=bool)
    at_vertices[mesh.corner_vertices[marked.take(mesh.corner_faces)]] = True
    return any_of_ranges(at_vertices.take(mesh.corner_vertices), mesh.face_sizes)
