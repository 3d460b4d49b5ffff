# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface over the nodes of a tree.

A bicubic node is a rectangle of a bicubic patch, with one set of Bernstein coefficients for all nodes of the patch. Any
other node, a quad with an irregular vertex or a face other than a quad, is part of a refinement of the mesh. Quartering
such a node refines that mesh once more, and children that are then bicubic become patches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.column import Column
from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.touching_faces import surface_boxes
from ..surface.bicubic import cubic_blossoms, patch_coefficients
from ..surface.patches import PatchKind, classify_patches, regular_nets
from ..surface.refinement import Refinement
from .rectangle_tree import NONE, QUARTERS, RectangleTree

# Faces refined together.
FACES_AT_ONCE = 1 << 14

# A function of intervals (n,) that returns rows (R, 4, n), functionals of a cubic's Bernstein coefficients.
RowsOver = Callable[[FloatArray, FloatArray], FloatArray]

# The corners, the middles of the sides and the centre of a quad, as indices of (3, 3) places, u first.
PLACES = np.array([0, 6, 8, 2, 3, 7, 5, 1, 4])


@dataclass(frozen=True)
class _Block:
    """Nodes that are not bicubic; descendant i of the refinement is ``nodes[i]``."""

    nodes: IndexArray
    refinement: Refinement


class NodeSurfaces:
    """The surface over the nodes of a tree. The tree reports splits by ``follow``."""

    def __init__(self, tree: RectangleTree) -> None:
        self._tree = tree
        self._patches, self._blocks, self._places = (tree.add_column(np.int32(NONE)) for _ in range(3))
        # For each patch the node over the whole patch, and the coefficients, (4, 4, 3), u first.
        self._roots = Column(np.zeros(0, dtype=np.intp))
        self._coefficients = Column(np.zeros((0, 48)))
        self._refined: list[_Block] = []
        mesh = tree.mesh
        patches = classify_patches(mesh)
        regular, rest = np.flatnonzero(patches.kinds == PatchKind.REGULAR), patches.kinds != PatchKind.REGULAR
        for faces in index_chunks(regular, FACES_AT_ONCE):
            self._put_patches(faces, regular_nets(mesh, faces))
        for some in (rest & (mesh.face_sizes == 4), rest & (mesh.face_sizes != 4)):
            for faces in index_chunks(np.flatnonzero(some), FACES_AT_ONCE):
                self._put_block(faces, Refinement.start(mesh, faces))

    def are_bicubic(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) bool."""
        found: BoolArray = self._patches.values[nodes] != NONE
        return found

    def follow(self, nodes: IndexArray, way: int) -> None:
        """Find the surface over the children of nodes that have been split in this way: ``QUARTERS`` if and only if
        they are not bicubic."""
        if way != QUARTERS:
            self._patches.values[self._tree.children(nodes)] = np.repeat(self._patches.values[nodes], 2)
            return
        for wanted, block in self._wanted(nodes):
            refinement = block.refinement.keep(wanted).refined().numbered()
            children, mesh = self._tree.children(block.nodes[wanted]), refinement.mesh
            patches = classify_patches(mesh)
            is_regular = patches.kinds[: len(children)] == PatchKind.REGULAR
            regular, rest = np.flatnonzero(is_regular), ~is_regular
            self._put_patches(children[regular], regular_nets(mesh, regular))
            if np.any(rest):
                self._put_block(children[rest], refinement.keep(rest).numbered())

    def refinements(self, nodes: IndexArray) -> Iterator[tuple[IndexArray, Refinement]]:
        """The nodes among some (n,) that are not bicubic, either all quads or none: batches of indices, each with a
        refinement whose descendants are these nodes."""
        places = np.argsort(nodes, kind="stable")
        found = [
            (block.nodes[wanted], block.refinement.keep(wanted).numbered()) for wanted, block in self._wanted(nodes)
        ]
        if found:
            all_nodes = np.concatenate([own for own, _ in found])
            parts = [each for _, each in found]
            refinement = parts[0] if len(parts) == 1 else Refinement.joined(parts)
            yield places[np.searchsorted(nodes[places], all_nodes)], refinement

    def points(self, quads: IndexArray) -> FloatArray:
        """(9, n, 3), component-major: the points of quads on the surface, as ``templates.QUAD_POINTS``, and their
        centres."""
        found = np.empty((9, 3, len(quads)))
        bicubic = self.are_bicubic(quads)
        chosen = np.flatnonzero(bicubic)
        if len(chosen):
            values = self._transformed(quads[chosen], _values)
            found[:, :, chosen] = values.reshape(9, 3, -1)[PLACES]
        chosen = np.flatnonzero(~bicubic)
        for own, refinement in self.refinements(quads[chosen]):
            found[:, :, chosen[own]] = points_of_quads(refinement).swapaxes(1, 2)
        return found.swapaxes(1, 2)

    def coefficients(self, quads: IndexArray) -> FloatArray:
        """(16, n, 3), component-major: the Bernstein coefficients over bicubic quads, [i, j] → 4i + j, u along i."""
        return self._transformed(quads, _subdivided).reshape(16, 3, -1).swapaxes(1, 2)

    def boxes(self, nodes: IndexArray) -> tuple[FloatArray, FloatArray]:
        """(3, n) twice: the ends of boxes around the surface over nodes."""
        low, high = np.empty((2, 3, len(nodes)))
        is_quad, is_bicubic = self._tree.is_quad(nodes), self.are_bicubic(nodes)
        own = np.flatnonzero(is_bicubic)
        coefficients = self.coefficients(nodes[own])
        low[:, own], high[:, own] = coefficients.min(axis=0).T, coefficients.max(axis=0).T
        for chosen in (np.flatnonzero(is_quad & ~is_bicubic), np.flatnonzero(~is_quad)):
            for places, refinement in self.refinements(nodes[chosen]):
                own = chosen[places]
                low[:, own], high[:, own] = (ends[:, : len(own)] for ends in surface_boxes(refinement.mesh))
        return low, high

    def _transformed(self, quads: IndexArray, rows_of: RowsOver) -> FloatArray:
        """(R, R, 3, n): the coefficients of patches transformed by rows (R, 4), for the intervals of quads along u and
        v."""
        patches = self._patches.values[quads]
        lower, sides = self._tree.rectangles(quads, self._roots.values[patches])
        along, across = (rows_of(low, low + side) for low, side in zip(lower, sides, strict=True))
        nets = np.ascontiguousarray(self._coefficients.values[patches].T).reshape(4, 4, 3, -1)
        halfway = sum(along[:, k, None, None] * nets[k] for k in range(4))
        found: FloatArray = sum(across[None, :, k, None] * halfway[:, k, None] for k in range(4))
        return found

    def _wanted(self, nodes: IndexArray) -> Iterator[tuple[BoolArray, _Block]]:
        """The blocks of nodes, each with the wanted nodes in the block."""
        numbers, places = self._blocks.values[nodes], self._places.values[nodes]
        for number in np.unique(numbers).tolist():
            block = self._refined[number]
            wanted = mask(len(block.nodes), places[numbers == number])
            yield wanted, block

    def _put_patches(self, nodes: IndexArray, nets: FloatArray) -> None:
        """Store the patches of nodes with nets (4, 4, P, 3)."""
        self._patches.values[nodes] = len(self._roots.values) + np.arange(len(nodes))
        self._roots.append(nodes)
        self._coefficients.append(np.moveaxis(patch_coefficients(nets), 2, 0).reshape(-1, 48))

    def _put_block(self, nodes: IndexArray, refinement: Refinement) -> None:
        self._blocks.values[nodes] = len(self._refined)
        self._places.values[nodes] = np.arange(len(nodes))
        self._refined.append(_Block(nodes, refinement))


def points_of_quads(refinement: Refinement) -> FloatArray:
    """(9, P, 3): the points of a refinement's quads, as in ``NodeSurfaces.points``."""
    middles, centres = refinement.limits_inside()
    corners = refinement.limits_at_corners
    by_quad = [corners.reshape(-1, 4, 3), middles.reshape(-1, 4, 3), centres.reshape(-1, 4, 3)[:, :1]]
    return np.concatenate(by_quad, axis=1).swapaxes(0, 1)


def _values(low: FloatArray, high: FloatArray) -> FloatArray:
    """(3, 4, n): the cubic Bernstein basis at both ends of intervals (n,) and half-way."""
    return np.stack([cubic_blossoms(np.stack([t, t, t])) for t in (low, (low + high) / 2, high)])


def _subdivided(low: FloatArray, high: FloatArray) -> FloatArray:
    """(4, 4, n): matrices from a cubic's Bernstein coefficients over [0, 1] to its coefficients over intervals (n,)."""
    ends = (low, low, low), (low, low, high), (low, high, high), (high, high, high)
    return np.stack([cubic_blossoms(np.stack(each)) for each in ends])
