# SPDX-License-Identifier: GPL-3.0-or-later
"""The regular and extraordinary patches of the base faces of a search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..bounds.facet_bounds import LaterBounds, later_bounds
from ..bounds.norm_bounds import PatchBounds, Vertices, second_order_regular
from ..distance.foot_bounds import twists
from ..surface.bicubic import FIRST_DIFFERENCE, apply, largest_norm, tensor
from ..surface.parts import Parts
from ..surface.patches import ring_index
from ..surface.stencils import child_at_vertex, patch_stencils, regular_children, valence_of
from .tolerance import ToleranceTest

# (9, 16): the mixed differences of a net. Those of points j levels later are averages of these, times 4⁻ʲ.
TWISTS = tensor(FIRST_DIFFERENCE, FIRST_DIFFERENCE)


# The part of the tolerance up to which twists need no better bound.
SMALL_TWIST = 1 / 16


@dataclass
class RegularPatches(Table, nets=2):
    """Regular patches that appear at one level: (P,) base faces, (4, 4, P, 3) nets.

    rough, later: bounds by the norm alone and from the net itself, computed on first use; twist: (P,), of their facets,
    likewise.
    """

    level: int
    bases: IndexArray
    nets: FloatArray
    rough: PatchBounds | None = None
    later: LaterBounds | None = None
    twist: FloatArray | None = None

    @staticmethod
    def of(level: int, pieces: list[Parts]) -> RegularPatches:
        """The patches of several pieces together."""
        whole = pieces[0].joined(pieces[1:])
        return RegularPatches(level, whole.faces, whole.values)

    def rough_bounds(self, vertices: Vertices) -> PatchBounds:
        if self.rough is None:
            self.rough = second_order_regular(self.nets, vertices)
        return self.rough

    def later_bounds(self, vertices: Vertices) -> LaterBounds:
        if self.later is None:
            self.later = later_bounds(self.nets, vertices)
        return self.later

    def off_drawn(self, levels: int, vertices: Vertices, test: ToleranceTest) -> FloatArray:
        """(P,): bounds of the distance between the facets, a number of levels later, and their triangles along either
        diagonal. Levels may not fall from call to call."""
        if self.twist is None:
            self.twist = largest_norm(apply(TWISTS, self.nets)) / 4
            large = np.flatnonzero(self.twist * 0.25**levels > SMALL_TWIST * test.tolerance)
            if vertices is Vertices.LIMIT and len(large):
                nets = self.nets.take(large, axis=2).reshape(16, -1, 3)
                self.twist[large] = twists(np.ascontiguousarray(nets.swapaxes(1, 2)))
        return self.twist * 0.25**levels


@dataclass(frozen=True)
class ExtraordinaryPatches(Table, nets=1):
    """Extraordinary patches of one valence at the level being evaluated: (P,) base faces, (2n + 8, P, 3) nets."""

    bases: IndexArray
    nets: FloatArray

    def corners(self, vertices: Vertices) -> FloatArray:
        """(4, P, 3): the corners of their facets, in the face's order."""
        if vertices is Vertices.LIMIT:
            return matrix_product(patch_stencils(valence_of(self.nets)).limits, self.nets)
        return self.nets[[0, *(ring_index(valence_of(self.nets), number) for number in (6, 5, 4))]]

    def refined(self) -> tuple[ExtraordinaryPatches, Parts]:
        """The children at the extraordinary vertices; and the nets of the regular ones."""
        refined = ExtraordinaryPatches(self.bases, child_at_vertex(self.nets))
        return refined, Parts(np.tile(self.bases, 3), regular_children(self.nets))
