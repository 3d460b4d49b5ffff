# SPDX-License-Identifier: GPL-3.0-or-later
"""The second phase of a plan: balance between neighbours, and transitions where sides are split."""

from __future__ import annotations

from ..arrays.types import IndexArray
from .cells.cell_store import in_blocks
from .plan import Plan

# A balanced tree has, beside a split quad, its four children and at most two leaves along each side.
LEAVES_BESIDE = 12


def unbalanced(plan: Plan) -> IndexArray:
    """The leaves beside others more than one level deeper, or with all their sides split."""
    split = plan.split_nodes.take()
    if not len(split):
        return split
    tree = plan.tree
    # All leaves, if these are not many more than those beside.
    leaves = tree.leaves() if LEAVES_BESIDE * len(split) >= tree.leaf_count else tree.leaves_beside(split)
    plan.beside_split.put(leaves)
    counts, wanted = tree.sides(leaves)
    wanted |= counts == tree.slot_counts(leaves)
    return leaves[wanted]


def approximate_split_sides(plan: Plan) -> IndexArray:
    """Approximate anew the leaves with more split sides than before. Returns those that exceed the limit."""
    tree, leaves = plan.tree, plan.beside_split.take_leaves()
    counts, _ = tree.sides(leaves)
    more = counts != plan.split_sides.values[leaves]
    pending = leaves[more]
    plan.split_sides.values[pending] = counts[more]
    for cells in in_blocks(plan.cells.of(pending)):
        plan.record(cells.nodes, plan.approximate(cells, tree.hanging(tree.slots(cells.nodes))))
        plan.report()
    return pending[~plan.approximations.alone(pending).accepted]
