# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells found by their nodes: against all that were ever made."""

from __future__ import annotations

import numpy as np

from ccdepth_addon.core.adaptive.cells.cell_store import CellStore, in_blocks
from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells, ExtraordinaryCells, NetCells
from ccdepth_addon.core.adaptive.quadtree import Quadtree
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes


def remember(nets: dict[int, tuple[int, FloatArray]], cells: NetCells) -> None:
    for place, node in enumerate(cells.nodes.tolist()):
        nets[node] = int(cells.slots[place]), cells.nets[:, place]


def assert_found(store: CellStore, nodes: list[int], nets: dict[int, tuple[int, FloatArray]]) -> None:
    """Each once, with its own net, counted from its own slot."""
    found: dict[int, tuple[int, FloatArray]] = {}
    for cells in store.of(np.array(nodes, dtype=np.intp)):
        assert isinstance(cells, NetCells)
        assert not found.keys() & {*cells.nodes.tolist()}
        remember(found, cells)
    assert found.keys() == {*nodes}
    for node, (slot, net) in found.items():
        assert slot == nets[node][0]
        # Sums of some dozens of products of the nets' coordinates.
        np.testing.assert_allclose(net, nets[node][1], rtol=0, atol=1e-14 * np.abs(net).max())


def test_cells_are_found_by_their_nodes() -> None:
    """Those put there, and the children of these, as they were when all children were made at once."""
    generator = np.random.default_rng(3)
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(meshes.bumpy(meshes.trapezohedron(5), 0.2)), smooth_corners=True)
    tree = Quadtree(mesh)
    store, nets = CellStore(tree), dict[int, tuple[int, FloatArray]]()
    waiting = [cells for cells in in_blocks(cells_of_faces(mesh)) if isinstance(cells, NetCells)]
    assert {type(cells) for cells in waiting} <= {BicubicCells, ExtraordinaryCells}
    while waiting and len(nets) < 3000:
        cells = waiting.pop(0)
        remember(nets, cells)
        store.put(cells)
        split = np.sort(generator.permutation(len(cells.nodes))[: 1 + len(cells.nodes) // 2])
        parents = cells.at(split)
        tree.split(parents.nodes)
        children = [*parents.children(tree)]
        for block in children:
            remember(nets, block)
        asked = generator.choice([*nets], len(nets) // 3, replace=False)
        assert_found(store, asked.tolist(), nets)
        waiting += in_blocks(children)
    assert_found(store, [*nets], nets)
    assert_found(store, [], nets)
