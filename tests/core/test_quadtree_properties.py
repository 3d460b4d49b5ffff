# SPDX-License-Identifier: GPL-3.0-or-later
"""Properties of the quadtree's operations that hold for every mesh and every sequence of splits."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.arrays.types import BoolArray, IndexArray
from tests.core.test_quadtree import MESHES, build, sides_by_brute_force

# More nodes than this make brute force slow, and show nothing new.
MOST_NODES = 300

names = st.sampled_from(list(MESHES))
# Each number picks leaves to split, by its bits.
picks = st.lists(st.integers(1, 2**64 - 1), min_size=1, max_size=5)


def picked(tree: Quadtree, pick: int) -> IndexArray:
    """Some leaves of the tree, at least one, in some order."""
    leaves = tree.leaves()
    generator = np.random.default_rng(pick)
    room = max(1, (MOST_NODES - len(tree.first_child)) // 4)
    return generator.permutation(leaves)[: min(room, 1 + int(generator.integers(len(leaves))))]


def grown(name: str, numbers: list[int]) -> Quadtree:
    tree = Quadtree(build(name))
    for pick in numbers:
        tree.split(picked(tree, pick))
    return tree


def paths_of(tree: Quadtree) -> list[tuple[int, ...]]:
    """For each node its face, and the slots of the children on the way from there."""
    paths: list[tuple[int, ...]] = []
    for node, parent in enumerate(tree.parents.tolist()):
        paths.append((node,) if parent == NONE else (*paths[parent], node - int(tree.first_child[parent])))
    return paths


def vertices_of(tree: Quadtree, node: int) -> set[int]:
    """Those of a node, with the middles of its split sides."""
    slots = tree.slots(np.array([node]))
    return {*tree.slot_vertices[slots].tolist(), *tree.midpoints[tree.slot_edges[slots]].tolist()} - {NONE}


@settings(max_examples=40, deadline=None)
@given(name=names, numbers=picks)
def test_leaves_cover_every_face_once(name: str, numbers: list[int]) -> None:
    """A child is a quarter of a quad, and a k-th of a face with k corners; exact, but for thirds and the like."""
    tree = grown(name, numbers)
    shares = np.ones(len(tree.first_child))
    for node, parent in enumerate(tree.parents.tolist()):
        if parent != NONE:
            shares[node] = shares[parent] / tree.slot_counts(np.array([parent]))[0]
    leaves = tree.leaves()
    covered = np.bincount(tree.base_faces[leaves], shares[leaves], tree.mesh.face_count)
    np.testing.assert_allclose(covered, 1.0, rtol=1e-12)
    assert tree.leaf_count == len(leaves)
    inner = np.setdiff1d(np.arange(len(shares)), leaves)
    assert np.all(tree.parents[tree.first_child[inner]] == inner)


@settings(max_examples=40, deadline=None)
@given(name=names, numbers=picks)
def test_a_split_keeps_the_euler_characteristic(name: str, numbers: list[int]) -> None:
    """Vertices - whole edges + leaves: so every side is split once for all nodes along it."""
    tree = grown(name, numbers)
    mesh = tree.mesh
    whole_edges = np.count_nonzero(tree.edge_children == NONE)
    expected = len(mesh.positions) - mesh.edge_count + mesh.face_count
    assert len(tree.vertex_edges) - whole_edges + tree.leaf_count == expected


@settings(max_examples=30, deadline=None)
@given(name=names, numbers=picks, seed=st.integers(0, 2**32 - 1))
def test_the_order_of_splits_only_changes_the_numbers(name: str, numbers: list[int], seed: int) -> None:
    """The same nodes, split one by one, parents first, in another order."""
    tree = grown(name, numbers)
    paths = paths_of(tree)
    pending = {path for path, child in zip(paths, tree.first_child.tolist(), strict=True) if child != NONE}
    other, generator = Quadtree(tree.mesh), np.random.default_rng(seed)
    while pending:
        # Some of those that can be split by now.
        nodes = [node for node, path in enumerate(paths_of(other)) if path in pending]
        chosen = generator.permutation(nodes)[: 1 + int(generator.integers(len(nodes)))]
        pending -= {paths_of(other)[node] for node in chosen.tolist()}
        other.split(chosen)
    assert sorted(paths_of(other)) == sorted(paths)
    assert len(other.vertex_edges) == len(tree.vertex_edges)
    assert len(other.edge_vertices) == len(tree.edge_vertices)
    number = {path: node for node, path in enumerate(paths_of(other))}
    same = np.array([number[path] for path in paths])
    np.testing.assert_array_equal(other.levels[same], tree.levels)
    np.testing.assert_array_equal(np.stack(other.sides(same)), np.stack(tree.sides(np.arange(len(same)))))


@settings(max_examples=30, deadline=None)
@given(name=names, numbers=picks, pick=st.integers(1, 2**64 - 1))
def test_a_split_changes_the_sides_of_leaves_beside_it_only(name: str, numbers: list[int], pick: int) -> None:
    tree = grown(name, numbers)
    chosen = picked(tree, pick)
    kept = np.setdiff1d(tree.leaves(), chosen)
    before = sides_by_brute_force(tree, kept)
    tree.split(chosen)
    after = sides_by_brute_force(tree, kept)
    np.testing.assert_array_equal(np.stack(tree.sides(kept), axis=1), after)
    beside = tree.leaves_beside(chosen)
    assert np.all(np.diff(beside) > 0)
    assert np.all(tree.first_child[beside] == NONE)
    assert np.all(np.isin(kept[np.any(before != after, axis=1)], beside))
    assert np.all(np.isin(np.setdiff1d(tree.leaves(), kept), beside))
    # Splits are never undone.
    assert np.all(after >= before)


@settings(max_examples=30, deadline=None)
@given(name=names, numbers=picks, seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.0, 0.1, 0.5, 1.0]))
def test_leaves_share_a_vertex_as_their_sets_of_vertices_do(
    name: str, numbers: list[int], seed: int, share: float
) -> None:
    tree = grown(name, numbers)
    generator = np.random.default_rng(seed)
    leaves = generator.permutation(tree.leaves())
    others = leaves[generator.random(len(leaves)) < share]
    marked: set[int] = set().union(*(vertices_of(tree, node) for node in others.tolist()))
    expected: BoolArray = np.array([bool(vertices_of(tree, node) & marked) for node in leaves.tolist()])
    found = tree.share_a_vertex(leaves, others)
    np.testing.assert_array_equal(found, expected)
    assert np.all(found[np.isin(leaves, others)])


@settings(max_examples=40, deadline=None)
@given(
    name=names,
    numbers=picks,
    default=st.sampled_from([np.int8(-1), np.int32(7), np.float64(np.inf), np.bool_(True)]),
    reserved=st.integers(0, 2000),
)
def test_columns_grow_with_the_tree(name: str, numbers: list[int], default: np.generic, reserved: int) -> None:
    """Values that were written stay, and new nodes and vertices have the default, with memory reserved or without."""
    tree = Quadtree(build(name))
    of_nodes, of_vertices = tree.add_column(default), tree.add_vertex_column(default)
    expected_nodes, expected_vertices = of_nodes.values.copy(), of_vertices.values.copy()
    for pick in numbers:
        generator = np.random.default_rng(pick)
        for column, expected in ((of_nodes, expected_nodes), (of_vertices, expected_vertices)):
            chosen = generator.random(len(expected)) < 0.5
            values = generator.integers(0, 2, len(expected)).astype(default.dtype)
            column.values[chosen] = expected[chosen] = values[chosen]
        tree.reserve(reserved)
        tree.split(picked(tree, pick))
        late = tree.add_column(default)
        expected_nodes = extended(expected_nodes, len(tree.first_child), default)
        expected_vertices = extended(expected_vertices, len(tree.vertex_edges), default)
        assert of_nodes.values.dtype == of_vertices.values.dtype == default.dtype
        np.testing.assert_array_equal(of_nodes.values, expected_nodes)
        np.testing.assert_array_equal(of_vertices.values, expected_vertices)
        np.testing.assert_array_equal(late.values, np.full(len(expected_nodes), default))


def extended(values: np.ndarray, count: int, default: np.generic) -> np.ndarray:
    return np.concatenate([values, np.full(count - len(values), default)])
