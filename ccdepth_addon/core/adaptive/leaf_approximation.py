# SPDX-License-Identifier: GPL-3.0-or-later
"""How cells, the nodes of a quadtree with what is known of the surface there, are drawn; and what is likely to fit.

How a cell is drawn depends on which of its sides are split (``templates``). What is not within the limit at equal
parameters may be along the surface (``star_bounds``), which the neighbours decide; so it is guessed here first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import blocks
from ..arrays.coordinates import chosen_vectors
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norms import cross_products, dot_products, squared_norms
from .leaf_bounds.polygon_bounds import is_folded
from .leaf_bounds.triangle_bounds import ErrorBounds
from .quadtree import Quadtree
from .templates import WHOLE, Template, Transitions, templates

# How much of the limit what is expected of the neighbours may take up; and what the tilt of triangles against their
# neighbours is to the height of a side's middle over its chord, in parts of its length: 8 for a circle, and some more.
PROMISING = 0.9
SLOPE_OF_HEIGHT = 10.0

# What is made on the way of the points of so many cells stays in the processor's cache.
CELLS_IN_CACHE = 1 << 12

# Points of a quad (``templates.QUAD_POINTS``, then the centre): the corners its sides go from and to; and the middles
# of its sides and diagonals, each with what it is between.
STARTS, ENDS = [0, 1, 2, 3], [1, 2, 3, 0]
CHORDS = [(4, 0, 1), (5, 1, 2), (6, 2, 3), (7, 3, 0), (8, 0, 2), (8, 1, 3)]


@dataclass
class LeafApproximation:
    """How P cells are drawn, and how well: (P,) each.

    fits: bool, whether a template will do, or is likely to. bounds: float64, the proved distance as they are drawn, inf
    where that is not within the limit at equal parameters: it takes the neighbours to find one then (``star_bounds``).
    normal, tangential: float64, how far they are off at equal parameters, along the triangles' normals and across
    these, at most; inf where that has not been worked out. patterns and alternatives: int8, the template
    (``templates``), counted from slot ``turns`` on. folded: bool, whether the triangles of a whole quad face away from
    each other, here or where Blender triangulates it, so that it has to be drawn as triangles. least: float64, a
    distance that is really there when the cell's sides are whole.
    """

    accepted: BoolArray
    bounds: FloatArray
    normal: FloatArray
    tangential: FloatArray
    patterns: NDArray[np.int8]
    alternatives: NDArray[np.int8]
    turns: NDArray[np.int8]
    folded: BoolArray
    least: FloatArray

    @staticmethod
    def none(count: int) -> LeafApproximation:
        """Nothing found yet."""
        small = np.zeros(count, dtype=np.int8)
        far = np.full(count, np.inf)
        folded = np.zeros(count, dtype=bool)
        least = np.zeros(count)
        return LeafApproximation(
            folded, far, far.copy(), far.copy(), small, small.copy(), small.copy(), folded.copy(), least
        )

    def at(self, chosen: IndexArray) -> LeafApproximation:
        """Those of some cells."""
        return LeafApproximation(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def put(self, chosen: IndexArray, other: LeafApproximation) -> None:
        """Replace those of some cells."""
        for field in fields(self):
            getattr(self, field.name)[chosen] = getattr(other, field.name)

    def take(self, chosen: IndexArray, alternative: int | IndexArray) -> None:
        """Draw the chosen cells by a template that is within the limit, or likely to be."""
        self.accepted[chosen] = True
        self.alternatives[chosen] = alternative

    def know(self, chosen: IndexArray, error_bounds: ErrorBounds) -> None:
        """So much are the chosen cells off as they are drawn."""
        self.normal[chosen], self.tangential[chosen] = error_bounds.normal, error_bounds.tangential

    def accept_promising(
        self,
        chosen: IndexArray,
        samples: Samples,
        limit: float,
        error_bounds_of: Callable[[IndexArray, int], ErrorBounds],
    ) -> None:
        """Draw the chosen cells, which are not within the limit at equal parameters, by a template that is likely to be
        along the surface.

        samples: theirs. misses_of: how far some of them, by index, are off as an alternative draws them.
        """
        predicted = samples.predicted_bounds()
        for alternative, tried in in_turn(predicted, lambda: ~self.accepted[chosen]):
            tried = tried[predicted[alternative, tried] <= PROMISING * limit]
            if len(tried):
                error_bounds = error_bounds_of(tried, alternative)
                reached = samples.at(tried).predict(error_bounds.normal, error_bounds.tangential)
                promising = np.flatnonzero(reached <= PROMISING * limit)
                self.take(chosen[tried[promising]], alternative)
                self.know(chosen[tried[promising]], error_bounds.at(promising))

    def fold(self, chosen: IndexArray, points: FloatArray, axes: FloatArray) -> None:
        """Find out which of the chosen cells, whole and with points (4 or more, n, 3), are folded as they are drawn."""
        spaces = [np.eye(3)] if np.array_equal(axes, np.eye(3)) else [np.eye(3), axes]
        for block in blocks(len(chosen), CELLS_IN_CACHE):
            corners, second = points[:4, block].copy("K"), np.flatnonzero(self.alternatives[chosen[block]])
            corners[:, second] = chosen_vectors(corners, second)[ENDS]
            self.folded[chosen[block]] = is_folded(corners, *spaces)


class Cells(Protocol):
    """P nodes whose surface is known in one way."""

    @property
    def nodes(self) -> IndexArray:
        """(P,) intp."""

    def at(self, chosen: IndexArray) -> Cells:
        """Some of them, by index."""

    def approximate(
        self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray
    ) -> LeafApproximation:
        """How to draw them within a limit; hanging: (slots of the nodes,) bool, which sides are split. axes: (3, 3), of
        the space where Blender triangulates (``polygon_bounds``)."""

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """How far they are off along and across the normals of the triangles they are drawn by, as they were fitted."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """The cells of their children; the tree's nodes have been split."""


def sampled_distances(points: FloatArray, pattern: int) -> FloatArray:
    """(alternatives, P): how far quads are off at the middles of their sides and diagonals, from their points and
    centres (9, P, 3); 0 where sides are split."""
    if pattern != WHOLE:
        return np.zeros((len(templates(pattern)), points.shape[1]))
    squares = squared_norms(off_sides_and_diagonals(points))
    return np.sqrt(np.maximum(squares[:4].max(axis=0), squares[4:]))


def off_sides_and_diagonals(points: FloatArray) -> FloatArray:
    """(6, P, 3): S - T at the middles of the four sides and of the two diagonals."""
    off = np.empty_like(points, shape=(6, *points.shape[1:]))
    for number, (middle, start, end) in enumerate(CHORDS):
        np.add(points[start], points[end], out=off[number])
        off[number] *= -0.5
        off[number] += points[middle]
    return off


@dataclass(frozen=True)
class Samples:
    """S - T at the middles of the sides and of the diagonals of P quads, as lengths: (alternatives, P) each.

    slopes: (P,) by how much the triangles there and around are tilted against each other, roughly.
    """

    normal: FloatArray
    tangential: FloatArray
    slopes: FloatArray

    @staticmethod
    def of(corners: FloatArray, off: FloatArray, pattern: int) -> Samples:
        """From the quads' corners (4 or more, P, 3) and S - T (6, P, 3) at the middles of their sides and diagonals;
        for split sides nothing is sampled but the slopes."""
        normals = triangle_normals(corners, ((0, 1, 2), (0, 2, 3)))
        normals = (normals[0] + normals[1]) / 2
        lengths = np.sqrt(squared_norms(corners[ENDS] - corners[STARTS])).min(axis=0)
        heights, across = along_and_across(off, normals)
        slopes = Samples.slopes_of(heights[:4].max(axis=0), lengths)
        if pattern != WHOLE:
            none = np.zeros((len(templates(pattern)), off.shape[1]))
            return Samples(none, none, slopes)
        normal = np.maximum(heights[:4].max(axis=0), heights[4:])
        tangential = np.maximum(across[:4].max(axis=0), across[4:])
        return Samples(normal, tangential, slopes)

    @staticmethod
    def slopes_of(heights: FloatArray, lengths: FloatArray) -> FloatArray:
        """(P,), from how high the sides' middles are over their chords, and from the sides' lengths."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = SLOPE_OF_HEIGHT * heights / lengths
        return np.where(np.isfinite(slopes), slopes, np.inf)

    def at(self, chosen: IndexArray) -> Samples:
        return Samples(self.normal[:, chosen], self.tangential[:, chosen], self.slopes[chosen])

    def predicted_bounds(self) -> FloatArray:
        """(alternatives, P): ``hope`` for what is sampled."""
        return self.predict(self.normal, self.tangential)

    def predict(self, normal: FloatArray, tangential: FloatArray) -> FloatArray:
        """About what ``star_bounds`` will find for quads that are off by so much."""
        secants = np.sqrt(1 + self.slopes**2)
        with np.errstate(invalid="ignore"):
            predicted = normal * secants + 2 * self.slopes * (tangential + normal * self.slopes / secants)
        return np.where(np.isnan(predicted), np.inf, predicted)


def in_turn(samples: FloatArray, wanted: Callable[[], BoolArray]) -> Iterator[tuple[int, IndexArray]]:
    """The alternatives (A, P), for each cell in the order of its samples, with the cells that still want one."""
    for rank in np.argsort(samples, axis=0, kind="stable"):
        for alternative in range(len(samples)):
            yield alternative, np.flatnonzero((rank == alternative) & wanted())


def triangle_normals(points: FloatArray, template: Template) -> FloatArray:
    """(T, P, 3): unit normals of the triangles over quads' points (8 or more, P, 3); zero where there is no area."""
    crosses = np.stack([cross_products(points[b] - points[a], points[c] - points[a]) for a, b, c in template])
    lengths = np.sqrt(squared_norms(crosses))[..., None]
    return crosses / np.where(lengths > 0, lengths, 1.0)


def least_heights(points: FloatArray, template: Template) -> FloatArray:
    """(P,): the least height of the triangles over quads' points (8 or more, P, 3)."""
    heights = np.full(points.shape[1], np.inf)
    for triangle in template:
        corners = points[list(triangle)]
        areas = np.sqrt(squared_norms(cross_products(corners[1] - corners[0], corners[2] - corners[0])))
        longest = np.sqrt(squared_norms(np.roll(corners, -1, axis=0) - corners)).max(axis=0)
        heights = np.minimum(heights, areas / np.where(longest > 0, longest, 1.0))
    return heights


def along_and_across(vectors: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(R, P) twice: the lengths of vectors (R, P, 3) along unit normals (P, 3) and across them."""
    along = np.abs(dot_products(vectors, normals))
    return along, np.sqrt(np.maximum(squared_norms(vectors) - along**2, 0.0))
