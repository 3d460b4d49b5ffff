# SPDX-License-Identifier: GPL-3.0-or-later
"""The second phase of a plan: balance between neighbours, and transitions where sides are split."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..arrays.types import IndexArray
from .cells.cell_store import in_blocks
from .plan import Plan

# Beside a quad that is split lie its own quarters and at most two leaves along each side, as soon as there is balance.
LEAVES_BESIDE = 12

# No face has fewer.
FEWEST_SIDES = 3


def unbalanced(plan: Plan) -> IndexArray:
    """The leaves beside others more than one level deeper, or with all their sides split."""
    split = plan.split_nodes.take()
    if not len(split):
        return split
    tree = plan.tree
    # All of them, if there are not many more than those beside.
    leaves = tree.leaves() if LEAVES_BESIDE * len(split) >= tree.leaf_count else tree.leaves_beside(split)
    plan.beside_split.put(leaves)
    counts, wanted = tree.sides(leaves)
    possible = np.flatnonzero(counts >= FEWEST_SIDES)
    wanted[possible] |= counts[possible] == tree.slot_counts(leaves[possible])
    return leaves[wanted]


def approximate_split_sides(plan: Plan) -> Generator[int, None, IndexArray]:
    """Fit the leaves anew some more of whose sides are split by now; those that do not fit.

    Yields how many leaves there are so far.
    """
    tree, leaves = plan.tree, plan.beside_split.take_leaves()
    counts, _ = tree.sides(leaves)
    more = counts != plan.split_sides.values[leaves]
    pending = leaves[more]
    plan.split_sides.values[pending] = counts[more]
    for cells in in_blocks(plan.cells.of(pending)):
        plan.record(cells.nodes, plan.approximate(cells, tree.hanging(tree.slots(cells.nodes))))
        yield tree.leaf_count
    return pending[~plan.approximations.at_equal_parameters(pending).accepted]
