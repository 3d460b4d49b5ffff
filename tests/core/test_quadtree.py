# SPDX-License-Identifier: GPL-3.0-or-later
"""Which leaves a split concerns, and cells found by their nodes: by brute force."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from ccdepth_addon.core.catmull_clark import apply_boundary_rule
from ccdepth_addon.core.cell_store import CellStore
from ccdepth_addon.core.cells import Cells, NetCells
from ccdepth_addon.core.mesh import IndexArray
from ccdepth_addon.core.quadtree import NONE, Quadtree
from tests import meshes

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "cube": meshes.cube,
    "landscape": lambda: meshes.landscape(4, 3),
    "triangles and quads": meshes.triangles_and_quads,
    "n-gons": lambda: meshes.cylinder(7),
    "three faces on an edge": meshes.three_faces_on_an_edge,
    "face soup": meshes.face_soup,
    "two quads on opposite corners": meshes.two_quads_on_opposite_corners,
    "pillow of pentagons": lambda: meshes.pillow(5),
    "doubled face": meshes.doubled_face,
    "Möbius strip": meshes.mobius_strip,
}

ROUNDS = 8


@pytest.mark.parametrize("name", MESHES)
def test_only_leaves_beside_change_their_sides(name: str) -> None:
    """Random splits, one after another, now many leaves and now few, without any balance."""
    tree = Quadtree(apply_boundary_rule(meshes.to_polygon_mesh(MESHES[name]()), smooth_corners=True))
    generator = np.random.default_rng(7)
    for turn in range(ROUNDS):
        leaves = tree.leaves()
        chosen = np.sort(generator.choice(leaves, 1 + len(leaves) // (2 + 3 * (turn % 3)), replace=False))
        kept = np.setdiff1d(leaves, chosen)
        before = sides_by_brute_force(tree, kept)
        tree.split(chosen)
        beside = tree.leaves_beside(chosen)
        changed = np.any(sides_by_brute_force(tree, kept) != before, axis=1)
        assert np.all(np.isin(kept[changed], beside))
        assert np.all(np.isin(np.setdiff1d(tree.leaves(), leaves), beside))
        np.testing.assert_array_equal(beside, beside_by_brute_force(tree, chosen, leaves))
        for nodes in (tree.leaves(), np.arange(len(tree.first_child))):
            np.testing.assert_array_equal(np.stack(tree.sides(nodes), axis=1), sides_by_brute_force(tree, nodes))


def sides_by_brute_force(tree: Quadtree, nodes: IndexArray) -> IndexArray:
    """(nodes, 2): how many sides are split, and whether half of one is split again."""
    found = np.zeros((len(nodes), 2), dtype=np.intp)
    for place, node in enumerate(nodes.tolist()):
        halves = tree.edge_children[tree.slot_edges[tree.slots(np.array([node]))]]
        halves = halves[halves != NONE]
        again = tree.edge_children[np.concatenate([halves, halves + 1])] != NONE
        found[place] = len(halves), np.any(again)
    return found


def beside_by_brute_force(tree: Quadtree, nodes: IndexArray, leaves_before: IndexArray) -> IndexArray:
    """New leaves, and those with a side that is a side of the nodes or has one for a half."""
    edges = tree.slot_edges[tree.slots(nodes)]
    halves = tree.edge_children
    wholes = np.flatnonzero(np.isin(halves, edges) | np.isin(np.where(halves == NONE, NONE, halves + 1), edges))
    concerned = np.concatenate([edges, wholes])
    return np.array(
        [
            leaf
            for leaf in tree.leaves().tolist()
            if leaf not in leaves_before or np.any(np.isin(tree.slot_edges[tree.slots(np.array([leaf]))], concerned))
        ]
    )


def cells(nodes: Iterable[int], valence: int) -> NetCells:
    """With nets that tell their nodes."""
    numbers = np.array([*nodes], dtype=np.intp)
    nets = np.broadcast_to(numbers[None, :, None], (2 * valence + 8, len(numbers), 3)).astype(np.float64)
    return NetCells(numbers, np.zeros_like(numbers), nets, valence)


def nodes_of(found: Iterable[Cells]) -> list[int]:
    nodes: list[int] = []
    for block in found:
        assert isinstance(block, NetCells)
        np.testing.assert_array_equal(block.nets, cells(block.nodes, block.valence).nets)
        nodes += block.nodes.tolist()
    return sorted(nodes)


def test_cells_are_found_by_their_nodes_until_they_are_taken() -> None:
    generator = np.random.default_rng(3)
    store, kept = CellStore(), set[int]()
    for turn in range(40):
        first = 50 * turn
        store.extend(first + 50)
        order = first + generator.permutation(40)
        store.put(cells(order[:25], 4))
        store.put(cells(order[25:], 5))
        kept |= {*order.tolist()}
        asked = generator.choice(first + 50, (first + 50) // 3, replace=False)
        there = sorted(kept & {*asked.tolist()})
        assert nodes_of(store.of(asked)) == there
        assert nodes_of(store.take(asked)) == there
        assert nodes_of(store.of(asked)) == []
        kept -= {*there}
    assert nodes_of(store.of(np.arange(2000))) == sorted(kept)
    assert nodes_of(store.of(np.arange(0))) == []
