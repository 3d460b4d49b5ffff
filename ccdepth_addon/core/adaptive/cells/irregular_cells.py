# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of a quadtree represented by the refined mesh, with the neighbours it needs; and their children."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...arrays.ranges import ranges
from ...arrays.types import FloatArray, IndexArray
from ...arrays.vectors import selected_vectors
from ...distance.leaf_surfaces import Tiles, tiles_of
from ...surface.patches import classify_patches
from ...surface.refinement import Refinement
from ...surface.stencils import by_valence, by_valences
from ..leaf_approximation import Cells
from ..leaf_bounds.descent import Descent
from ..leaf_bounds.irregular_bounds import template_distances
from ..quadtree import Quadtree
from .patch_cells import LEAST_OF_A_KIND, BicubicCells, ExtraordinaryCells
from .quad_cells import QuadCells


@dataclass(frozen=True)
class RefinedCells(QuadCells):
    """Quads that are neither bicubic nor have a net, by the refined mesh: descendant i is ``nodes[i]``."""

    nodes: IndexArray
    refinement: Refinement

    @cached_property
    def descent(self) -> Descent:
        """Their descendants, as far as they have been asked for."""
        return Descent.of_quads(self.refinement)

    def joined(self, others: Sequence[RefinedCells]) -> RefinedCells:
        """These and others as one block."""
        blocks = [self, *others]
        nodes = np.concatenate([each.nodes for each in blocks])
        return RefinedCells(nodes, Refinement.joined([each.refinement for each in blocks]))

    def scratch(self) -> RefinedCells:
        return replace(self)

    def at(self, chosen: IndexArray) -> RefinedCells:
        wanted = np.zeros(len(self.nodes), dtype=bool)
        wanted[chosen] = True
        places = np.sort(chosen)
        return RefinedCells(self.nodes[places], self.refinement.keep(wanted).numbered())

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        return refined_children(tree, self.nodes, self.refinement, LEAST_OF_A_KIND)

    def turns(self) -> IndexArray:
        return np.zeros_like(self.nodes)

    def points(self) -> FloatArray:
        return _points_of_quads(self.refinement, self.refinement.limits_at_corners)

    def tiles(self, levels: int) -> Iterator[Tiles]:
        return tiles_of(self.refinement, levels)

    def distances_of(self, chosen: IndexArray, numbers: IndexArray, points: FloatArray, limit: float) -> FloatArray:
        return template_distances(self.descent, chosen, selected_vectors(points, chosen), numbers, limit)


def refined_children(
    tree: Quadtree, nodes: IndexArray, refinement: Refinement, least_of_a_kind: int
) -> Iterator[Cells]:
    """The cells of the children of nodes; least_of_a_kind: as in ``cells_of_refinement``."""
    sizes = refinement.mesh.face_sizes[: len(nodes)]
    children = ranges(tree.first_child[nodes], sizes)
    return cells_of_refinement(children, refinement.refined().numbered(), least_of_a_kind)


def cells_of_refinement(nodes: IndexArray, refinement: Refinement, least_of_a_kind: int) -> Iterator[Cells]:
    """Descendants, all quads, as cells: descendant i is ``nodes[i]``. Of quads with several extraordinary corners at
    least so many of a kind have nets."""
    mesh = refinement.mesh
    kinds = classify_patches(mesh)
    regular, extraordinary, rest = by_valence(mesh, kinds, len(nodes))
    if len(regular):
        yield BicubicCells.of_faces(mesh, regular, nodes[regular])
    for valence, faces in extraordinary:
        yield ExtraordinaryCells.of_faces(mesh, (valence, 4, 4, 4), kinds.extraordinary_corners[faces], nodes[faces])
    inside, rest = by_valences(mesh, kinds, rest, least_of_a_kind)
    for valences, corners in inside:
        yield ExtraordinaryCells.of_faces(mesh, valences, corners, nodes[mesh.corner_faces[corners]])
    if len(rest):
        wanted = np.zeros(len(nodes), dtype=bool)
        wanted[rest] = True
        yield RefinedCells(nodes[rest], refinement.keep(wanted).numbered())


def _points_of_quads(refinement: Refinement, corners: FloatArray) -> FloatArray:
    """(9, P, 3): the points of quads and their centres, from the limits at their corners (4P, 3)."""
    middles, centres = refinement.limits_inside()
    by_quad = [corners.reshape(-1, 4, 3), middles.reshape(-1, 4, 3), centres.reshape(-1, 4, 3)[:, :1]]
    return np.concatenate(by_quad, axis=1).swapaxes(0, 1)
