# SPDX-License-Identifier: GPL-3.0-or-later
"""The last phase of a plan: four leaves of a quad become two halves where the surface bends in one direction alone.

Bevels, tubes and fillets bend one way, and a quadtree splits both ways. A half is a leaf like others: a bicubic quad,
tessellated by the template for its split sides, with a bound of its own. Three vertices are left out: the centre of the
quad, and the midpoints of the sides that its halves lie along, where no other leaf has a corner there. So leaves across
these sides have fewer split sides.

Leaves that have a bound along the surface (``along_surface``) are bounded anew beside halves. Where they exceed the
limit they stay as they are, and so do all leaves around them (docs/adaptive.md, Halves).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from .along_surface import RINGS, bound_along_surface, with_rings
from .cells.cell_store import in_blocks
from .cells.patch_cells import BicubicCells
from .leaf_approximation import LeafApproximation
from .plan import Plan
from .quadtree import NONE, Quadtree, any_of_slots
from .request import Mode
from .template_choice import off_lines

# Halves along sides 0 and 2, and along sides 1 and 3, have three chords of a quad for their long sides: the points
# (``templates.QUAD_POINTS``, then the centre) that lie over the middles of these, and their ends.
CHORDS = (([4, 8, 6], [0, 7, 3], [1, 5, 2]), ([5, 8, 7], [1, 4, 0], [2, 6, 3]))

# So many times quads are halved, without those around leaves that exceeded the limit before, farther and farther around
# these; the last time without all beside leaves whose bounds depend on their neighbours, or would, by which many are
# lost.
ATTEMPTS, MOST_RINGS = 12, 16


def halve(plan: Plan) -> None:
    """Halve quads of a settled plan. Its tree cannot be split any more."""
    if plan.request.mode is Mode.PER_FACE:
        return
    stays = np.zeros(len(plan.tree.first_child), dtype=bool)
    possible = _halves_alone(plan, _quads_of_leaves(plan, ~stays))
    if not len(possible.quads):
        return
    drawn = _Drawn(plan, possible)
    chosen = np.arange(len(possible.quads))
    for attempt in range(ATTEMPTS):
        is_last = attempt == ATTEMPTS - 1
        if is_last:
            drawn.forget()
            stays[with_rings(plan.tree, plan.approximations.unbounded(), RINGS)] = True
            chosen = chosen[possible.have_bounds(chosen)]
        chosen = chosen[~stays[plan.tree.children_of_quads(possible.quads[chosen])].any(axis=0)]
        others = _Others(plan, stays, possible.quads[chosen], possible.ends[:, chosen], alone=is_last)
        chosen = _settle(plan, possible, chosen, others)
        exceeding = drawn.draw(chosen, others)
        if not len(exceeding):
            return
        drawn.erase()
        stays[with_rings(plan.tree, exceeding, min(1 << attempt, MOST_RINGS))] = True


class _Drawn:
    """Which halves have been drawn in a tree, and how the leaves beside them were approximated before.

    An attempt changes little of the one before. So halves, and leaves that do not stay, keep their approximations where
    their sides are split as they were then, and their bounds along the surface where nothing around them changes.
    """

    def __init__(self, plan: Plan, possible: _Halves) -> None:
        self._plan, self._possible = plan, possible
        self._halves = plan.tree.halves(possible.quads, possible.sides)
        self._before: list[tuple[IndexArray, LeafApproximation]] = []
        self._start()

    def _start(self) -> None:
        """With none drawn: all vertices are corners, as in ``_Others``."""
        tree = self._plan.tree
        self._chosen, self._beside = np.zeros((2, 0), dtype=np.intp)
        self._corners = np.ones(len(tree.vertex_edges) + 1, dtype=bool)
        self._corners[NONE] = False

    def erase(self) -> None:
        """Make the tree as it was; approximations stay."""
        self._plan.tree.undo_halves(self._halves[:, self._chosen])

    def forget(self) -> None:
        """The same of all approximations."""
        self._record_before(np.concatenate([nodes for nodes, _ in self._before]))
        self._plan.approximated.put(self._children(self._chosen))
        self._start()

    def draw(self, chosen: IndexArray, others: _Others) -> IndexArray:
        """Draw the halves of chosen quads, and approximate what changes by that, as before any were drawn where nothing
        does. Only the first call may choose quads that the one before did not. Returns the leaves that exceed the limit
        beside them."""
        plan, tree, is_first = self._plan, self._plan.tree, not len(self._chosen)
        gone = self._children(np.setdiff1d(self._chosen, chosen, assume_unique=True))
        beside = others.changed()
        self._record_before(np.setdiff1d(self._beside, beside))
        new = np.setdiff1d(beside, self._beside, assume_unique=True)
        self._before.append((new, plan.approximations.alone(new)))
        others.record(self._corners, new)
        plan.approximated.put(gone)
        whole = np.flatnonzero(~others.corners[tree.midpoints] & (tree.midpoints != NONE))
        now, then = (self._possible.are_split(chosen, corners) for corners in (others.corners, self._corners))
        halves = self._halves[:, chosen]
        tree.halve(halves, whole)
        for own, approximation, differ in zip(
            halves, self._possible.approximations(chosen, now), is_first | (now != then), strict=True
        ):
            plan.record(own[differ], approximation.at(np.flatnonzero(differ)))
        self._chosen, self._beside, self._corners = chosen, beside, others.corners
        plan.report()
        return bound_along_surface(plan)

    def _children(self, chosen: IndexArray) -> IndexArray:
        return self._plan.tree.children_of_quads(self._possible.quads[chosen]).ravel()

    def _record_before(self, leaves: IndexArray) -> None:
        """Record how leaves were approximated before any halves were drawn."""
        for nodes, approximation in reversed(self._before):
            chosen = np.flatnonzero(np.isin(nodes, leaves))
            self._plan.record(nodes[chosen], approximation.at(chosen))


def _settle(plan: Plan, possible: _Halves, chosen: IndexArray, others: _Others) -> IndexArray:
    """Those of the chosen quads that can be halved together, so that the leaves beside them are within the limit alone.

    Fewer and fewer: each that cannot adds corners, and only quads with new corners at their sides are tested again.
    """
    is_chosen = np.zeros(len(possible.quads), dtype=bool)
    is_chosen[chosen] = True
    changed = unbounded = chosen
    while True:
        failed = changed[possible.are_refused(changed, others.corners)]
        if not len(failed):
            failed = unbounded[possible.exceed(plan, unbounded, others.corners)]
            unbounded = unbounded[:0]
            if not len(failed) and not others.approximate():
                return np.flatnonzero(is_chosen)
        is_chosen[failed] = False
        others.put_children(possible.quads[failed])
        changed = possible.beside(others.take_new_corners())
        changed = changed[is_chosen[changed]]
        unbounded = np.union1d(unbounded[is_chosen[unbounded]], changed)


class _Halves:
    """Two halves of each of P quads, bicubic, whose children are leaves; within the limit while their sides are whole.

    quads: (P,) nodes, ascending; sides: (P,) the side, 0 or 1, that they lie along, and along the one across. ends:
    (2, P) the vertices at the middles of the sides where they end.
    """

    def __init__(self, tree: Quadtree, quads: IndexArray, sides: IndexArray, whole: list[LeafApproximation]) -> None:
        """whole: how to approximate the first halves with their sides whole, (P,), and the second."""
        self.quads, self.sides = quads, sides
        self._whole = whole
        # The same with their outer long sides split, where that has been found.
        self._split = [LeafApproximation.none(len(quads)) for _ in range(2)]
        self._is_found = np.zeros((2, len(quads)), dtype=bool)
        slots = [tree.first_slots(quads) + (sides + turn) % 4 for turn in range(4)]
        first = tree.first_child[quads]
        of_children = [tree.first_slots(first + (sides + turn) % 4) for turn in range(4)]
        self._tree, self._edges = tree, tree.edges_by_midpoint()
        self._numbers = np.full(len(tree.first_child), NONE, dtype=np.int32)
        self._numbers[quads] = self._numbers[first] = np.arange(len(quads))
        for turn in (1, 2, 3):
            self._numbers[first + turn] = self._numbers[first]
        self._middles = tree.midpoints[tree.slot_edges[np.stack([slots[0], slots[2]])]]
        self.ends = tree.midpoints[tree.slot_edges[np.stack([slots[1], slots[3]])]]
        outer = [slot + side for slot in of_children for side in (0, 3)]
        self._finer = tree.midpoints[tree.slot_edges[np.stack(outer)]]

    def beside(self, vertices: IndexArray) -> IndexArray:
        """Those with a side of theirs or of their children that has one of these vertices at its middle, ascending:
        only these may be refused, or exceed the limit, as the vertices are corners now."""
        edges = self._edges[vertices]
        numbers = self._numbers[self._tree.nodes_along(edges[edges != NONE])]
        return np.unique(numbers[numbers != NONE])

    def are_refused(self, chosen: IndexArray, corners: BoolArray) -> BoolArray:
        """(chosen,) where a long side would be split more than once; where a short side is split, as triangles there
        would be thinner than the half; or where both halves have a split side, and so make no fewer faces than the
        leaves. corners: as in ``_Others``."""
        return corners[self._finer[:, chosen]].any(axis=0) | corners[self._middles[:, chosen]].all(axis=0)

    def exceed(self, plan: Plan, chosen: IndexArray, corners: BoolArray) -> BoolArray:
        """(chosen,) where a half exceeds the limit with its long side split. At most one of the two has it split."""
        split = self.are_split(chosen, corners)
        halves, places = np.nonzero(split & ~self._is_found[:, chosen])
        new = chosen[places]
        found = _approximate(plan, self.quads[new], self.sides[new] + 2 * halves, is_split=True)
        for half in (0, 1):
            own = np.flatnonzero(halves == half)
            self._is_found[half, new[own]] = True
            self._split[half].put(new[own], found.at(own))
        accepted = np.stack([found.accepted[chosen] for found in self._split])
        return np.any(split & ~accepted, axis=0)

    def are_split(self, chosen: IndexArray, corners: BoolArray) -> BoolArray:
        """(2, chosen): whether the outer long side is split, of the first halves and of the second."""
        return corners[self._middles[:, chosen]]

    def have_bounds(self, chosen: IndexArray) -> BoolArray:
        """(chosen,) whether both halves are within the limit at equal parameters, however their sides are split."""
        found = [own.bounds[chosen] for own in (*self._whole, *self._split)]
        is_found = [np.ones((2, len(chosen)), dtype=bool), self._is_found[:, chosen]]
        return np.all(np.isfinite(found) | ~np.concatenate(is_found), axis=0)

    def approximations(self, chosen: IndexArray, are_split: BoolArray) -> Iterator[LeafApproximation]:
        """(chosen,) of the first halves, and of the second."""
        for whole, split, is_split in zip(self._whole, self._split, are_split, strict=True):
            found = whole.at(chosen)
            found.put(np.flatnonzero(is_split), split.at(chosen[is_split]))
            yield found


def _approximate(plan: Plan, quads: IndexArray, sides: IndexArray, *, is_split: bool) -> LeafApproximation:
    """How to approximate the halves of quads (P,) along sides (P,), one of each, by themselves alone. is_split: whether
    these sides are."""
    found = LeafApproximation.none(len(quads))
    order = np.argsort(quads)
    for cells in in_blocks(_halves_along(plan, quads, sides)):
        hanging = np.zeros((len(cells.nodes), 4), dtype=bool)
        hanging[:, 0] = is_split
        own = plan.approximate(cells, hanging.ravel())
        found.put(order[np.searchsorted(quads, cells.nodes, sorter=order)], own)
        plan.report()
    return found


def _halves_along(plan: Plan, quads: IndexArray, sides: IndexArray) -> Iterator[BicubicCells]:
    """The halves of quads (P,) along sides (P,), but for quads that are not bicubic, with the quads as their nodes."""
    for side in range(4):
        own = quads[sides == side]
        for cells in plan.cells.of(own) if len(own) else ():
            if isinstance(cells, BicubicCells):
                yield cells.halves(side, cells.nodes)


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
    quads, sides, whole = quads[likely], off[:, likely].argmin(axis=0), list[LeafApproximation]()
    for half in (0, 1):
        found = _approximate(plan, quads, sides + 2 * half, is_split=False)
        done = np.flatnonzero(found.accepted)
        quads, sides, whole = quads[done], sides[done], [own.at(done) for own in (*whole, found)]
    return _Halves(plan.tree, quads, sides, whole)


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

    def __init__(self, plan: Plan, stays: BoolArray, quads: IndexArray, ends: IndexArray, *, alone: bool) -> None:
        """quads: those to be halved, and ends: as in ``_Halves``, of these. alone: whether leaves with fewer split
        sides have to be within the limit without their neighbours."""
        self._plan, self._tree, self._alone = plan, plan.tree, alone
        tree, is_leaf = self._tree, self._tree.first_child == NONE
        is_leaf[tree.children_of_quads(quads)] = False
        self.corners = np.zeros(len(tree.vertex_edges) + 1, dtype=bool)
        self._new_corners: list[IndexArray] = []
        self._put_corners(np.concatenate([np.flatnonzero(is_leaf), quads]))
        self.corners[ends] = True
        self._keep_sides(np.flatnonzero(stays))
        self._new_corners = []
        self._beside = self._changed(np.flatnonzero(is_leaf))[0]
        self._split_sides = np.full(len(tree.first_child), NONE, dtype=np.int32)
        self._found: list[tuple[IndexArray, LeafApproximation]] = []

    def put_children(self, quads: IndexArray) -> None:
        """Add the children of quads that are not halved after all."""
        children = self._tree.children_of_quads(quads).ravel()
        self._put_corners(children)
        self._beside = np.concatenate([self._beside, children])

    def take_new_corners(self) -> IndexArray:
        """The vertices that have become corners since the last call; some may be there several times."""
        new, self._new_corners = self._new_corners, []
        return np.concatenate([np.zeros(0, dtype=np.intp), *new])

    def _put_corners(self, nodes: IndexArray) -> None:
        self._put(self._tree.slot_vertices[self._tree.slots(nodes)])

    def _keep_sides(self, leaves: IndexArray) -> None:
        """Keep the midpoints of split sides of some leaves."""
        tree = self._tree
        vertices = tree.midpoints[tree.slot_edges[tree.slots(leaves)]]
        self._put(vertices[vertices != NONE])

    def _put(self, vertices: IndexArray) -> None:
        new = vertices[~self.corners[vertices]]
        self.corners[new] = True
        self._new_corners.append(new)

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
            if self._alone:
                own.accepted[np.isinf(own.bounds)] = False
            self._found.append((cells.nodes, own))
            exceeding.append(cells.nodes[~own.accepted])
            plan.report()
        for nodes in exceeding:
            self._keep_sides(nodes)
        return any(len(nodes) for nodes in exceeding)

    def changed(self) -> IndexArray:
        """Those that have fewer split sides than in the tree."""
        return self._changed(self._beside)[0]

    def record(self, before: BoolArray, new: IndexArray) -> None:
        """Record the last approximations of those that have fewer split sides than in the tree, where these are not
        those they had with other corners before, or where they are new."""
        changed = self.changed()
        for nodes, approximation in self._found:
            differ = self._differ(nodes, before) | np.isin(nodes, new)
            chosen = np.flatnonzero(np.isin(nodes, changed) & differ)
            self._plan.record(nodes[chosen], approximation.at(chosen))

    def _differ(self, leaves: IndexArray, before: BoolArray) -> BoolArray:
        """(leaves,) whether other sides of theirs are split than with the corners before."""
        tree, counts = self._tree, self._tree.slot_counts(leaves)
        middles = tree.midpoints.take(tree.slot_edges.take(tree.slots(leaves)))
        return any_of_slots(self.corners.take(middles) != before.take(middles), counts)
