# SPDX-License-Identifier: GPL-3.0-or-later
"""Cells found by their nodes: against the nets of whole meshes, refined level by level."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.cells.cell_store import CellStore, in_blocks
from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells, ExtraordinaryCells, NetCells
from ccdepth_addon.core.adaptive.quadtree import Quadtree
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.bicubic import patch_coefficients
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import (
    PatchKind,
    PatchKinds,
    classify_patches,
    extraordinary_nets,
    regular_nets,
)
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes

pytestmark = pytest.mark.thorough

VALENCE = 5
DEEPEST = 4


@dataclass(frozen=True)
class Level:
    """A control mesh refined so often, all faces at once: face 4f + s is the child of face f at its corner s."""

    mesh: PolygonMesh
    kinds: PatchKinds

    def net(self, face: int) -> tuple[int, FloatArray]:
        """The slot from which the net of a face is counted, and the net."""
        if self.kinds.kinds[face] == PatchKind.REGULAR:
            return 0, patch_coefficients(regular_nets(self.mesh, np.array([face]))).reshape(16, 3)
        corner = int(self.kinds.extraordinary_corners[face])
        valence = int(self.mesh.vertex_face_counts[self.mesh.corner_vertices[corner]])
        slot = corner - int(self.mesh.face_starts[face])
        return slot, extraordinary_nets(self.mesh, np.array([corner]), valence).reshape(-1, 3)


def refined(mesh: PolygonMesh) -> list[Level]:
    levels = [Level(mesh, classify_patches(mesh))]
    for _ in range(DEEPEST):
        mesh = subdivide(mesh).mesh
        levels.append(Level(mesh, classify_patches(mesh)))
    return levels


def faces_of_nodes(tree: Quadtree) -> IndexArray:
    """(nodes,) the face that each node is in the mesh of its level."""
    faces = np.arange(len(tree.parents))
    for level in range(1, int(tree.levels.max()) + 1):
        nodes = np.flatnonzero(tree.levels == level)
        parents = tree.parents[nodes]
        faces[nodes] = 4 * faces[parents] + nodes - tree.first_child[parents]
    return faces


def assert_found(store: CellStore, tree: Quadtree, levels: list[Level], nodes: IndexArray) -> None:
    """Each node once, with the net of its face in the mesh of its level."""
    found: list[int] = []
    faces, largest = faces_of_nodes(tree), np.abs(levels[0].mesh.positions).max()
    # docs/adaptive.md, Rounding: m(s + 9) + 40 roundings at level m, on either side.
    rounding = 2 * (DEEPEST * (2 * VALENCE + 1 + 9) + 40) * 2.0**-53 * largest
    for cells in store.of(nodes):
        assert isinstance(cells, NetCells)
        found += cells.nodes.tolist()
        for place, node in enumerate(cells.nodes.tolist()):
            slot, net = levels[tree.levels[node]].net(faces[node])
            assert slot == cells.slots[place]
            np.testing.assert_allclose(cells.nets[:, place], net, rtol=0, atol=rounding)
    assert sorted(found) == sorted(nodes.tolist())


@pytest.mark.parametrize("seed", range(3))
def test_cells_have_the_nets_of_the_refined_mesh(seed: int) -> None:
    """Cells that were put into the store, and their children, which it makes when they are needed."""
    generator = np.random.default_rng(seed)
    poles = meshes.to_polygon_mesh(meshes.bumpy(meshes.trapezohedron(VALENCE), 0.2))
    # One step apart, no face has two extraordinary corners.
    mesh = subdivide(apply_boundary_rule(poles, smooth_corners=True)).mesh
    tree, levels = Quadtree(mesh), refined(mesh)
    store = CellStore(tree)
    waiting, available = [*cells_of_faces(mesh)], np.zeros(0, dtype=np.intp)
    kinds = set()
    while waiting and len(available) < 600:
        cells = waiting.pop(0)
        assert isinstance(cells, NetCells)
        kinds.add(type(cells))
        store.put(cells)
        available = np.union1d(available, cells.nodes)
        shallow = np.flatnonzero(tree.levels[cells.nodes] < DEEPEST)
        if not len(shallow):
            continue
        parents = cells.at(np.sort(generator.permutation(shallow)[: 1 + len(shallow) // 2]))
        tree.split(parents.nodes)
        children = [*parents.children(tree)]
        available = np.union1d(available, np.concatenate([block.nodes for block in children]))
        waiting += in_blocks(children)
        assert_found(store, tree, levels, generator.choice(available, len(available) // 4, replace=False))
    assert kinds == {BicubicCells, ExtraordinaryCells}
    assert tree.levels.max() >= 3
    assert_found(store, tree, levels, available)
    assert_found(store, tree, levels, np.zeros(0, dtype=np.intp))


@pytest.mark.parametrize("valence", [5, 9])
def test_children_of_quads_with_several_extraordinary_corners(valence: int) -> None:
    """Quads of which each has such a pole and three corners of valence 3."""
    poles = meshes.to_polygon_mesh(meshes.bumpy(meshes.trapezohedron(valence), 0.2))
    mesh = apply_boundary_rule(poles, smooth_corners=True)
    (cells,) = cells_of_faces(mesh)
    assert isinstance(cells, ExtraordinaryCells)
    assert sorted(cells.valences) == [3, 3, 3, valence]
    tree, refinement = Quadtree(mesh), subdivide(mesh).mesh
    tree.split(cells.nodes)
    limits, seen = limit_positions(refinement), 0
    for block in cells.children(tree):
        faces = faces_of_nodes(tree)[block.nodes]
        corners = refinement.face_starts[faces] + (block.slots + np.arange(4)[:, None]) % 4
        # Sums of some tens of coordinates below 4.
        wanted = limits[refinement.corner_vertices[corners]]
        np.testing.assert_allclose(block.points()[:4], wanted, rtol=0, atol=1e-13)
        seen += len(block.nodes)
    assert seen == refinement.face_count
