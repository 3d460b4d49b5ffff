# SPDX-License-Identifier: GPL-3.0-or-later
"""Balance between neighbours: which leaves are split for the splits of their sides alone."""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, IndexArray
from .plan import Plan
from .rectangle_tree import ALONG_U, ALONG_V, QUARTERS, any_of_slots
from .request import Mode


def unbalanced(plan: Plan) -> tuple[IndexArray, IndexArray]:
    """The leaves beside others that are more than one split ahead, or that are cheaper split, and how: those with all
    their sides split, and bicubic quads with two opposite sides split, whose halves are two quads then."""
    tree, leaves = plan.tree, plan.take_beside_split()
    is_quad = tree.is_quad(leaves)
    quads, others = leaves[is_quad], leaves[~is_quad]
    slots = tree.quad_slots(quads)
    are_split, are_deeper = tree.hanging(slots), tree.hanging_twice(slots)
    along_u, along_v = (_wants(are_split[:, sides], are_deeper[:, sides]) for sides in ([0, 2], [1, 3]))
    ways = np.select([along_u & along_v, along_u, along_v], [QUARTERS, ALONG_U, ALONG_V])
    wanted = along_u | along_v
    is_whole = ~plan.surfaces.are_bicubic(quads) | (plan.request.mode is Mode.PER_FACE)
    wanted[is_whole] = (are_split.all(axis=1) | are_deeper.any(axis=1))[is_whole]
    ways[is_whole] = QUARTERS
    slots, counts = tree.slots(others), tree.slot_counts(others)
    if len(others):
        chosen = ~any_of_slots(~tree.hanging(slots), counts) | any_of_slots(tree.hanging_twice(slots), counts)
        others = others[chosen]
    return np.concatenate([quads[wanted], others]), np.append(ways[wanted], np.full(len(others), QUARTERS))


def _wants(are_split: BoolArray, are_deeper: BoolArray) -> BoolArray:
    """(n,) by two opposite sides, (n, 2)."""
    found: BoolArray = are_split.all(axis=1) | are_deeper.any(axis=1)
    return found
