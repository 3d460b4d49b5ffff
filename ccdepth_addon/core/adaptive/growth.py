# SPDX-License-Identifier: GPL-3.0-or-later
"""The first phase of a plan: nodes are split while their own bounds, with whole sides, exceed the limit."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray
from .cells.cell_store import in_blocks, some
from .cells.patch_cells import BicubicCells, NetCells
from .leaf_approximation import Cells
from .plan import Plan
from .quadtree import NONE


def grow(plan: Plan, unfinished: list[Cells]) -> None:
    """Split the nodes of unfinished cells, if not split yet, and then their unfinished children, level by level."""
    tree = plan.tree
    while unfinished:
        nodes = plan.whole_of(np.concatenate([cells.nodes for cells in unfinished]))
        expected = plan.expected_leaves(nodes)
        plan.refuse_too_many(len(nodes), expected)
        tree.reserve(min(expected, plan.request.most_faces))
        for part in chunks(len(nodes), AT_ONCE):
            plan.split(nodes[part])
            plan.report()
        unfinished = approximate_children(plan, unfinished)


def approximate_children(plan: Plan, parents: list[Cells]) -> list[Cells]:
    """Approximate the children of cells whose nodes have been split. Returns those that exceed the limit, or have been
    split as well."""
    unfinished: list[Cells] = []
    doubtful: list[Cells] = []
    with_nets = (cells for cells in parents if isinstance(cells, NetCells))
    for cells in in_blocks(with_nets):
        plan.cells.put(cells)
        if isinstance(cells, BicubicCells):
            is_doubtful, is_unfinished = _approximate_through_parents(plan, cells)
            doubtful += cells.children(plan.tree, is_doubtful)
            unfinished += cells.children(plan.tree, is_unfinished)
        else:
            assert isinstance(cells, NetCells)
            _place(plan, cells, cells.points())
            doubtful += cells.children(plan.tree)
    unfinished += approximate_new(plan, doubtful)
    others = (cells for cells in parents if not isinstance(cells, NetCells))
    unfinished += approximate_new(plan, (child for cells in others for child in cells.children(plan.tree)))
    return unfinished


def approximate_new(plan: Plan, cells: Iterable[Cells]) -> list[Cells]:
    """Approximate and record the cells of new leaves, with their sides whole. Returns those that exceed the limit, or
    whose nodes are split already."""
    unfinished: list[Cells] = []
    tree = plan.tree
    for block in in_blocks(cells):
        is_leaf = tree.first_child[block.nodes] == NONE
        unfinished += some(block, ~is_leaf)
        for leaves in some(block, is_leaf):
            approximation = plan.approximate(leaves, np.zeros(tree.slot_counts(leaves.nodes).sum(), dtype=bool))
            plan.record(leaves.nodes, approximation)
            is_done = approximation.accepted & plan.has_least_level(leaves.nodes)
            for kept in some(leaves, is_done):
                plan.cells.put(kept)
            unfinished += some(leaves, ~is_done)
        plan.report()
    return unfinished


def _approximate_through_parents(plan: Plan, parents: BicubicCells) -> tuple[BoolArray, BoolArray]:
    """Approximate and record the children for which their parents' coefficients decide. Returns, (4, P) bool each,
    those for which they do not, and those that exceed the limit or have been split."""
    tree = plan.tree
    found = parents.approximate_children(plan.request.limit, plan.request.axes)
    nodes = tree.children_of_quads(parents.nodes).ravel()
    _place(plan, parents, found.points)
    is_leaf = tree.first_child[nodes] == NONE
    is_done = found.approximation.accepted & is_leaf & plan.has_least_level(nodes)
    is_unfinished = found.out_of_reach | (found.approximation.accepted & ~is_done)
    recorded = np.flatnonzero(is_leaf & (is_done | is_unfinished))
    plan.record(nodes[recorded], found.approximation.at(recorded))
    plan.report()
    return ~(is_done | is_unfinished).reshape(4, -1), is_unfinished.reshape(4, -1)


def _place(plan: Plan, cells: NetCells, points: FloatArray) -> None:
    """Record the positions of split quads' points and centres (9, P, 3); of corners only those of the control mesh's
    faces, as others have been recorded by a split before, or will be evaluated."""
    tree, nodes = plan.tree, cells.nodes
    slots = tree.slots(nodes).reshape(-1, 4)
    if np.any(turns := cells.turns()):
        slots = np.take_along_axis(slots, (np.arange(4) + turns[:, None]) % 4, axis=1)
    centres = tree.slot_vertices[tree.first_slots(tree.first_child[nodes]) + 2]
    plan.positions.put(np.vstack([tree.midpoints[tree.slot_edges[slots.T]], centres]), points[4:])
    faces = np.flatnonzero(nodes < tree.mesh.face_count)
    if len(faces):
        plan.positions.put(tree.slot_vertices[slots[faces].T], points[:4, faces])
