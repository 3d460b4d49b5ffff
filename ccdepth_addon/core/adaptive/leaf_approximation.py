# SPDX-License-Identifier: GPL-3.0-or-later
"""How cells are approximated by triangles. A cell is a node of a quadtree with a representation of its surface."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .quadtree import Quadtree
from .request import AdaptiveRequest
from .surface_pieces import DrawnTiles


@dataclass(frozen=True)
class LeafApproximation:
    """How P cells are approximated, and how well: (P,) each.

    accepted: bool, whether some template is within the limit at equal parameters, or may be along the surface. bounds:
    float64, the distance proved at equal parameters; inf where only places in a shell can prove one. patterns and
    alternatives: int8, the template (``templates``), counted from slot ``turns`` on. folded: bool, whether the
    triangles of a whole quad face away from each other, here or where Blender triangulates it, so that it has to become
    triangles. thickness: float64, how far the polygon that is drawn is from the triangles that stand for it; 0 where
    no polygon is drawn. least: float64, an estimate from below of the error of a cell whose sides are whole.
    """

    accepted: BoolArray
    bounds: FloatArray
    patterns: NDArray[np.int8]
    alternatives: NDArray[np.int8]
    turns: NDArray[np.int8]
    folded: BoolArray
    thickness: FloatArray
    least: FloatArray

    @staticmethod
    def none(count: int) -> LeafApproximation:
        """No template accepted."""
        accepted, folded = np.zeros((2, count), dtype=bool)
        patterns, alternatives, turns = np.zeros((3, count), dtype=np.int8)
        thickness, least = np.zeros((2, count))
        return LeafApproximation(
            accepted, np.full(count, np.inf), patterns, alternatives, turns, folded, thickness, least
        )

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

    def approximate(self, hanging: BoolArray, request: AdaptiveRequest) -> LeafApproximation:
        """How to approximate them within the limit of a request; hanging: (slots of the nodes,) bool, which sides are
        split."""

    def drawn_tiles(self, approximation: LeafApproximation, hanging: BoolArray, levels: int) -> Iterator[DrawnTiles]:
        """All of their surface, and over which triangles it is, as they are approximated with these sides split.
        levels: of tiles around extraordinary vertices."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """The cells of their children; the tree's nodes have been split."""
