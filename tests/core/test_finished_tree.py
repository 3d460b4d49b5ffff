# SPDX-License-Identifier: GPL-3.0-or-later
"""Trees that are tessellated, against the approximations and bounds that all of a tree has from the start."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import planner
from ccdepth_addon.core.adaptive.cells.cell_store import some
from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.leaf_bounds.star_bounds import star_bounds
from ccdepth_addon.core.adaptive.neighbour_bounds import MORE_RINGS
from ccdepth_addon.core.adaptive.quadtree import NONE, Quadtree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.adaptive.tessellation import TessellationPlan, plan_tessellation, triangles_around
from ccdepth_addon.core.arrays.types import IndexArray
from ccdepth_addon.core.surface.evaluation import limit_values
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
        drawn: list[tuple[Quadtree, IndexArray, LeafApproximation]] = []

        def recorded(
            tree: Quadtree,
            leaves: IndexArray,
            approximation: LeafApproximation,
            transitions: Transitions,
            drawn: Any = drawn,
        ) -> TessellationPlan:
            drawn.append((tree, leaves, approximation))
            return plan_tessellation(tree, leaves, approximation, transitions)

        monkeypatch.setattr(planner, "plan_tessellation", recorded)
        request = request_of(mesh, tolerance, mode)
        subdivided(mesh, request)
        for tree, leaves, approximation in drawn:
            np.testing.assert_array_equal(np.sort(leaves), tree.leaves())
            assert_approximated_as_it_is(tree, leaves, approximation)
            assert_bounded_as_it_is(tree, leaves, approximation, request)


def assert_approximated_as_it_is(tree: Quadtree, leaves: IndexArray, approximation: LeafApproximation) -> None:
    counts, deeper = tree.sides(leaves)
    assert not np.any(deeper)
    assert np.all(counts < tree.slot_counts(leaves))
    quads = np.flatnonzero(tree.is_quad(leaves))
    hanging = tree.hanging(
        tree.first_slots(leaves[quads])[:, None] + (np.arange(4) + approximation.turns[quads, None]) % 4
    )
    np.testing.assert_array_equal(hanging @ [1, 2, 4, 8], approximation.patterns[quads])


def assert_bounded_as_it_is(
    tree: Quadtree, leaves: IndexArray, approximation: LeafApproximation, request: AdaptiveRequest
) -> None:
    """Every bound is what is found for the leaf as it is drawn, or else for its neighbours as they are drawn."""
    anew = approximated_anew(tree, request).at(leaves)
    # Those that neighbours were expected to bound, and that had to do without them.
    chosen = np.flatnonzero(approximation.alone & ~anew.alone)
    anew.put(chosen, approximated_anew(tree, request, alone=True).at(leaves[chosen]))
    assert np.all(np.isfinite(anew.bounds[chosen]))
    for name in ("patterns", "alternatives", "turns", "folded"):
        np.testing.assert_array_equal(getattr(approximation, name), getattr(anew, name))
    drawn = triangles_around(tree, leaves, anew, Transitions.TRIANGLES)
    points = limit_values(tree.mesh, tree.mesh.positions, tree.vertex_points(drawn.used))
    along, of_leaves = np.full(len(leaves), np.inf), drawn.leaves
    normal, tangential = anew.normal[of_leaves], anew.tangential[of_leaves]
    for rings in (1, *MORE_RINGS):
        found = star_bounds(points, drawn.corners, normal, tangential, drawn.closed, of_leaves >= 0, rings=rings)
        largest = np.zeros(len(leaves))
        np.maximum.at(largest, of_leaves, found.bounds)
        along = np.where(along > request.limit, largest, along)
    np.testing.assert_allclose(
        approximation.bounds, np.where(np.isinf(anew.bounds), along, anew.bounds), rtol=SAME, atol=0
    )
    assert np.all(approximation.bounds <= request.limit)


def approximated_anew(tree: Quadtree, request: AdaptiveRequest, *, alone: bool = False) -> LeafApproximation:
    """(nodes,) approximations of a tree's leaves with their sides as they are, and error bounds along their normals and
    across: from the faces of the control mesh down. Whole leaves by their bicubic parents first."""
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
            known = LeafApproximation.none(len(leaves.nodes)) if alone else None
            approximation = leaves.approximate(tree.hanging(tree.slots(leaves.nodes)), request, known=known)
            by_parents = from_parents.accepted[leaves.nodes] & (tree.sides(leaves.nodes)[0] == 0)
            at_parents = np.flatnonzero(by_parents & (not alone))
            approximation.put(at_parents, from_parents.at(leaves.nodes[at_parents]))
            error_bounds = leaves.error_bounds(approximation, request.limit)
            unknown = np.flatnonzero(np.isinf(approximation.normal))
            approximation.normal[unknown] = np.minimum(error_bounds.normal, approximation.bounds)[unknown]
            approximation.tangential[unknown] = np.minimum(error_bounds.tangential, approximation.bounds)[unknown]
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
