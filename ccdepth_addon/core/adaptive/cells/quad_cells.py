# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of a quadtree as cells, drawn by the templates for their split sides.

How they are known is up to ``patch_cells`` and ``irregular_cells``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...arrays.coordinates import chosen_vectors
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ..leaf_approximation import (
    PROMISING,
    Cells,
    LeafApproximation,
    Samples,
    in_turn,
    off_sides_and_diagonals,
    sampled_distances,
)
from ..leaf_bounds.polygon_bounds import thickness_of_quads
from ..leaf_bounds.triangle_bounds import ErrorBounds
from ..quadtree import Quadtree
from ..templates import ALL_SPLIT, WHOLE, Transitions

PATTERN_BITS = np.array([1, 2, 4, 8])


class QuadCells(ABC):
    """P quads."""

    nodes: IndexArray

    @abstractmethod
    def at(self, chosen: IndexArray) -> Self:
        """Some of them, by ascending index."""

    @abstractmethod
    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """As in ``Cells``."""

    @abstractmethod
    def turns(self) -> IndexArray:
        """(P,) the slot from which the points and the patterns of each are counted."""

    @abstractmethod
    def points(self) -> FloatArray:
        """(9, P, 3): the quads' points (``templates.QUAD_POINTS``) and centres, on the surface."""

    @abstractmethod
    def distances_of(
        self, chosen: IndexArray, pattern: int, alternative: int, points: FloatArray, limit: float
    ) -> FloatArray:
        """(n,): how far chosen quads are off at most, drawn by a template, as well as it takes to see what is within
        the limit. points: those of all."""

    @abstractmethod
    def error_bounds_of(
        self, chosen: IndexArray, pattern: int, alternative: int, points: FloatArray, limit: float
    ) -> ErrorBounds:
        """How far they are off along the normals and across, as well as it takes to bound by the neighbours what is
        within the limit along the normals."""

    def approximate(
        self, hanging: BoolArray, transitions: Transitions, limit: float, axes: FloatArray
    ) -> LeafApproximation:
        """As in ``Cells``."""
        patterns = patterns_of(hanging, self.turns())
        found = LeafApproximation.none(len(self.nodes))
        found.turns[:] = self.turns()
        found.patterns[:] = patterns
        for pattern in np.unique(patterns[patterns != ALL_SPLIT]).tolist():
            chosen = np.flatnonzero(patterns == pattern)
            part = self if len(chosen) == len(self.nodes) else self.at(chosen)
            part._approximate_pattern(found, chosen, pattern, transitions, limit, axes)
        return found

    def _approximate_pattern(
        self,
        found: LeafApproximation,
        chosen: IndexArray,
        pattern: int,
        transitions: Transitions,
        limit: float,
        axes: FloatArray,
    ) -> None:
        """Try the templates of a pattern, the likeliest first, until one is within the limit, or likely to be.

        chosen: where in what is found the quads are.
        """
        points = self.points()
        sampled = sampled_distances(points, pattern)
        found.least[chosen] = sampled.min(axis=0)
        as_polygons = transitions is Transitions.NGONS and pattern != WHOLE
        for alternative, tried in in_turn(sampled, lambda: np.isinf(found.bounds[chosen])):
            tried = tried[sampled[alternative, tried] <= limit]
            if len(tried):
                reached = self.distances_of(tried, pattern, alternative, points, limit)
                if as_polygons:
                    reached += thickness_of_quads(chosen_vectors(points, tried), pattern, alternative, axes)
                within = reached <= limit
                found.take(chosen[tried[within]], alternative)
                found.bounds[chosen[tried[within]]] = reached[within]
        left = np.flatnonzero(~found.accepted[chosen])
        if len(left) and not as_polygons:
            self.at(left)._approximate_along_surface(found, chosen[left], pattern, chosen_vectors(points, left), limit)
        if pattern == WHOLE:
            accepted = np.flatnonzero(found.accepted[chosen])
            found.fold(chosen[accepted], chosen_vectors(points[:4], accepted), axes)

    def _approximate_along_surface(
        self, found: LeafApproximation, chosen: IndexArray, pattern: int, points: FloatArray, limit: float
    ) -> None:
        """Where none is within the limit at equal parameters, take one that is likely to be along the surface."""
        samples = Samples.of(points, off_sides_and_diagonals(points), pattern)
        found.accept_promising(
            chosen,
            samples,
            limit,
            lambda tried, alternative: self.error_bounds_of(tried, pattern, alternative, points, PROMISING * limit),
        )

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """As in ``Cells``."""
        found, points = ErrorBounds(*(np.empty(len(self.nodes)) for _ in range(3))), self.points()
        # Patterns are below 16, so every template has a number of its own.
        numbers = approximation.alternatives.astype(np.int16) * 16 + approximation.patterns
        for number in np.unique(numbers).tolist():
            chosen, pattern, alternative = np.flatnonzero(numbers == number), number % 16, number // 16
            found.put(chosen, self.error_bounds_of(chosen, pattern, alternative, points, limit))
        return found


def patterns_of(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    if not np.any(hanging):
        return np.full(len(turns), WHOLE, dtype=np.int8)
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)
