# SPDX-License-Identifier: GPL-3.0-or-later
"""What a split of random leaves tells of those beside them, against all leaves looked at one by one.

The vertices, edges and points of a tree are judged by the meshes that are made of it (``tests.soundness``).
"""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.arrays.types import IndexArray
from tests.core.test_adaptive import build

ROUNDS = 8


@pytest.mark.parametrize(
    "name",
    ["single quad", "tetrahedron", "n-gons", "triangles and quads", "fin through", "face soup", "Möbius strip",
     "bow tie", "pillow of triangles", "pillow of quads", "doubled face", "loose edges"],
)  # fmt: skip
def test_leaves_beside_and_leaves_that_share_a_vertex(name: str) -> None:
    """Now many leaves are split and now few, without any balance; splits are never undone."""
    tree = Quadtree(build(name))
    generator = np.random.default_rng(7)
    for turn in range(ROUNDS):
        leaves = tree.leaves()
        chosen = np.sort(generator.choice(leaves, 1 + len(leaves) // (2 + 3 * (turn % 3)), replace=False))
        kept = np.setdiff1d(leaves, chosen)
        before = np.stack(tree.sides(kept))
        tree.split(chosen)
        beside = tree.leaves_beside(chosen)
        after = np.stack(tree.sides(kept))
        np.testing.assert_array_equal(after, np.stack(tree.sides(np.arange(len(tree.first_child))))[:, kept])
        assert np.all(after >= before)
        assert np.all(np.isin(kept[np.any(after > before, axis=0)], beside))
        assert beside.tolist() == beside_by_brute_force(tree, chosen, leaves)
        shuffled = generator.permutation(tree.leaves())
        others = shuffled[generator.random(len(shuffled)) < (0.0, 0.05, 0.3)[turn % 3]]
        marked: set[int] = set().union(*(vertices_of(tree, node) for node in others.tolist()))
        expected = [bool(vertices_of(tree, node) & marked) for node in shuffled.tolist()]
        assert tree.share_a_vertex(shuffled, others).tolist() == expected


def vertices_of(tree: Quadtree, node: int) -> set[int]:
    """Those of a node, with the middles of its split sides."""
    slots = tree.slots(np.array([node]))
    return {*tree.slot_vertices[slots].tolist(), *tree.midpoints[tree.slot_edges[slots]].tolist()} - {NONE}


def beside_by_brute_force(tree: Quadtree, nodes: IndexArray, leaves_before: IndexArray) -> list[int]:
    """New leaves, and those with a side that is a side of the nodes or has one for a half."""
    edges = tree.slot_edges[tree.slots(nodes)]
    halves = tree.edge_children
    wholes = np.flatnonzero(np.isin(halves, edges) | np.isin(np.where(halves == NONE, NONE, halves + 1), edges))
    concerned = np.concatenate([edges, wholes])
    return [
        leaf
        for leaf in tree.leaves().tolist()
        if leaf not in leaves_before or np.any(np.isin(tree.slot_edges[tree.slots(np.array([leaf]))], concerned))
    ]
