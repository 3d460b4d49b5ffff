# SPDX-License-Identifier: GPL-3.0-or-later
"""Which template approximates a cell: the first within the limit, in the order of what is sampled.

A template that exceeds the limit at equal parameters may be within it along the surface (``star_bounds``). The
neighbours decide that later, so here a template is accepted by a predicted bound.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import dot_products, selected_vectors, squared_norms
from .leaf_approximation import LeafApproximation
from .leaf_bounds.polygon_bounds import is_folded
from .leaf_bounds.triangle_bounds import ErrorBounds
from .leaf_bounds.triangle_shapes import along_and_across, triangle_normals
from .templates import COUNTS, WHOLE

# A predicted bound has to be below this part of the limit; and the ratio of the tilt between neighbouring triangles to
# the height of a side's middle over its chord, in parts of its length: 8 for a circle, and some more.
PROMISING = 0.9
SLOPE_OF_HEIGHT = 10.0

# Points of a quad (``templates.QUAD_POINTS``, then the centre): the corners its sides go from and to; and the middles
# of its sides and diagonals, each with what it is between.
STARTS, ENDS = [0, 1, 2, 3], [1, 2, 3, 0]
CHORDS = [(4, 0, 1), (5, 1, 2), (6, 2, 3), (7, 3, 0), (8, 0, 2), (8, 1, 3)]


class WithDistances(Protocol):
    """Cells whose distances from the templates for their patterns can be bounded."""

    def distances(self, chosen: IndexArray, alternatives: IndexArray) -> FloatArray:
        """(n,): upper bounds for some of them, by ascending index, and an alternative each (n,), as tight as it takes
        to compare them with the limit."""


class WithErrorBounds(Protocol):
    """Cells whose errors along and across the normals of the templates for their patterns can be bounded."""

    def error_bounds(self, chosen: IndexArray, alternatives: IndexArray) -> ErrorBounds:
        """(n,) each, for some of them, by ascending index, and an alternative each (n,), as tight as it takes to
        compare a predicted bound with the limit."""


def choose_within_limit(cells: WithDistances, sampled: FloatArray, limit: float) -> LeafApproximation:
    """The first template whose distance is within the limit, in the order of what is sampled (alternatives, P)."""
    found = LeafApproximation.none(sampled.shape[1])
    for alternatives, is_next in _in_order(sampled, limit):
        tried = np.flatnonzero(is_next & ~found.accepted)
        if len(tried):
            distances = cells.distances(tried, alternatives[tried])
            within = distances <= limit
            accepted = tried[within]
            found.accepted[accepted] = True
            found.alternatives[accepted] = alternatives[accepted]
            found.bounds[accepted] = distances[within]
    return found


def choose_alone(cells: WithDistances, samples: Samples, limit: float) -> LeafApproximation:
    """The first template within the limit by the cells alone (``leaf_distance``), which bound the distances."""
    found = choose_within_limit(cells, samples.alone(), limit)
    return replace(found, alone=found.accepted.copy())


def choose_shifted(cells: WithDistances, samples: Samples, limit: float) -> LeafApproximation:
    """The template that is sampled to be the best along the surface, where it is within the limit at shifted parameters
    (``shifted_bounds``), which bound the distances: what is proved so needs no neighbours, and these are bounded by the
    template that is best for them too."""
    found = LeafApproximation.none(len(samples.slopes))
    best = samples.predicted_bounds().argmin(axis=0)
    tried = np.flatnonzero(np.take_along_axis(samples.alone(), best[None], axis=0)[0] <= limit)
    if len(tried):
        distances = cells.distances(tried, best[tried])
        within = distances <= limit
        accepted = tried[within]
        found.accepted[accepted] = found.alone[accepted] = True
        found.alternatives[accepted] = best[accepted]
        found.bounds[accepted] = distances[within]
    return found


def choose_along_surface(cells: WithErrorBounds, samples: Samples, limit: float) -> LeafApproximation:
    """The first template that is predicted to be within the limit along the surface, by the cells' own samples."""
    found = LeafApproximation.none(len(samples.slopes))
    for alternatives, is_next in _in_order(samples.predicted_bounds(), PROMISING * limit):
        tried = np.flatnonzero(is_next & ~found.accepted)
        if len(tried):
            error_bounds = cells.error_bounds(tried, alternatives[tried])
            predicted = samples.at(tried).predict(error_bounds.normal, error_bounds.tangential)
            promising = np.flatnonzero(predicted <= PROMISING * limit)
            accepted = tried[promising]
            found.accepted[accepted] = True
            found.alternatives[accepted] = alternatives[accepted]
            found.normal[accepted] = error_bounds.normal[promising]
            found.tangential[accepted] = error_bounds.tangential[promising]
    return found


def _in_order(samples: FloatArray, limit: float) -> Iterator[tuple[IndexArray, BoolArray]]:
    """By samples (alternatives, P), the best alternative of each cell first: (P,) alternatives, and for which cells
    they are sampled within the limit."""
    for alternatives in np.argsort(samples, axis=0, kind="stable"):
        yield alternatives, np.take_along_axis(samples, alternatives[None], axis=0)[0] <= limit


def folded_quads(
    approximation: LeafApproximation, chosen: IndexArray, points: FloatArray, axes: FloatArray
) -> BoolArray:
    """(P,) which of the chosen quads, whole and with points (4 or more, n, 3), are folded as they are approximated.

    axes: (3, 3), of the space where Blender triangulates."""
    spaces = [np.eye(3)] if np.array_equal(axes, np.eye(3)) else [np.eye(3), axes]
    folded = np.zeros(len(approximation.folded), dtype=bool)
    corners, second = points[:4].copy("K"), np.flatnonzero(approximation.alternatives[chosen])
    corners[:, second] = selected_vectors(corners, second)[ENDS]
    folded[chosen] = is_folded(corners, *spaces)
    return folded


def sampled_distances(points: FloatArray, patterns: NDArray[np.int8]) -> FloatArray:
    """(alternatives, P): the distances of quads at the middles of their whole sides and, where all are whole, of their
    diagonals, from their points and centres (9, P, 3); inf where a pattern (P,) has fewer alternatives."""
    squares = squared_norms(off_sides_and_diagonals(points))
    sides = np.where(_is_split(patterns), 0.0, squares[:4]).max(axis=0)
    sampled = np.where(_is_alternative(patterns), np.sqrt(sides), np.inf)
    whole = np.flatnonzero(patterns == WHOLE)
    sampled[:2, whole] = np.sqrt(np.maximum(sides[whole], squares[4:, whole]))
    return sampled


def _is_split(patterns: NDArray[np.int8]) -> BoolArray:
    """(4, P): which sides are split in patterns (P,)."""
    return (patterns >> np.arange(4)[:, None] & 1).astype(bool)


def _is_alternative(patterns: NDArray[np.int8]) -> BoolArray:
    """(alternatives, P): which of them patterns (P,) have."""
    counts = COUNTS[patterns]
    return np.arange(counts.max(initial=2))[:, None] < counts


def off_sides_and_diagonals(points: FloatArray) -> FloatArray:
    """(6, P, 3): S - T at the middles of the four sides and of the two diagonals."""
    off = np.empty_like(points, shape=(6, *points.shape[1:]))
    for number, (middle, start, end) in enumerate(CHORDS):
        np.add(points[start], points[end], out=off[number])
        off[number] *= -0.5
        off[number] += points[middle]
    return off


def off_lines(off: FloatArray, sides: FloatArray, squares: FloatArray, is_split: BoolArray) -> FloatArray:
    """(P,): the largest length of vectors (S, P, 3) across sides (S, P, 3), these with squared lengths (S, P), but for
    split ones (S, P)."""
    along = dot_products(off, sides)
    along *= along / np.where(squares > 0, squares, 1.0)
    across = np.where(is_split, 0.0, squared_norms(off) - along)
    return np.sqrt(across.max(axis=0, initial=0.0))


@dataclass(frozen=True)
class Samples:
    """‖S - T‖ at the middles of the sides and of the diagonals of P quads, along normals and across: (alternatives, P)
    each.

    slopes: (P,) estimates of the slopes between the triangles there and around. beside: (P,) how far the surface is off
    the lines of whole sides, over their middles.
    """

    normal: FloatArray
    tangential: FloatArray
    slopes: FloatArray
    beside: FloatArray

    @staticmethod
    def of(corners: FloatArray, off: FloatArray, patterns: NDArray[np.int8]) -> Samples:
        """From the quads' corners (4 or more, P, 3) and S - T (6, P, 3) at the middles of their sides and diagonals;
        with patterns (P,), of whose split sides there are no samples, only slopes."""
        normals = triangle_normals(corners, ((0, 1, 2), (0, 2, 3)))
        normals = (normals[0] + normals[1]) / 2
        sides = corners[ENDS] - corners[STARTS]
        squares = squared_norms(sides)
        lengths = np.sqrt(squares.min(axis=0))
        beside = off_lines(off[:4], sides, squares, _is_split(patterns))
        heights, across = along_and_across(off, normals)
        slopes = Samples.slopes_of(heights[:4].max(axis=0), lengths)
        normal, tangential = (np.where(_is_alternative(patterns), 0.0, np.inf) for _ in range(2))
        whole = np.flatnonzero(patterns == WHOLE)
        for found, sampled in ((normal, heights), (tangential, across)):
            found[:2, whole] = np.maximum(sampled[:4].max(axis=0), sampled[4:])[:, whole]
        return Samples(normal, tangential, slopes, beside)

    @staticmethod
    def slopes_of(heights: FloatArray, lengths: FloatArray) -> FloatArray:
        """(P,), from the heights of the sides' middles over their chords, and from the sides' lengths."""
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = SLOPE_OF_HEIGHT * heights / lengths
        return np.where(np.isfinite(slopes), slopes, np.inf)

    def at(self, chosen: IndexArray) -> Samples:
        """Those of some quads, by index."""
        return Samples(self.normal[:, chosen], self.tangential[:, chosen], self.slopes[chosen], self.beside[chosen])

    def alone(self) -> FloatArray:
        """(alternatives, P): estimates of what ``leaf_distances`` will find at least."""
        return np.maximum(self.normal, self.beside)

    def predicted_bounds(self) -> FloatArray:
        """(alternatives, P): ``predict`` from the samples."""
        return self.predict(self.normal, self.tangential)

    def predict(self, normal: FloatArray, tangential: FloatArray) -> FloatArray:
        """Estimates of what ``star_bounds`` will find, from errors along the normals and across them."""
        secants = np.sqrt(1 + self.slopes**2)
        with np.errstate(invalid="ignore"):
            predicted = normal * secants + 2 * self.slopes * (tangential + normal * self.slopes / secants)
        return np.where(np.isnan(predicted), np.inf, predicted)
