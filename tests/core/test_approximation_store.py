# SPDX-License-Identifier: GPL-3.0-or-later
"""The store returns what was put there last: compared with one array over all nodes for each value."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.approximation_store import ApproximationStore
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_bounds import ErrorBounds
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.arrays.types import IndexArray
from tests.meshes import cube, to_polygon_mesh

pytestmark = pytest.mark.thorough

ROUNDS = 40


class Dense:
    """The values of an ``ApproximationStore``, kept for all nodes."""

    def __init__(self) -> None:
        self.approximation, self.star_bounds = LeafApproximation.none(0), np.zeros(0)

    def extend(self, count: int) -> None:
        more = count - len(self.star_bounds)
        columns = zip(vars(self.approximation).values(), vars(LeafApproximation.none(more)).values(), strict=True)
        self.approximation = LeafApproximation(*(np.concatenate(column) for column in columns))
        self.star_bounds = np.concatenate([self.star_bounds, np.full(more, np.inf)])


def random_approximation(generator: np.random.Generator, count: int) -> LeafApproximation:
    """Some within the limit at equal parameters; some of the others accepted, and some of these with error bounds."""
    accepted, known = generator.random((2, count)) < 0.6
    bounds = np.where(accepted & (generator.random(count) < 0.5), generator.random(count), np.inf)
    known &= accepted & np.isinf(bounds)
    normal, tangential = (np.where(known, generator.random(count), np.inf) for _ in range(2))
    alone = np.isfinite(bounds) & (generator.random(count) < 0.3)
    small = [generator.integers(0, 4, count).astype(np.int8) for _ in range(3)]
    folded, thickness, least = generator.random(count) < 0.5, *generator.random((2, count))
    return LeafApproximation(accepted, bounds, alone, normal, tangential, *small, folded, thickness, least)


def some(generator: np.random.Generator, nodes: IndexArray) -> IndexArray:
    return np.flatnonzero(generator.random(len(nodes)) < generator.random()) if len(nodes) else nodes


@pytest.mark.parametrize("seed", range(5))
def test_the_last_values_count(seed: int) -> None:
    generator = np.random.default_rng(seed)
    tree = Quadtree(to_polygon_mesh(cube()))
    store, dense = ApproximationStore(tree), Dense()
    for _ in range(ROUNDS):
        if generator.random() < 0.3:
            leaves = tree.leaves()
            tree.split(generator.choice(leaves, 1 + len(leaves) // 10, replace=False))
        dense.extend(len(tree.first_child))
        nodes = generator.permutation(len(tree.first_child))

        approximated = nodes[some(generator, nodes)]
        approximation = random_approximation(generator, len(approximated))
        store.put(approximated, approximation)
        dense.approximation.put(approximated, approximation)
        dense.star_bounds[approximated] = np.inf

        missing = nodes[some(generator, nodes)]
        missing = missing[dense.approximation.accepted[missing]]
        error_bounds = ErrorBounds(*generator.random((3, len(missing))))
        store.put_error_bounds(missing, error_bounds)
        for values, found in (
            (dense.approximation.normal, error_bounds.normal),
            (dense.approximation.tangential, error_bounds.tangential),
        ):
            at_equal_parameters = np.where(dense.approximation.alone, np.inf, dense.approximation.bounds)
            values[missing] = np.minimum(found, at_equal_parameters[missing])

        bounded = nodes[np.isfinite(dense.approximation.normal[nodes]) & np.isinf(dense.approximation.bounds[nodes])]
        bounded = bounded[some(generator, bounded)]
        drawn = np.repeat(bounded, generator.integers(0, 4, len(bounded)))
        bounds = generator.random(len(drawn))
        store.put_star_bounds(bounded, drawn, bounds)
        dense.star_bounds[bounded] = [bounds[drawn == node].max(initial=-np.inf) for node in bounded]
        dense.star_bounds[bounded] = np.abs(dense.star_bounds[bounded])

        assert_same(tree, store, dense, bounded)


def assert_same(tree: Quadtree, store: ApproximationStore, dense: Dense, bounded: IndexArray) -> None:
    nodes = np.arange(len(tree.first_child))
    found = store.of(nodes)
    for name in ("accepted", "alone", "patterns", "alternatives", "turns", "folded"):
        np.testing.assert_array_equal(getattr(found, name), getattr(dense.approximation, name))
    np.testing.assert_array_equal(store.without_neighbours(nodes).bounds, dense.approximation.bounds)
    np.testing.assert_array_equal(found.bounds, np.minimum(dense.approximation.bounds, dense.star_bounds))
    np.testing.assert_array_equal(store.without_neighbours(nodes).accepted, dense.approximation.accepted)
    np.testing.assert_array_equal(store.least, dense.approximation.least)
    normal, tangential = store.error_bounds(nodes)
    np.testing.assert_array_equal(normal, dense.approximation.normal)
    np.testing.assert_array_equal(tangential, dense.approximation.tangential)
    np.testing.assert_array_equal(store.star_bounds(bounded), dense.star_bounds[bounded])
    unbounded = dense.approximation.accepted & np.isinf(dense.approximation.bounds) & (tree.first_child == NONE)
    np.testing.assert_array_equal(store.unbounded(), np.flatnonzero(unbounded))
