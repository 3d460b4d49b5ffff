# SPDX-License-Identifier: GPL-3.0-or-later
"""The first phase of a plan: nodes are split while their own bounds, drawn with whole sides, exceed the limit.

All functions work in steps and yield how many leaves there are so far.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable

import numpy as np

from ..arrays.chunks import chunks
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


def grow(plan: Plan, unfit: list[Cells]) -> Generator[int, None, None]:
    """Split the nodes of cells that do not fit, if they are whole yet, and so their children, level by level."""
    tree = plan.tree
    while unfit:
        nodes = plan.whole_of(np.concatenate([cells.nodes for cells in unfit]))
        expected = plan.expected_leaves(nodes)
        plan.refuse_too_many(len(nodes), expected)
        tree.reserve(min(expected, plan.request.most_faces))
        for part in chunks(len(nodes), NODES_SPLIT_AT_ONCE):
            plan.split(nodes[part])
            yield tree.leaf_count
        unfit = yield from fit_children(plan, unfit)


def fit_children(plan: Plan, parents: list[Cells]) -> Generator[int, None, list[Cells]]:
    """Fit the children of cells whose nodes have been split; those that do not fit, or have been split as well."""
    unfit: list[Cells] = []
    doubtful: list[Cells] = []
    with_nets = (cells for cells in parents if isinstance(cells, NetCells))
    for cells in in_blocks(with_nets, CELLS_KEPT_TOGETHER):
        plan.cells.put(cells)
        if isinstance(cells, BicubicCells):
            is_doubtful, is_unfit = yield from _look_at_children(plan, cells)
            doubtful += cells.children(plan.tree, is_doubtful)
            unfit += cells.children(plan.tree, is_unfit)
        else:
            assert isinstance(cells, NetCells)
            _place(plan, cells, cells.points())
            doubtful += cells.children(plan.tree)
    unfit += yield from fit_new(plan, doubtful, are_made_again=True)
    others = (cells for cells in parents if not isinstance(cells, NetCells))
    unfit += yield from fit_new(plan, (child for cells in others for child in cells.children(plan.tree)))
    return unfit


def fit_new(plan: Plan, cells: Iterable[Cells], *, are_made_again: bool = False) -> Generator[int, None, list[Cells]]:
    """Fit and record the cells of new leaves, with their sides whole; those that do not fit, or whose nodes are split
    already.

    are_made_again: whether they are found later from their parents' nets, so that they are not kept (``CellStore``).
    """
    unfit: list[Cells] = []
    tree = plan.tree
    for block in in_blocks(cells):
        is_leaf = tree.first_child[block.nodes] == NONE
        unfit += some(block, ~is_leaf)
        for leaves in some(block, is_leaf):
            fit = plan.fit(leaves, np.zeros(tree.slot_counts(leaves.nodes).sum(), dtype=bool))
            plan.record(leaves.nodes, fit)
            fits = fit.fits & plan.has_least_level(leaves.nodes)
            if not are_made_again:
                for kept in some(leaves, fits):
                    plan.cells.put(kept)
            unfit += some(leaves, ~fits)
        yield tree.leaf_count
    return unfit


def _look_at_children(plan: Plan, parents: BicubicCells) -> Generator[int, None, tuple[BoolArray, BoolArray]]:
    """Fit and record the children of which a look at their parents tells whether they fit; of which it does not tell,
    and which do not fit or have been split, (4, P) bool each."""
    doubtful, unfit = np.zeros((2, 4, len(parents.nodes)), dtype=bool)
    tree = plan.tree
    for part in chunks(len(parents.nodes), PARENTS_AT_ONCE):
        cells = parents.part(part)
        found = cells.fit_children(plan.request.limit, plan.request.axes)
        nodes = tree.quarters(cells.nodes).ravel()
        _place(plan, cells, found.points)
        is_leaf = tree.first_child[nodes] == NONE
        is_done = found.fit.fits & is_leaf & plan.has_least_level(nodes)
        is_unfit = found.hopeless | (found.fit.fits & ~is_done)
        recorded = np.flatnonzero(is_leaf & (is_done | is_unfit))
        plan.record(nodes[recorded], found.fit.at(recorded))
        unfit[:, part] = is_unfit.reshape(4, -1)
        doubtful[:, part] = ~(is_done | is_unfit).reshape(4, -1)
        yield tree.leaf_count
    return doubtful, unfit


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
