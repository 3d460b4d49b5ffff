# SPDX-License-Identifier: GPL-3.0-or-later
"""Balance between neighbours: the leaves to split because of the splits of their sides."""

from __future__ import annotations

import numpy as np

from ..arrays.ranges import any_of_ranges
from ..arrays.types import BoolArray, IndexArray
from .plan import Plan
from .rectangle_tree import ALONG_U, ALONG_V, NONE, QUARTERS


def unbalanced(plan: Plan) -> tuple[IndexArray, IndexArray]:
    """The leaves that violate 2:1 balance or make fewer faces when split, and how to split them: leaves with half a
    side split again, leaves with all sides split, and bicubic quads with two opposite sides split (otherwise four
    triangles)."""
    tree, leaves = plan.tree, plan.take_beside_split()
    is_quad = tree.is_quad(leaves)
    quads, others = leaves[is_quad], leaves[~is_quad]
    slots = tree.quad_slots(quads)
    are_split, are_deeper = tree.hanging(slots), tree.hanging_twice(slots)
    along_u, along_v = (
        are_deeper[:, sides].any(axis=1) | are_split[:, sides].all(axis=1) for sides in ([0, 2], [1, 3])
    )
    ways = np.select([along_u & along_v, along_u, along_v], [QUARTERS, ALONG_U, ALONG_V])
    wanted = along_u | along_v
    is_whole = ~plan.surfaces.are_bicubic(quads) | (not plan.request.may_halve)
    wanted[is_whole] = (are_split.all(axis=1) | are_deeper.any(axis=1))[is_whole]
    ways[is_whole] = QUARTERS
    slots, counts = tree.slots(others), tree.slot_counts(others)
    if len(others):
        chosen = ~any_of_ranges(~tree.hanging(slots), counts) | any_of_ranges(tree.hanging_twice(slots), counts)
        others = others[chosen]
    return np.concatenate([quads[wanted], others]), np.append(ways[wanted], np.full(len(others), QUARTERS))


def cheaper_split(plan: Plan) -> tuple[IndexArray, IndexArray]:
    """The bicubic leaves of a balanced tree that make fewer faces when split, and how to split them.

    A quad with one split side makes three triangles; with the opposite side split as well, two quads. The splits pay
    off when the chain of quads ends at a border, or at the split side of a second or third leaf.
    """
    tree = plan.tree
    quads = tree.leaves() if plan.request.may_halve else np.zeros(0, dtype=np.intp)
    quads = quads[plan.surfaces.are_bicubic(quads)]
    edges = tree.slot_edges[tree.quad_slots(quads)]
    are_split, are_border = tree.edge_children[edges] != NONE, plan.are_border(edges)
    # The number of leaves that would pass a split on to a whole side.
    wanted = are_split[:, [2, 3, 0, 1]] & ~are_split
    counts = np.bincount(edges[wanted], minlength=len(tree.edge_vertices))[edges]
    ends = are_split | (counts > wanted)
    along = [(ends[:, side] & ends[:, side + 2]) | _ends_at_border(are_split, are_border, side) for side in (0, 1)]
    along = [each & ~(are_split[:, side] & are_split[:, side + 2]) for side, each in enumerate(along)]
    ways = np.select([along[0] & along[1], along[0]], [QUARTERS, ALONG_U], ALONG_V)
    chosen = along[0] | along[1]
    return quads[chosen], ways[chosen]


def _ends_at_border(are_split: BoolArray, are_border: BoolArray, side: int) -> BoolArray:
    found: BoolArray = (are_split[:, side] & are_border[:, side + 2]) | (are_split[:, side + 2] & are_border[:, side])
    return found
