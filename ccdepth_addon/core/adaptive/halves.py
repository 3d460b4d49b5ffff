# SPDX-License-Identifier: GPL-3.0-or-later
"""The last phase of a plan: four leaves of a quad become two halves where the surface bends in one direction alone.

Bevels, tubes and fillets bend one way, and a quadtree splits both ways. A half is a leaf like others: a bicubic quad,
tessellated by the template for its split sides, with a bound of its own. Three vertices are left out: the centre of the
quad, and the midpoints of the sides that its halves lie along, where no other leaf has a corner there. So leaves across
these sides have fewer split sides.

Leaves that have a bound by their neighbours alone (``star_bounds``) are bounded anew beside halves. Where they exceed
the limit they stay as they are, and so do all leaves at their vertices; and so do leaves over flat parts, which have
one bound together (docs/adaptive.md, Halves).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from .cells.cell_store import in_blocks
from .cells.patch_cells import BicubicCells
from .leaf_approximation import LeafApproximation
from .neighbour_bounds import approximate_alone, find_changed_star_bounds
from .plan import Plan
from .quadtree import NONE, Quadtree
from .request import Mode
from .template_choice import off_lines

# Halves along sides 0 and 2, and along sides 1 and 3, have three chords of a quad for their long sides: the points
# (``templates.QUAD_POINTS``, then the centre) that lie over the middles of these, and their ends.
CHORDS = (([4, 8, 6], [0, 7, 3], [1, 5, 2]), ([5, 8, 7], [1, 4, 0], [2, 6, 3]))

# So many times quads are halved, without those beside which leaves exceeded the limit before; the last time without all
# beside leaves whose bounds depend on their neighbours.
ATTEMPTS = 3


def halve(plan: Plan) -> None:
    """Halve quads of a settled plan. Its tree cannot be split any more."""
    if plan.request.mode is Mode.PER_FACE:
        return
    stays = _leaves_over_flat_parts(plan)
    possible = _halves_alone(plan, _quads_of_leaves(plan, ~stays))
    for is_last in [False] * (ATTEMPTS - 1) + [True]:
        if is_last:
            _add_with_neighbours(plan, stays, plan.approximations.unbounded())
        exceeding = _halve_beside(plan, possible, stays)
        if not len(exceeding):
            return
        _add_with_neighbours(plan, stays, exceeding)


def _halve_beside(plan: Plan, possible: _Halves, stays: BoolArray) -> IndexArray:
    """Halve the possible quads, but for leaves that stay, (nodes,). Returns leaves that exceed the limit beside halves;
    then nothing has been done."""
    tree = plan.tree
    chosen = np.flatnonzero(~stays[tree.children_of_quads(possible.quads)].any(axis=0))
    others = _Others(plan, stays, possible.quads[chosen], possible.ends[:, chosen])
    while len(chosen):
        failed = possible.are_refused(chosen, others.corners)
        if not np.any(failed):
            failed = possible.exceed(plan, chosen, others.corners)
        if np.any(failed):
            others.put_children(possible.quads[chosen[failed]])
            chosen = chosen[~failed]
        elif not others.approximate():
            break
    changed = others.changed()
    before = [(changed, plan.approximations.without_star_bounds(changed))]
    others.record()
    whole = np.flatnonzero(~others.corners[tree.midpoints] & (tree.midpoints != NONE))
    nodes = tree.halve(possible.quads[chosen], possible.sides[chosen], whole)
    for own, approximation in zip(nodes, possible.approximations(chosen, others.corners), strict=True):
        plan.record(own, approximation)
    exceeding = _bound_beside(plan, before)
    if len(exceeding):
        tree.undo_halves(nodes)
        for leaves, approximation in reversed(before):
            plan.record(leaves, approximation)
        plan.approximated.put(tree.children_of_quads(possible.quads[chosen]).ravel())
    return exceeding


def _bound_beside(plan: Plan, before: list[tuple[IndexArray, LeafApproximation]]) -> IndexArray:
    """Bound the leaves anew that have a bound by their neighbours alone, where these have changed; alone where they
    exceed the limit. Adds leaves, and how they were approximated before; returns those that still exceed it."""
    failed = [np.zeros(0, dtype=np.intp)]
    while True:
        plan.report()
        wanted = find_changed_star_bounds(plan, plan.approximations.unbounded())
        exceeding = wanted[plan.approximations.star_bounds(wanted) > plan.request.limit]
        before.append((exceeding, plan.approximations.without_star_bounds(exceeding)))
        alone = approximate_alone(plan, exceeding)
        failed.append(exceeding[~alone])
        if not np.any(alone):
            return np.unique(np.concatenate(failed))


class _Halves:
    """Two halves of each of P quads, bicubic, whose children are leaves; within the limit while their sides are whole.

    quads: (P,) nodes, ascending; sides: (P,) the side, 0 or 1, that they lie along, and along the one across. ends:
    (2, P) the vertices at the middles of the sides where they end.
    """

    def __init__(self, tree: Quadtree, quads: IndexArray, sides: IndexArray, whole: LeafApproximation) -> None:
        """whole: (2P,) how to approximate them with their sides whole."""
        self.quads, self.sides = quads, sides
        self._whole = whole
        # The same with their outer long sides split, where that has been found.
        self._split = LeafApproximation.none(2 * len(quads))
        self._is_found = np.zeros((2, len(quads)), dtype=bool)
        slots = [tree.first_slots(quads) + (sides + turn) % 4 for turn in range(4)]
        first = tree.first_child[quads]
        of_children = [tree.first_slots(first + (sides + turn) % 4) for turn in range(4)]
        self._middles = tree.midpoints[tree.slot_edges[np.stack([slots[0], slots[2]])]]
        self.ends = tree.midpoints[tree.slot_edges[np.stack([slots[1], slots[3]])]]
        outer = [slot + side for slot in of_children for side in (0, 3)]
        self._finer = tree.midpoints[tree.slot_edges[np.stack(outer)]]

    def are_refused(self, chosen: IndexArray, corners: BoolArray) -> BoolArray:
        """(chosen,) where a long side would be split more than once; where a short side is split, as triangles there
        would be thinner than the half; or where both halves have a split side, and so make no fewer faces than the
        leaves. corners: as in ``_Others``."""
        return corners[self._finer[:, chosen]].any(axis=0) | corners[self._middles[:, chosen]].all(axis=0)

    def exceed(self, plan: Plan, chosen: IndexArray, corners: BoolArray) -> BoolArray:
        """(chosen,) where a half exceeds the limit with its long side split."""
        split, count = corners[self._middles[:, chosen]], len(self.quads)
        new = chosen[np.any(split & ~self._is_found[:, chosen], axis=0)]
        self._is_found[:, new] = True
        hanging = np.zeros((2, len(new), 4), dtype=bool)
        hanging[:, :, 0] = True
        found = _approximate(plan, self.quads[new], self.sides[new], hanging)
        self._split.put(np.concatenate([new, new + count]), found)
        return np.any(split & ~self._split.accepted.reshape(2, count)[:, chosen], axis=0)

    def approximations(self, chosen: IndexArray, corners: BoolArray) -> Iterator[LeafApproximation]:
        """(chosen,) of the first halves, and of the second."""
        for half, split in enumerate(corners[self._middles[:, chosen]]):
            own = chosen + half * len(self.quads)
            found = self._whole.at(own)
            found.put(np.flatnonzero(split), self._split.at(own[split]))
            yield found


def _approximate(plan: Plan, quads: IndexArray, sides: IndexArray, hanging: BoolArray) -> LeafApproximation:
    """How to approximate the halves of quads (P,), ascending, along sides (P,), by themselves alone: (2P,). hanging:
    (2, P, 4) bool, which of their sides are split."""
    found = LeafApproximation.none(2 * len(quads))
    for side in (0, 1):
        for cells in _bicubic(plan, quads[sides == side]):
            places = np.searchsorted(quads, cells.nodes)
            for half in (0, 1):
                halves = cells.halves(side + 2 * half, cells.nodes)
                own = plan.approximate(halves, hanging[half, places].ravel(), LeafApproximation.none(len(places)))
                found.put(places + half * len(quads), own)
            plan.report()
    return found


def _bicubic(plan: Plan, quads: IndexArray) -> Iterator[BicubicCells]:
    """The bicubic ones among the cells of split quads."""
    if len(quads):
        for cells in in_blocks(cells for cells in plan.cells.of(quads) if isinstance(cells, BicubicCells)):
            assert isinstance(cells, BicubicCells)
            yield cells


def _leaves_over_flat_parts(plan: Plan) -> BoolArray:
    """(nodes,) the leaves over flat parts, which have one bound together, and all at their vertices."""
    tree, stays = plan.tree, np.zeros(len(plan.tree.first_child), dtype=bool)
    leaves = tree.leaves()
    _add_with_neighbours(plan, stays, leaves[plan.flat_parts.is_flat(tree.base_faces[leaves])])
    return stays


def _add_with_neighbours(plan: Plan, stays: BoolArray, leaves: IndexArray) -> None:
    """Add some leaves, and all at their vertices, to those that stay."""
    everything = plan.tree.leaves()
    stays[leaves] = True
    stays[everything[plan.tree.share_a_vertex(everything, leaves)]] = True


def _quads_of_leaves(plan: Plan, may_go: BoolArray) -> IndexArray:
    """The quads all of whose children are leaves that may go, (nodes,)."""
    tree = plan.tree
    leaves = np.flatnonzero((tree.first_child == NONE) & may_go & (tree.parents != NONE))
    counts = np.bincount(tree.parents[leaves], minlength=len(tree.first_child))
    quads = np.flatnonzero(counts == 4)
    return quads[tree.is_quad(quads) & plan.may_be_halved(quads) & plan.cells.keeps(quads)]


def _halves_alone(plan: Plan, quads: IndexArray) -> _Halves:
    """The halves within the limit with all their sides whole, of quads (P,), ascending, along the better side."""
    off = _off_chords(plan, quads)
    likely = off.min(axis=0, initial=np.inf) <= plan.request.limit
    quads, sides = quads[likely], off[:, likely].argmin(axis=0)
    whole = np.zeros((2, len(quads), 4), dtype=bool)
    found = _approximate(plan, quads, sides, whole)
    done = np.flatnonzero(found.accepted.reshape(2, -1).all(axis=0))
    return _Halves(plan.tree, quads[done], sides[done], found.at(np.concatenate([done, done + len(quads)])))


def _off_chords(plan: Plan, quads: IndexArray) -> FloatArray:
    """(2, P): how far the surface is off the long sides of halves of quads along sides 0 and 1, over their middles."""
    tree = plan.tree
    slots = tree.first_slots(quads)[:, None] + np.arange(4)
    centres = tree.slot_vertices[tree.first_slots(tree.first_child[quads]) + 2]
    vertices = np.vstack([tree.slot_vertices[slots].T, tree.midpoints[tree.slot_edges[slots]].T, centres])
    points = plan.positions.of(vertices.ravel()).reshape(9, -1, 3)
    found = np.empty((2, len(quads)))
    for side, (middles, starts, ends) in enumerate(CHORDS):
        chords = points[ends] - points[starts]
        off = points[middles] - (points[starts] + points[ends]) / 2
        found[side] = off_lines(off, chords, squared_norms(chords), np.zeros(chords.shape[:2], dtype=bool))
    return found


class _Others:
    """The leaves that are not covered by halves.

    Fewer and fewer quads are halved, so these leaves have ever more split sides, up to those they had before. corners:
    (V + 1,) the vertices at which some leaf has a corner, or where one may stay; the last stands for NONE.
    """

    def __init__(self, plan: Plan, stays: BoolArray, quads: IndexArray, ends: IndexArray) -> None:
        """quads: those to be halved, and ends: as in ``_Halves``, of these."""
        self._plan, self._tree = plan, plan.tree
        tree, is_leaf = self._tree, self._tree.first_child == NONE
        is_leaf[tree.children_of_quads(quads)] = False
        self.corners = np.zeros(len(tree.vertex_edges) + 1, dtype=bool)
        self._put_corners(np.concatenate([np.flatnonzero(is_leaf), quads]))
        self.corners[ends] = True
        self._keep_sides(np.flatnonzero(stays))
        self._beside = self._changed(np.flatnonzero(is_leaf))[0]
        self._split_sides = np.full(len(tree.first_child), NONE, dtype=np.int32)
        self._found: list[tuple[IndexArray, LeafApproximation]] = []

    def put_children(self, quads: IndexArray) -> None:
        """Add the children of quads that are not halved after all."""
        children = self._tree.children_of_quads(quads).ravel()
        self._put_corners(children)
        self._beside = np.concatenate([self._beside, children])

    def _put_corners(self, nodes: IndexArray) -> None:
        self.corners[self._tree.slot_vertices[self._tree.slots(nodes)]] = True

    def _keep_sides(self, leaves: IndexArray) -> None:
        """Keep the midpoints of split sides of some leaves."""
        tree = self._tree
        self.corners[tree.midpoints[tree.slot_edges[tree.slots(leaves)]]] = True
        self.corners[NONE] = False

    def _hanging(self, leaves: IndexArray) -> BoolArray:
        """(slots of the leaves,) which sides are split."""
        return self.corners[self._tree.midpoints[self._tree.slot_edges[self._tree.slots(leaves)]]]

    def _changed(self, leaves: IndexArray) -> tuple[IndexArray, NDArray[np.int32]]:
        """Those of some leaves that have fewer split sides than in the tree, and how many."""
        if not len(leaves):
            return leaves, np.zeros(0, dtype=np.int32)
        tree, counts = self._tree, self._tree.slot_counts(leaves)
        starts = np.cumsum(counts) - counts
        before, now = (
            np.add.reduceat(split, starts, dtype=np.int32)
            for split in (tree.hanging(tree.slots(leaves)), self._hanging(leaves))
        )
        fewer = np.flatnonzero(now != before)
        return leaves[fewer], now[fewer]

    def approximate(self) -> bool:
        """Approximate those with fewer split sides than in the tree, and others than before. Returns whether any exceed
        the limit; their sides stay split."""
        plan, (changed, counts) = self._plan, self._changed(self._beside)
        new = changed[self._split_sides[changed] != counts]
        self._split_sides[changed] = counts
        exceeding = []
        for cells in in_blocks(plan.cells.of(new)) if len(new) else ():
            own = plan.approximate(cells, self._hanging(cells.nodes))
            self._found.append((cells.nodes, own))
            exceeding.append(cells.nodes[~own.accepted])
            plan.report()
        for nodes in exceeding:
            self._keep_sides(nodes)
        return any(len(nodes) for nodes in exceeding)

    def changed(self) -> IndexArray:
        """Those that have fewer split sides than in the tree."""
        return self._changed(self._beside)[0]

    def record(self) -> None:
        """Record the last approximations of those that have fewer split sides than in the tree."""
        for nodes, approximation in self._found:
            changed, _ = self._changed(nodes)
            chosen = np.flatnonzero(np.isin(nodes, changed))
            self._plan.record(nodes[chosen], approximation.at(chosen))
