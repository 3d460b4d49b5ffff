# SPDX-License-Identifier: GPL-3.0-or-later
"""Trees that are tessellated, against the approximations and bounds that all of a tree has from the start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import planner
from ccdepth_addon.core.adaptive.along_surface import bound_along_surface
from ccdepth_addon.core.adaptive.cells.cell_store import some
from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells
from ccdepth_addon.core.adaptive.halves import halve
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.plan import Plan
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.arrays.types import IndexArray
from tests.core.test_adaptive import build, request_of, subdivided
from tests.thorough import combinations

# Rounding, of bounds that are worked out twice, among others then.
SAME = 1e-9


@pytest.mark.parametrize(
    ("name", "mode"),
    combinations(
        ["cube", "torus", "n-gons", "triangles and quads", "valences 3 and 7", "landscape", "fin through"], Mode
    ),
)
def test_finished_tree(name: str, mode: Mode, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tessellated tree is balanced; its approximations and bounds belong to its sides and neighbours as they are.

    While a tree grows only what may have changed is evaluated; here the whole tree is, from the start.
    """
    mesh = build(name)
    for tolerance in (0.02, 2e-3) if mode is Mode.ADAPTIVE else (0.05,):
        plans = list[Plan]()

        def recorded(plan: Plan, plans: list[Plan] = plans) -> None:
            halve(plan)
            plans.append(plan)

        monkeypatch.setattr(planner, "halve", recorded)
        request = request_of(mesh, tolerance, mode)
        subdivided(mesh, request)
        for plan in plans:
            leaves, tree = plan.leaves(), plan.tree
            np.testing.assert_array_equal(np.sort(leaves), tree.leaves())
            assert_approximated_as_it_is(tree, leaves, plan.approximations.of(leaves))
            assert_bounded_as_it_is(plan, leaves, request)


def assert_approximated_as_it_is(tree: Quadtree, leaves: IndexArray, approximation: LeafApproximation) -> None:
    counts, deeper = tree.sides(leaves)
    assert not np.any(deeper)
    assert np.all(counts < tree.slot_counts(leaves))
    quads = np.flatnonzero(tree.is_quad(leaves))
    hanging = tree.hanging(
        tree.first_slots(leaves[quads])[:, None] + (np.arange(4) + approximation.turns[quads, None]) % 4
    )
    np.testing.assert_array_equal(hanging @ [1, 2, 4, 8], approximation.patterns[quads])


def assert_bounded_as_it_is(plan: Plan, leaves: IndexArray, request: AdaptiveRequest) -> None:
    """Every bound is what is found for the leaf as it is drawn, or else for its neighbours as they are drawn."""
    approximations, anew = plan.approximations, approximated_anew(plan.tree, request).at(leaves)
    before = approximations.alone(leaves)
    for name in ("patterns", "alternatives", "turns", "folded"):
        np.testing.assert_array_equal(getattr(before, name), getattr(anew, name))
    np.testing.assert_allclose(before.bounds, anew.bounds, rtol=SAME, atol=0)
    unbounded = approximations.unbounded()
    along = approximations.along(unbounded)
    plan.approximated.put(leaves)
    assert not len(bound_along_surface(plan))
    np.testing.assert_allclose(approximations.along(unbounded), along, rtol=SAME, atol=0)
    assert np.all(approximations.of(leaves).bounds <= request.limit)


def approximated_anew(tree: Quadtree, request: AdaptiveRequest) -> LeafApproximation:
    """(nodes,) approximations of a tree's leaves with their sides as they are, from the faces of the control mesh down.
    Whole leaves by their bicubic parents first."""
    found, waiting = LeafApproximation.none(len(tree.first_child)), [*cells_of_faces(tree.mesh)]
    from_parents = LeafApproximation.none(len(found.accepted))
    while waiting:
        cells = waiting.pop()
        is_leaf = tree.first_child[cells.nodes] == NONE
        for parents in some(cells, ~is_leaf & ~np.isin(cells.nodes, tree.covered)):
            waiting += parents.children(tree)
            if isinstance(parents, BicubicCells):
                waiting += halves_of(tree, parents)
                children = parents.approximate_children(request.limit, request.axes)
                from_parents.put(tree.children_of_quads(parents.nodes).ravel(), children.approximation)
        for leaves in some(cells, is_leaf):
            approximation = leaves.approximate(tree.hanging(tree.slots(leaves.nodes)), request)
            by_parents = np.flatnonzero(from_parents.accepted[leaves.nodes] & (tree.sides(leaves.nodes)[0] == 0))
            approximation.put(by_parents, from_parents.at(leaves.nodes[by_parents]))
            found.put(leaves.nodes, approximation)
    return found


def halves_of(tree: Quadtree, parents: BicubicCells) -> Iterator[BicubicCells]:
    """The cells of the halves of quads, where these are halved: halves that were not drawn in the end are no leaves."""
    halves = tree.first_half + np.arange(len(tree.covered))
    for half in halves[tree.first_child[halves] == NONE].tolist():
        chosen = np.flatnonzero(parents.nodes == tree.parents[half])
        if len(chosen):
            side = tree.covered[half - tree.first_half, 0] - tree.first_child[parents.nodes[chosen[0]]]
            yield parents.at(chosen).halves(int(side), np.array([half]))
