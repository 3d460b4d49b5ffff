# SPDX-License-Identifier: GPL-3.0-or-later
"""The third phase of a plan: star bounds for the leaves that exceed the limit at equal parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, IndexArray
from .cells.cell_store import in_blocks
from .flat_bounds import flat_bounds
from .leaf_approximation import LeafApproximation
from .leaf_bounds.star_bounds import star_bounds
from .plan import Plan
from .quadtree import NONE, Quadtree, any_of_slots
from .tessellation import triangles_around

# How many rings stars have where one is not wide enough, and where those are not.
MORE_RINGS = (2, 4)


def bound_along_surface(plan: Plan) -> IndexArray:
    """Bound the leaves that exceed the limit at equal parameters by their neighbours. Returns those that still exceed
    it.

    A star bound depends on the approximations of the leaf and of the leaves in its star. Where that has changed, one of
    them was approximated since: its sides were split, or it is new and has the vertices of the leaf before.
    """
    while True:
        found = bound_changed(plan)
        plan.by_flat_part.values[np.setdiff1d(found.wanted, found.failed, assume_unique=True)] = False
        unbounded = plan.approximations.unbounded()
        by_flat_part = unbounded[plan.by_flat_part.values[unbounded]]
        failed = _not_flat_enough(plan, np.union1d(found.failed, by_flat_part))
        # The star bounds around have to know what is drawn otherwise, now or after the splits.
        if len(failed) or not len(found.redrawn):
            return failed


@dataclass(frozen=True)
class ChangedBounds:
    """wanted: the leaves whose star bounds may have changed, in ascending order. exceeding: those that exceeded the
    limit by these, and before: how they were approximated then. redrawn: those of them that have bounds of their own
    now. failed: the others.
    """

    wanted: IndexArray
    exceeding: IndexArray
    before: LeafApproximation
    redrawn: IndexArray
    failed: IndexArray


def bound_changed(plan: Plan, settled: BoolArray | None = None) -> ChangedBounds:
    """Compute and record anew those star bounds that may have changed; where these exceed the limit, bounds of the
    leaves alone, which may be drawn otherwise then.

    settled: (nodes,) leaves that have to be drawn as they are, and keep the bounds of their flat parts.
    """
    approximations = plan.approximations
    unbounded = approximations.unbounded()
    wanted = unbounded[_may_have_changed(plan, unbounded, plan.approximated.take_leaves())]
    if settled is not None:
        wanted = wanted[~(settled[wanted] & plan.by_flat_part.values[wanted])]
    narrow = _find_star_bounds(plan, wanted, 1)
    plan.by_rings.values[wanted] = False
    plan.by_rings.values[narrow] = True
    for rings in MORE_RINGS:
        narrow = _find_star_bounds(plan, narrow, rings)
    exceeding = wanted[approximations.star_bounds(wanted) > plan.request.limit]
    before, alone = approximations.without_star_bounds(exceeding), _alone(plan, exceeding)
    accepted = alone.accepted if settled is None else alone.accepted & ~settled[exceeding]
    plan.record(exceeding[accepted], alone.at(np.flatnonzero(accepted)))
    return ChangedBounds(wanted, exceeding, before, exceeding[accepted], exceeding[~accepted])


def _alone(plan: Plan, leaves: IndexArray) -> LeafApproximation:
    """How leaves in ascending order, drawn as they are by star bounds that exceed the limit, are approximated without
    their neighbours; accepted where they have a bound."""
    tree, found = plan.tree, LeafApproximation.none(len(leaves))
    for cells in in_blocks(plan.cells.of(leaves)) if len(leaves) else ():
        known = plan.approximations.without_star_bounds(cells.nodes)
        own = plan.approximate(cells, tree.hanging(tree.slots(cells.nodes)), known)
        found.put(np.searchsorted(leaves, cells.nodes), own)
        plan.report()
    return found


def _may_have_changed(plan: Plan, leaves: IndexArray, changed: IndexArray) -> BoolArray:
    """(leaves,) whether a star of theirs has changed with some leaves.

    If one was drawn otherwise before, so was the nearest of those in between that has changed, as that has kept the
    vertex it shares with the one before: so it is as near as that was.
    """
    tree = plan.tree
    found = _are_at_vertices(tree, leaves, changed)
    # Over a flat part another bound is found, which stars that are too narrow do not change.
    others = np.flatnonzero(plan.by_rings.values[leaves] & ~plan.by_flat_part.values[leaves] & ~found)
    if len(others):
        near = leaves[others]
        for _ in range(MORE_RINGS[-1]):
            near = _with_neighbours(tree, near)
        changed = np.intersect1d(changed, near, assume_unique=True)
        for _ in range(MORE_RINGS[-1] - 1):
            changed = _with_neighbours(tree, changed)
        found[others] = _are_at_vertices(tree, leaves[others], changed)
    return found


def _not_flat_enough(plan: Plan, leaves: IndexArray) -> IndexArray:
    """Those of some leaves that exceed the limit in their flat part as well. Bounds there depend on all of the part, so
    leaves with such bounds are looked at each time."""
    found, limit = flat_bounds(plan, leaves), plan.request.limit
    within = np.flatnonzero(found.bounds <= limit)
    plan.approximations.put_star_bounds(leaves[within], leaves[within], found.bounds[within])
    # Where others along the border exceed the limit they may be split first.
    failed = found.own > limit
    if not np.any(failed):
        failed = found.bounds > limit
    plan.by_flat_part.values[leaves] = ~failed
    return leaves[failed]


def _are_at_vertices(tree: Quadtree, leaves: IndexArray, others: IndexArray) -> BoolArray:
    """(leaves,) those that share a vertex with one of the others, or are one."""
    if not len(leaves):
        return np.zeros(0, dtype=bool)
    found = _faces_around(tree, others)[tree.base_faces[leaves]]
    found[found] = tree.share_a_vertex(leaves[found], others)
    return found


def _with_neighbours(tree: Quadtree, leaves: IndexArray) -> IndexArray:
    """Some leaves, and all at their vertices, in ascending order."""
    around = np.flatnonzero(_faces_around(tree, leaves).take(tree.base_faces) & (tree.first_child == NONE))
    return around[tree.share_a_vertex(around, leaves)]


def _faces_around(tree: Quadtree, nodes: IndexArray) -> BoolArray:
    """(faces of the control mesh,) those that share a vertex with a face of the nodes. All nodes that share a vertex
    with them lie on these."""
    mesh = tree.mesh
    marked = np.zeros(mesh.face_count, dtype=bool)
    marked[tree.base_faces[nodes]] = True
    at_vertices = np.zeros(mesh.vertex_count, dtype=bool)
    at_vertices[mesh.corner_vertices[marked.take(mesh.corner_faces)]] = True
    return any_of_slots(at_vertices.take(mesh.corner_vertices), mesh.face_sizes)


def _find_star_bounds(plan: Plan, wanted: IndexArray, rings: int) -> IndexArray:
    """Compute and record those of the wanted leaves, by stars of so many rings at most. Returns the leaves that exceed
    the limit only because these are not wide enough."""
    if not len(wanted):
        return wanted
    tree, approximations, limit = plan.tree, plan.approximations, plan.request.limit
    leaves = wanted
    for _ in range(rings):
        leaves = _with_neighbours(tree, leaves)
    for cells in in_blocks(plan.cells.of(leaves[np.isinf(approximations.error_bounds(leaves)[0])])):
        approximations.put_error_bounds(
            cells.nodes, cells.error_bounds(approximations.without_neighbours(cells.nodes), limit)
        )
        plan.report()
    drawn = triangles_around(tree, leaves, approximations.without_neighbours(leaves), plan.request.transitions)
    nodes = leaves[drawn.leaves]
    is_wanted = np.zeros(len(tree.first_child), dtype=bool)
    is_wanted[wanted] = True
    found = star_bounds(
        plan.positions.of(drawn.used),
        drawn.corners,
        *approximations.error_bounds(nodes),
        drawn.closed,
        is_wanted[nodes],
        plan.request.rounding,
        rings,
    )
    owners = nodes[is_wanted[nodes]]
    approximations.put_star_bounds(wanted, owners, found.bounds)
    is_wanted[owners[found.with_room > limit]] = False
    return wanted[is_wanted[wanted] & (approximations.star_bounds(wanted) > limit)]
