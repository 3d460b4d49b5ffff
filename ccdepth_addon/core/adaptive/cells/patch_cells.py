# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of a quadtree represented by a net of which every bound is a linear function (``triangle_bounds``).

They are bicubic, or have extraordinary corners, and quads alone around them.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, transformed_nets
from ...distance.leaf_surfaces import Tiles, tiles_around_vertex
from ...mesh.polygon_mesh import PolygonMesh
from ...surface.bicubic import HALVES, SPLINE_TO_BERNSTEIN, patch_coefficients, tensor
from ...surface.patches import regular_nets
from ...surface.squares import Squares
from ...surface.stencils import Valences, quad_nets, quad_stencils
from ..leaf_approximation import LeafApproximation
from ..leaf_bounds import triangle_bounds
from ..leaf_bounds.child_bounds import child_distances, corners_of_children
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..template_choice import choose_along_surface, folded_quads, sampled_heights
from ..templates import TURNS, WHOLE, template_groups
from .quad_cells import QuadCells, patterns_of

# Finer bounds save nearly all of the part that is not quadratic, and sometimes a little more. They are computed where
# the quadratic part is at most so many limits.
REFINABLE_QUADRATIC = 1.1

# Cells evaluated together: temporary arrays stay in cache, and in memory that the system need not provide anew.
CELLS_AT_ONCE = 1 << 12

# Of quads with several extraordinary corners as many alike have stencils of their own; fewer are refined together with
# others.
LEAST_OF_A_KIND = 8


def _child_matrices() -> list[FloatArray]:
    """Four of (16, 16): a bicubic quad's Bernstein coefficients → those of its child at each slot, in its own frame."""
    low, high = HALVES
    children = [np.kron(a, b).reshape(4, 4, 16) for a, b in ((low, low), (high, low), (high, high), (low, high))]
    return [np.ascontiguousarray(np.rot90(q, -turns).reshape(16, 16)) for turns, q in enumerate(children)]


CHILD_MATRICES = _child_matrices()


def _half_matrices() -> list[FloatArray]:
    """Four of (16, 16): the same for its halves along each side, in their own frames from the side's slot on."""
    (low, high), whole = HALVES, np.eye(4)
    halves = [np.kron(a, b).reshape(4, 4, 16) for a, b in ((whole, low), (high, whole), (whole, high), (low, whole))]
    return [np.ascontiguousarray(np.rot90(q, -turns).reshape(16, 16)) for turns, q in enumerate(halves)]


HALF_MATRICES = _half_matrices()

# The Bernstein coefficients of a bicubic quad in the order of the same quad counted from slot 0, 1, 2 or 3.
TURNED_COEFFICIENTS = [np.rot90(np.arange(16).reshape(4, 4), -turns).ravel() for turns in range(4)]
TO_BERNSTEIN = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN)


@dataclass(frozen=True)
class NetCells(QuadCells):
    """Quads with a net.

    nodes: (P,); slots: (P,) the slot the net is counted from; nets: (N, P, 3). valences: of their corners from the
    slot on; nets are of one kind where these are the same.
    """

    nodes: IndexArray
    slots: IndexArray
    nets: FloatArray
    valences: Valences = (4, 4, 4, 4)

    def joined(self, others: Sequence[NetCells]) -> Self:
        """These and others of the same kind as one block."""
        blocks: list[NetCells] = [self, *others]
        return replace(
            self,
            nodes=np.concatenate([block.nodes for block in blocks]),
            slots=np.concatenate([block.slots for block in blocks]),
            nets=np.concatenate([block.nets for block in blocks], axis=1),
        )

    def at(self, chosen: IndexArray) -> Self:
        return replace(
            self, nodes=self.nodes[chosen], slots=self.slots[chosen], nets=selected_vectors(self.nets, chosen)
        )

    def turns(self) -> IndexArray:
        return self.slots

    def points(self) -> FloatArray:
        return transformed_nets(self._to_points(), self.nets)

    @abstractmethod
    def children(self, tree: Quadtree, wanted: BoolArray | None = None) -> Iterator[NetCells]:
        """As in ``Cells``; all children, or the wanted ones, (4, P) by slot, with the same bits."""

    def distances_of(self, chosen: IndexArray, numbers: IndexArray, points: FloatArray, limit: float) -> FloatArray:
        found = np.empty(len(chosen))
        for pattern, alternative, own in template_groups(numbers):
            found[own] = self._distances_of_template(chosen[own], pattern, alternative, limit)
        return found

    @abstractmethod
    def _distances_of_template(self, chosen: IndexArray, pattern: int, alternative: int, limit: float) -> FloatArray:
        """``distances_of`` for one template."""

    @abstractmethod
    def _to_points(self) -> FloatArray:
        """(9, N): from a net to the quad's points and its centre."""


@dataclass(frozen=True)
class ChildApproximations:
    """The 4P children of P bicubic quads, those at slot 0 first. approximation: with whole sides, of the children that
    their parents' coefficients show to be within the limit, or that are sampled to be along the surface. out_of_reach:
    (4P,) bool, which are sampled to be neither. points: (9, P, 3), those of the quads themselves and their centres."""

    approximation: LeafApproximation
    out_of_reach: BoolArray
    points: FloatArray


class BicubicCells(NetCells):
    """Bicubic quads, by their 16 Bernstein coefficients [i, j] → 4i + j, u along i."""

    @staticmethod
    def of_faces(mesh: PolygonMesh, faces: IndexArray, nodes: IndexArray) -> BicubicCells:
        """From regular faces of a mesh."""
        coefficients = patch_coefficients(regular_nets(mesh, faces)).reshape(16, -1, 3)
        return BicubicCells(nodes, np.zeros_like(nodes), coefficients)

    def children(self, tree: Quadtree, wanted: BoolArray | None = None) -> Iterator[NetCells]:
        first, everything = tree.first_child[self.nodes], np.arange(len(self.nodes))
        families = [everything if wanted is None else np.flatnonzero(wanted[slot]) for slot in range(4)]
        nodes = np.concatenate([first[chosen] + slot for slot, chosen in enumerate(families)])
        if len(nodes):
            yield BicubicCells(nodes, np.zeros_like(nodes), self.coefficients_of_children(families))

    def coefficients_of_children(self, families: Sequence[IndexArray]) -> FloatArray:
        """(16, n, 3): for each slot those of the children there of quads (n,) by ascending index."""
        nets, start = np.empty((16, 3, sum(map(len, families)))), 0
        for matrix, chosen in zip(CHILD_MATRICES, families, strict=True):
            own = self.nets if len(chosen) == len(self.nodes) else selected_vectors(self.nets, chosen)
            nets[:, :, start : start + len(chosen)] = transformed_nets(matrix, own).swapaxes(1, 2)
            start += len(chosen)
        return nets.swapaxes(1, 2)

    def halves(self, side: int, nodes: IndexArray) -> BicubicCells:
        """Their halves along the side at this slot, counted from there, as cells of nodes (P,)."""
        return BicubicCells(nodes, np.zeros_like(self.slots), transformed_nets(HALF_MATRICES[side], self.nets))

    def approximate_children(self, limit: float, axes: FloatArray) -> ChildApproximations:
        """How to approximate their children, by bounds from these quads' own coefficients."""
        distances = child_distances(self.nets, limit)
        best = np.where(distances.bounds <= limit, distances.sampled, np.inf).argmin(axis=1)
        bounds = np.take_along_axis(distances.bounds, best[:, None], axis=1)[:, 0]
        is_within = bounds <= limit
        within = np.flatnonzero(is_within)
        found = LeafApproximation.none(best.size)
        found.accepted[within] = True
        found.alternatives[within] = best.ravel()[within]
        found.bounds[within] = bounds.ravel()[within]
        folded = folded_quads(found, within, corners_of_children(distances.points, is_within), axes)

        far = distances.far
        whole = np.full(len(far.at_corners), WHOLE, dtype=np.int8)
        chosen = far.at_corners * len(self.nodes) + far.of_quads
        heights = sampled_heights(far.corners, far.off, whole)
        of_far = choose_along_surface(heights, limit)
        found.put(chosen, of_far)
        promising = np.flatnonzero(of_far.accepted)
        folded |= folded_quads(found, chosen[promising], selected_vectors(far.corners, promising), axes)
        out_of_reach = np.zeros(best.size, dtype=bool)
        out_of_reach[chosen] = ~of_far.accepted
        least = distances.sampled.min(axis=1).ravel()
        least[chosen] = heights.min(axis=0)
        return ChildApproximations(replace(found, folded=folded, least=least), out_of_reach, distances.points)

    def approximate(self, hanging: BoolArray, request: AdaptiveRequest) -> LeafApproximation:
        # Turned so that their patterns are canonical: fewer patterns take less time.
        turned = self._turned(TURNS[patterns_of(hanging, self.slots)])
        return super(BicubicCells, turned).approximate(hanging, request)

    def tiles(self, levels: int) -> Iterator[Tiles]:
        yield Tiles(Squares.whole(len(self.nodes)), self.nets)

    def _turned(self, turns: NDArray[np.int8] | IndexArray) -> BicubicCells:
        """The same quads with nets counted from slots (P,) turns further on."""
        if not np.any(turns):
            return self
        nets = self.nets.copy("K")
        for turn in (1, 2, 3):
            chosen = np.flatnonzero(turns == turn)
            nets[:, chosen] = selected_vectors(self.nets, chosen).take(TURNED_COEFFICIENTS[turn], axis=0)
        return BicubicCells(self.nodes, (self.slots + turns) % 4, nets)

    def _distances_of_template(self, chosen: IndexArray, pattern: int, alternative: int, limit: float) -> FloatArray:
        """With finer bounds where they decide."""
        rows = triangle_bounds.quadratic_rows(pattern, alternative)
        quadratic, rest = triangle_bounds.quadratic_distances(rows, self.nets, chosen)
        distances = quadratic + rest
        doubtful = np.flatnonzero((distances > limit) & (quadratic <= REFINABLE_QUADRATIC * limit))
        if len(doubtful):
            closer = triangle_bounds.bicubic_rows(pattern, alternative)
            distances[doubtful] = triangle_bounds.bicubic_distances(closer, self.nets, chosen[doubtful])
        return distances

    def _to_points(self) -> FloatArray:
        return triangle_bounds.BICUBIC_POINTS


class ExtraordinaryCells(NetCells):
    """Quads with extraordinary corners, by the nets of points around them (``stencils.quad_nets``)."""

    @staticmethod
    def of_faces(mesh: PolygonMesh, valences: Valences, corners: IndexArray, nodes: IndexArray) -> ExtraordinaryCells:
        """From faces of a mesh, by the corners (P,) from which they have these valences."""
        nets = quad_nets(mesh, corners, valences)
        return ExtraordinaryCells(nodes, corners - mesh.face_starts[mesh.corner_faces[corners]], nets, valences)

    def children(self, tree: Quadtree, wanted: BoolArray | None = None) -> Iterator[NetCells]:
        stencils = quad_stencils(self.valences)
        for turn, (valence, matrix) in enumerate(zip(self.valences, stencils.children, strict=True)):
            slots, chosen = (self.slots + turn) % 4, np.arange(len(self.nodes))
            if wanted is not None:
                chosen = np.flatnonzero(wanted[slots, chosen])
            if not len(chosen):
                continue
            nodes, nets = tree.first_child[self.nodes[chosen]] + slots[chosen], selected_vectors(self.nets, chosen)
            if valence == 4:
                yield BicubicCells(nodes, np.zeros_like(nodes), transformed_nets(TO_BERNSTEIN @ matrix, nets))
            else:
                nets = transformed_nets(matrix, nets)
                yield ExtraordinaryCells(nodes, np.zeros_like(nodes), nets, (valence, 4, 4, 4))

    def _distances_of_template(self, chosen: IndexArray, pattern: int, alternative: int, limit: float) -> FloatArray:
        rows = triangle_bounds.extraordinary_rows(self.valences, pattern, alternative)
        return triangle_bounds.extraordinary_distances(rows, selected_vectors(self.nets, chosen))

    def _to_points(self) -> FloatArray:
        return triangle_bounds.extraordinary_points(self.valences)

    def tiles(self, levels: int) -> Iterator[Tiles]:
        whole = Squares.whole(len(self.nodes))
        if self.valences[1:] == (4, 4, 4):
            yield from tiles_around_vertex(self.nets, self.valences[0], whole, levels)
            return
        children = whole.children()
        for corner, (valence, matrix) in enumerate(
            zip(self.valences, quad_stencils(self.valences).children, strict=True)
        ):
            nets, squares = transformed_nets(matrix, self.nets), children.at(4 * np.arange(len(self.nodes)) + corner)
            if valence == 4:
                yield Tiles(squares, transformed_nets(TO_BERNSTEIN, nets))
            else:
                yield from tiles_around_vertex(nets, valence, squares, levels)
