# SPDX-License-Identifier: GPL-3.0-or-later
"""The rings of leaves around leaves. Each ring shares a vertex with the leaves inside."""

from __future__ import annotations

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import FloatArray, IndexArray
from ..mesh.submesh import rings_around
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
            # Every leaf that shares a vertex with the given leaves lies on such a face.
            faces = rings_around(tree.mesh, mask(tree.mesh.face_count, tree.base_faces[leaves]), 1)
            around = np.flatnonzero(faces.take(tree.base_faces) & (tree.first_child == NONE))
            leaves = around[tree.share_a_vertex(around, leaves)]
    return leaves
