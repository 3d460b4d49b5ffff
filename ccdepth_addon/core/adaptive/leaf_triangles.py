# SPDX-License-Identifier: GPL-3.0-or-later
"""The drawn triangles of a tree's leaves, joined at their sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..distance.shells import JoinedTriangles
from ..mesh.submesh import compact
from .leaf_approximation import LeafApproximation
from .plan import Plan
from .rectangle_tree import NONE
from .templates import (
    COUNTS_OF_TRIANGLE,
    TRIANGLE_COUNTS,
    TRIANGLES,
    TRIANGLES_OF_TRIANGLE,
    template_numbers,
)


@dataclass(frozen=True)
class LeafTriangles:
    """M triangles of L leaves, leaf by leaf. A quad, or a triangle of the control mesh, has the triangles of its
    template, in template order; a polygon has triangles around the mean of its corners, side by side.

    used: (U,) vertices of the tree, ascending, and from ``vertex_count`` on means of leaves. vertices: (M, 3) indices
    into ``used``; leaves: (M,) the leaf of each triangle; firsts: (L + 1,) the first triangle of each leaf. means: (U',
    3), the positions of the means.
    """

    used: IndexArray
    vertices: IndexArray
    leaves: IndexArray
    firsts: IndexArray
    means: FloatArray

    @staticmethod
    def of(plan: Plan, leaves: IndexArray, approximation: LeafApproximation) -> LeafTriangles:
        """The triangles of leaves (L,) with an approximation."""
        tree, sizes = plan.tree, plan.tree.slot_counts(leaves)
        is_quad = tree.is_quad(leaves)
        found, owners, numbers = [np.zeros((0, 3), dtype=np.intp)], [np.zeros(0, dtype=np.intp)], [np.zeros(0, int)]

        def put(chosen: IndexArray, vertices: IndexArray, number: int) -> None:
            found.append(vertices.astype(np.intp))
            owners.append(chosen)
            numbers.append(np.full(len(chosen), number))

        for size, some in ((4, is_quad), (3, sizes == 3)):
            chosen = np.flatnonzero(some)
            slots = tree.slots(leaves[chosen]).reshape(-1, size)
            of_leaves = approximation.patterns[chosen].astype(np.intp)
            table, counts = TRIANGLES_OF_TRIANGLE, COUNTS_OF_TRIANGLE
            if size == 4:
                of_leaves = template_numbers(approximation.patterns[chosen], approximation.alternatives[chosen])
                table, counts = TRIANGLES, TRIANGLE_COUNTS
            points = np.concatenate([tree.slot_vertices[slots], tree.midpoints[tree.slot_edges[slots]]], axis=1)
            for number in range(table.shape[1]):
                drawn = np.flatnonzero(number < counts[of_leaves])
                put(chosen[drawn], np.take_along_axis(points[drawn], table[of_leaves[drawn], number], axis=1), number)
        polygons, count = np.flatnonzero(sizes > 4), len(tree.vertex_edges)
        for size in np.unique(sizes[polygons]).tolist():
            chosen = polygons[sizes[polygons] == size]
            slots = tree.slots(leaves[chosen]).reshape(-1, size)
            corners, middles = tree.slot_vertices[slots], tree.midpoints[tree.slot_edges[slots]]
            for side in range(size):
                start, end, middle = corners[:, side], corners[:, (side + 1) % size], middles[:, side]
                split = middle != NONE
                put(chosen, np.stack([count + chosen, start, np.where(split, middle, end)], axis=1), 2 * side)
                ends = np.stack([count + chosen, middle, end], axis=1)
                put(chosen[split], ends[split], 2 * side + 1)
        of_triangles = np.concatenate(owners)
        order = np.lexsort((np.concatenate(numbers), of_triangles))
        vertices, of_triangles = np.concatenate(found)[order], of_triangles[order]
        used = compact(vertices, count + len(leaves))
        firsts = np.searchsorted(of_triangles, np.arange(len(leaves) + 1))
        means = _means_of_corners(plan, leaves[used[used >= count] - count])
        return LeafTriangles(used, vertices, of_triangles, firsts, means)

    def corners(self, plan: Plan) -> FloatArray:
        """(M, 3, 3)."""
        of_tree = self.used[: len(self.used) - len(self.means)]
        found: FloatArray = np.concatenate([plan.positions.of(of_tree), self.means])[self.vertices]
        return found

    def joined(self, plan: Plan) -> JoinedTriangles:
        """The triangles with the mean normals as vectors at the vertices."""
        return JoinedTriangles.of(self.corners(plan), self.vertices)


def _means_of_corners(plan: Plan, leaves: IndexArray) -> FloatArray:
    """(n, 3): the means of the corners of leaves."""
    if not len(leaves):
        return np.zeros((0, 3))
    slots, counts = plan.tree.slots(leaves), plan.tree.slot_counts(leaves)
    corners = plan.positions.of(plan.tree.slot_vertices[slots])
    found: FloatArray = np.add.reduceat(corners, np.cumsum(counts) - counts) / counts[:, None]
    return found
