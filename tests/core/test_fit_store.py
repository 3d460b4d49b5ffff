# SPDX-License-Identifier: GPL-3.0-or-later
"""How nodes fit is what was said of them last: next to one array over all nodes for each number."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.approximation_store import FitStore
from ccdepth_addon.core.adaptive.leaf_approximation import Fit
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_bounds import Misses
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.arrays.types import IndexArray
from tests.meshes import cube, to_polygon_mesh

ROUNDS = 40


class Dense:
    """The same as a ``FitStore``, kept for all nodes."""

    def __init__(self) -> None:
        self.fit, self.graph_bounds = Fit.none(0), np.zeros(0)

    def extend(self, count: int) -> None:
        more = count - len(self.graph_bounds)
        columns = zip(vars(self.fit).values(), vars(Fit.none(more)).values(), strict=True)
        self.fit = Fit(*(np.concatenate(column) for column in columns))
        self.graph_bounds = np.concatenate([self.graph_bounds, np.full(more, np.inf)])


def random_fit(generator: np.random.Generator, count: int) -> Fit:
    """Some within the limit at equal parameters; of the others some are likely to fit, and some of these looked at."""
    fits, known = generator.random((2, count)) < 0.6
    bounds = np.where(fits & (generator.random(count) < 0.5), generator.random(count), np.inf)
    known &= fits & np.isinf(bounds)
    normal, tangential = (np.where(known, generator.random(count), np.inf) for _ in range(2))
    small = [generator.integers(0, 4, count).astype(np.int8) for _ in range(3)]
    return Fit(fits, bounds, normal, tangential, *small, generator.random(count) < 0.5, generator.random(count))


def some(generator: np.random.Generator, nodes: IndexArray) -> IndexArray:
    return np.flatnonzero(generator.random(len(nodes)) < generator.random()) if len(nodes) else nodes


@pytest.mark.parametrize("seed", range(5))
def test_what_was_said_last(seed: int) -> None:
    generator = np.random.default_rng(seed)
    tree = Quadtree(to_polygon_mesh(cube()))
    store, dense = FitStore(tree), Dense()
    for _ in range(ROUNDS):
        if generator.random() < 0.3:
            leaves = tree.leaves()
            tree.split(generator.choice(leaves, 1 + len(leaves) // 10, replace=False))
        dense.extend(len(tree.first_child))
        nodes = generator.permutation(len(tree.first_child))

        fitted = nodes[some(generator, nodes)]
        fit = random_fit(generator, len(fitted))
        store.put(fitted, fit)
        dense.fit.put(fitted, fit)
        dense.graph_bounds[fitted] = np.inf

        missing = nodes[some(generator, nodes)]
        missing = missing[dense.fit.fits[missing]]
        misses = Misses(*generator.random((3, len(missing))))
        store.put_misses(missing, misses)
        for values, found in ((dense.fit.normal, misses.normal), (dense.fit.tangential, misses.tangential)):
            values[missing] = np.minimum(found, dense.fit.bounds[missing])

        bounded = nodes[np.isfinite(dense.fit.normal[nodes]) & np.isinf(dense.fit.bounds[nodes])]
        bounded = bounded[some(generator, bounded)]
        drawn = np.repeat(bounded, generator.integers(0, 4, len(bounded)))
        bounds = generator.random(len(drawn))
        store.put_graph_bounds(bounded, drawn, bounds)
        dense.graph_bounds[bounded] = [bounds[drawn == node].max(initial=-np.inf) for node in bounded]
        dense.graph_bounds[bounded] = np.abs(dense.graph_bounds[bounded])

        assert_same(tree, store, dense, bounded)


def assert_same(tree: Quadtree, store: FitStore, dense: Dense, bounded: IndexArray) -> None:
    nodes = np.arange(len(tree.first_child))
    found = store.of(nodes)
    for name in ("fits", "patterns", "alternatives", "turns", "folded"):
        np.testing.assert_array_equal(getattr(found, name), getattr(dense.fit, name))
    np.testing.assert_array_equal(store.as_fitted(nodes).bounds, dense.fit.bounds)
    np.testing.assert_array_equal(found.bounds, np.minimum(dense.fit.bounds, dense.graph_bounds))
    np.testing.assert_array_equal(store.as_fitted(nodes).fits, dense.fit.fits)
    np.testing.assert_array_equal(store.least, dense.fit.least)
    normal, tangential = store.misses(nodes)
    np.testing.assert_array_equal(normal, dense.fit.normal)
    np.testing.assert_array_equal(tangential, dense.fit.tangential)
    np.testing.assert_array_equal(store.graph_bounds(bounded), dense.graph_bounds[bounded])
    unbounded = dense.fit.fits & np.isinf(dense.fit.bounds) & (tree.first_child == NONE)
    np.testing.assert_array_equal(store.unbounded(), np.flatnonzero(unbounded))
