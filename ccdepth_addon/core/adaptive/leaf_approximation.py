# SPDX-License-Identifier: GPL-3.0-or-later
"""How cells are approximated by triangles. A cell is a node of a quadtree with a representation of its surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .flat_parts import THICKEST
from .leaf_bounds.leaf_distance import Hull, Outline
from .leaf_bounds.triangle_bounds import ErrorBounds
from .quadtree import Quadtree
from .request import AdaptiveRequest


@dataclass(frozen=True)
class LeafApproximation:
    """How P cells are approximated, and how well: (P,) each.

    accepted: bool, whether some template is within the limit, or is predicted to be along the surface. bounds: float64,
    the proved distance; inf where only the neighbours can prove one (``star_bounds``). alone: bool, whether it was
    proved by the leaf alone (``leaf_distance``), not at equal parameters. normal, tangential: float64, upper bounds of
    the error at equal parameters, along the triangles' normals and across them; inf where not computed. patterns and
    alternatives: int8, the template (``templates``), counted from slot ``turns`` on. folded: bool, whether the
    triangles of a whole quad face away from each other, here or where Blender triangulates it, so that it has to become
    triangles. thickness: float64, over a flat part how far the polygon that is drawn is from all triangles between its
    vertices that cover the same, seen along the part's normal; 0 where no polygon is drawn, and elsewhere. least:
    float64, an estimate from below of the error of a cell whose sides are whole.
    """

    accepted: BoolArray
    bounds: FloatArray
    alone: BoolArray
    normal: FloatArray
    tangential: FloatArray
    patterns: NDArray[np.int8]
    alternatives: NDArray[np.int8]
    turns: NDArray[np.int8]
    folded: BoolArray
    thickness: FloatArray
    least: FloatArray

    @staticmethod
    def none(count: int) -> LeafApproximation:
        """No template accepted."""
        accepted, alone, folded = np.zeros((3, count), dtype=bool)
        patterns, alternatives, turns = np.zeros((3, count), dtype=np.int8)
        bounds, normal, tangential = np.full((3, count), np.inf)
        thickness, least = np.zeros((2, count))
        return LeafApproximation(
            accepted, bounds, alone, normal, tangential, patterns, alternatives, turns, folded, thickness, least
        )

    def accept_over_flat_parts(self, chosen: IndexArray, limit: float) -> None:
        """Accept chosen ones, but for polygons that are too thick: for the function that puts an approximation
        together."""
        self.accepted[chosen] |= self.thickness[chosen] <= THICKEST * limit

    def at(self, chosen: IndexArray) -> LeafApproximation:
        """Those of some cells."""
        return LeafApproximation(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def put(self, chosen: IndexArray, other: LeafApproximation) -> None:
        """Replace those of some cells: for the function that puts an approximation together."""
        for field in fields(self):
            getattr(self, field.name)[chosen] = getattr(other, field.name)


class Cells(Protocol):
    """P nodes whose surface is represented in one way. Every method returns new values."""

    @property
    def nodes(self) -> IndexArray:
        """(P,) intp."""

    def at(self, chosen: IndexArray) -> Cells:
        """Some of them, by index."""

    def approximate(
        self,
        hanging: BoolArray,
        request: AdaptiveRequest,
        *,
        flat: BoolArray | None = None,
        known: LeafApproximation | None = None,
    ) -> LeafApproximation:
        """How to approximate them within the limit of a request; hanging: (slots of the nodes,) bool, which sides are
        split. flat: (P,) which lie over flat parts; they have a thickness, and are accepted unless all their sides are
        split or they are too thick as polygons. known: how they are approximated, with these sides split, by star
        bounds that turned out to exceed the limit; now nothing is accepted that needs neighbours, or its flat part."""

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """Error bounds along and across the normals of the triangles by which they are approximated."""

    def outlines(self, hanging: BoolArray, limit: float) -> Iterator[tuple[IndexArray, IndexArray, Outline, Hull]]:
        """In blocks of cells with sides split alike: their indices (n,); the slots from which the sides are counted
        (n,); outlines and hulls. None where all sides are split."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """The cells of their children; the tree's nodes have been split."""
