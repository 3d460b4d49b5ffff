# SPDX-License-Identifier: GPL-3.0-or-later
"""The first phase of a plan: nodes are split while their own bounds, drawn with whole sides, exceed the limit.

All functions work in steps and yield how many leaves there are so far.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable

import numpy as np

from ..arrays.chunks import blocks
from ..arrays.types import BoolArray, FloatArray
from .cells.cell_store import in_blocks, some
from .cells.patch_cells import BicubicCells, NetCells
from .leaf_approximation import Cells
from .plan import Plan
from .quadtree import NONE

# So many bicubic cells are kept in one block, of which so many are looked at together: what is made on the way stays in
# the processor's cache, and in memory that need not come from the system anew.
CELLS_KEPT_TOGETHER = 1 << 15
PARENTS_AT_ONCE = 1 << 12

# So many take about a tenth of a second, after which progress is told.
NODES_SPLIT_AT_ONCE = 1 << 16


def grow(plan: Plan, unfinished: list[Cells]) -> Generator[int, None, None]:
    """Split the nodes of cells that do not fit, if they are whole yet, and so their children, level by level."""
    tree = plan.tree
    while unfinished:
        nodes = plan.whole_of(np.concatenate([cells.nodes for cells in unfinished]))
        expected = plan.expected_leaves(nodes)
        plan.refuse_too_many(len(nodes), expected)
        tree.reserve(min(expected, plan.request.most_faces))
        for part in blocks(len(nodes), NODES_SPLIT_AT_ONCE):
            plan.split(nodes[part])
            yield tree.leaf_count
        unfinished = yield from approximate_children(plan, unfinished)


def approximate_children(plan: Plan, parents: list[Cells]) -> Generator[int, None, list[Cells]]:
    """Fit the children of cells whose nodes have been split; those that do not fit, or have been split as well."""
    unfinished: list[Cells] = []
    doubtful: list[Cells] = []
    with_nets = (cells for cells in parents if isinstance(cells, NetCells))
    for cells in in_blocks(with_nets, CELLS_KEPT_TOGETHER):
        plan.cells.put(cells)
        if isinstance(cells, BicubicCells):
            is_doubtful, is_unfinished = yield from _approximate_through_parents(plan, cells)
            doubtful += cells.children(plan.tree, is_doubtful)
            unfinished += cells.children(plan.tree, is_unfinished)
        else:
            assert isinstance(cells, NetCells)
            _place(plan, cells, cells.points())
            doubtful += cells.children(plan.tree)
    unfinished += yield from approximate_new(plan, doubtful, are_made_again=True)
    others = (cells for cells in parents if not isinstance(cells, NetCells))
    unfinished += yield from approximate_new(plan, (child for cells in others for child in cells.children(plan.tree)))
    return unfinished


def approximate_new(
    plan: Plan, cells: Iterable[Cells], *, are_made_again: bool = False
) -> Generator[int, None, list[Cells]]:
    """Fit and record the cells of new leaves, with their sides whole; those that do not fit, or whose nodes are split
    already.

    are_made_again: whether they are found later from their parents' nets, so that they are not kept (``CellStore``).
    """
    unfinished: list[Cells] = []
    tree = plan.tree
    for block in in_blocks(cells):
        is_leaf = tree.first_child[block.nodes] == NONE
        unfinished += some(block, ~is_leaf)
        for leaves in some(block, is_leaf):
            approximation = plan.approximate(leaves, np.zeros(tree.slot_counts(leaves.nodes).sum(), dtype=bool))
            plan.record(leaves.nodes, approximation)
            is_done = approximation.accepted & plan.has_least_level(leaves.nodes)
            if not are_made_again:
                for kept in some(leaves, is_done):
                    plan.cells.put(kept)
            unfinished += some(leaves, ~is_done)
        yield tree.leaf_count
    return unfinished


def _approximate_through_parents(
    plan: Plan, parents: BicubicCells
) -> Generator[int, None, tuple[BoolArray, BoolArray]]:
    """Fit and record the children of which a look at their parents tells whether they fit; of which it does not tell,
    and which do not fit or have been split, (4, P) bool each."""
    doubtful, unfinished = np.zeros((2, 4, len(parents.nodes)), dtype=bool)
    tree = plan.tree
    for part in blocks(len(parents.nodes), PARENTS_AT_ONCE):
        cells = parents.part(part)
        found = cells.approximate_children(plan.request.limit, plan.request.axes)
        nodes = tree.children_of_quads(cells.nodes).ravel()
        _place(plan, cells, found.points)
        is_leaf = tree.first_child[nodes] == NONE
        is_done = found.approximation.accepted & is_leaf & plan.has_least_level(nodes)
        is_unfinished = found.out_of_reach | (found.approximation.accepted & ~is_done)
        recorded = np.flatnonzero(is_leaf & (is_done | is_unfinished))
        plan.record(nodes[recorded], found.approximation.at(recorded))
        unfinished[:, part] = is_unfinished.reshape(4, -1)
        doubtful[:, part] = ~(is_done | is_unfinished).reshape(4, -1)
        yield tree.leaf_count
    return doubtful, unfinished


def _place(plan: Plan, cells: NetCells, points: FloatArray) -> None:
    """Keep where the points of split quads and their centres (9, P, 3) lie: the corners too of faces of the control
    mesh; those of others came with a split before, or else they are evaluated."""
    tree, nodes = plan.tree, cells.nodes
    slots = tree.slots(nodes).reshape(-1, 4)
    if np.any(turns := cells.turns()):
        slots = np.take_along_axis(slots, (np.arange(4) + turns[:, None]) % 4, axis=1)
    centres = tree.slot_vertices[tree.first_slots(tree.first_child[nodes]) + 2]
    plan.positions.put(np.vstack([tree.midpoints[tree.slot_edges[slots.T]], centres]), points[4:])
    faces = np.flatnonzero(nodes < tree.mesh.face_count)
    if len(faces):
        plan.positions.put(tree.slot_vertices[slots[faces].T], points[:4, faces])
