# SPDX-License-Identifier: GPL-3.0-or-later
"""Quads of a quadtree as cells, approximated by the templates for their split sides.

``patch_cells`` and ``irregular_cells`` have the representations of their surface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors
from ..leaf_approximation import Cells, LeafApproximation
from ..leaf_bounds.leaf_distance import Hull, Outline, leaf_distances, may_be_near
from ..leaf_bounds.polygon_bounds import thickness_of_quads
from ..leaf_bounds.triangle_bounds import ErrorBounds
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..template_choice import (
    PROMISING,
    Samples,
    choose_alone,
    choose_along_surface,
    choose_within_limit,
    folded_quads,
    off_sides_and_diagonals,
    sampled_distances,
)
from ..templates import ALL_SPLIT, WHOLE, Transitions, templates

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
        """(n,): upper bounds of ‖S - T‖ for chosen quads and a template, as tight as it takes to compare them with the
        limit. points: those of all."""

    @abstractmethod
    def error_bounds_of(
        self, chosen: IndexArray, pattern: int, alternative: int, points: FloatArray, limit: float
    ) -> ErrorBounds:
        """(n,) each: error bounds along the normals and across, as tight as star bounds need them where the error along
        the normals is within the limit."""

    @abstractmethod
    def hull_of(self, chosen: IndexArray, points: FloatArray, limit: float) -> Hull:
        """Hull points of chosen quads, in the order of their points, as near as it takes to compare with the limit.
        points: those of all."""

    def scratch(self) -> QuadCells:
        """The same quads for a while: what their methods keep for each other goes with them."""
        return self

    def approximate(
        self,
        hanging: BoolArray,
        request: AdaptiveRequest,
        *,
        with_neighbours: bool = True,
        flat: BoolArray | None = None,
    ) -> LeafApproximation:
        """As in ``Cells``."""
        cells, points = self.scratch(), self.points()
        patterns = patterns_of(hanging, self.turns())
        turns = self.turns().astype(np.int8)
        found = replace(LeafApproximation.none(len(self.nodes)), patterns=patterns, turns=turns)
        for pattern in np.unique(patterns[patterns != ALL_SPLIT]).tolist():
            chosen = np.flatnonzero(patterns == pattern)
            as_polygons = request.transitions is Transitions.NGONS and pattern != WHOLE
            axes = request.axes if as_polygons else None
            quads = QuadsOfPattern(cells, pattern, chosen, points, request.limit, axes)
            own = quads.approximate(request, with_neighbours)
            if flat is not None and not as_polygons:
                own.accepted[flat[chosen]] = True
            own.folded[:] = quads.folded(own, request.axes)
            found.put(chosen, replace(own, patterns=patterns[chosen], turns=turns[chosen]))
        return found

    def outlines(self, hanging: BoolArray, limit: float) -> Iterator[tuple[IndexArray, IndexArray, Outline, Hull]]:
        """As in ``Cells``."""
        cells, points = self.scratch(), self.points()
        patterns = patterns_of(hanging, self.turns())
        for pattern in np.unique(patterns[patterns != ALL_SPLIT]).tolist():
            chosen = np.flatnonzero(patterns == pattern)
            outline = _outline(selected_vectors(points, chosen), pattern, 0)
            yield chosen, self.turns()[chosen], outline, cells.hull_of(chosen, points, limit)

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """As in ``Cells``."""
        cells, points = self.scratch(), self.points()
        found = ErrorBounds(*(np.empty(len(self.nodes)) for _ in range(3)))
        # Patterns are below 16, so every template has a number of its own.
        numbers = approximation.alternatives.astype(np.int16) * 16 + approximation.patterns
        for number in np.unique(numbers).tolist():
            chosen, pattern, alternative = np.flatnonzero(numbers == number), number % 16, number // 16
            found.put(chosen, cells.error_bounds_of(chosen, pattern, alternative, points, limit))
        return found


@dataclass(frozen=True)
class QuadsOfPattern:
    """n quads of some cells, to be approximated by templates of one pattern. places: (n,), by ascending index; points:
    (9, P, 3), those of all the cells. axes: (3, 3), of the space where Blender triangulates them as polygons; None if
    triangles approximate them."""

    cells: QuadCells
    pattern: int
    places: IndexArray
    points: FloatArray
    limit: float
    axes: FloatArray | None = None

    def approximate(self, request: AdaptiveRequest, with_neighbours: bool) -> LeafApproximation:
        """By the templates, the likeliest first: one within the limit, or predicted to be."""
        limit, points = self.limit, self.own_points()
        sampled = sampled_distances(points, self.pattern)
        found = choose_within_limit(self, sampled, limit)
        least = sampled.min(axis=0)
        left = np.flatnonzero(~found.accepted)
        if len(left):
            rest, quads = selected_vectors(points, left), self.at(left)
            samples = Samples.of(rest, off_sides_and_diagonals(rest), self.pattern)
            least[left] = np.where(least[left] > limit, samples.alone().min(axis=0), least[left])
            if with_neighbours and self.axes is None:
                found.put(left, choose_along_surface(quads, samples, limit))
            last = np.flatnonzero(~found.accepted[left])
            found.put(left[last], choose_alone(QuadsAlone(quads.at(last), request.rounding), samples.at(last), limit))
        return replace(found, least=least)

    def folded(self, approximation: LeafApproximation, axes: FloatArray) -> BoolArray:
        """(n,) which of them are folded, whole, as they are approximated. axes: (3, 3), of the space where Blender
        triangulates."""
        if self.pattern != WHOLE:
            return approximation.folded
        accepted = np.flatnonzero(approximation.accepted)
        return folded_quads(approximation, accepted, selected_vectors(self.points[:4], self.places[accepted]), axes)

    def own_points(self) -> FloatArray:
        """(9, n, 3)."""
        everything = len(self.places) == self.points.shape[1]
        return self.points if everything else selected_vectors(self.points, self.places)

    def distances(self, chosen: IndexArray, alternative: int) -> FloatArray:
        """As in ``template_choice.WithDistances``."""
        places = self.places[chosen]
        distances = self.cells.distances_of(places, self.pattern, alternative, self.points, self.limit)
        return distances + self.thickness(chosen, alternative)

    def leaf_distances(self, chosen: IndexArray, alternative: int, rounding: float) -> FloatArray:
        """(n,): the same of each leaf alone (``leaf_distance``)."""
        places = self.places[chosen]
        outline = _outline(selected_vectors(self.points, places), self.pattern, alternative)
        distances = np.full(len(chosen), np.inf)
        near = np.flatnonzero(may_be_near(outline, self.limit))
        if len(near):
            errors = self.cells.error_bounds_of(places[near], self.pattern, alternative, self.points, self.limit)
            near, normal = near[errors.normal <= self.limit], errors.normal[errors.normal <= self.limit]
        if len(near):
            hull = self.cells.hull_of(places[near], self.points, self.limit)
            distances[near] = leaf_distances(outline.at(near), hull, normal, self.limit, rounding)
        return distances + self.thickness(chosen, alternative)

    def thickness(self, chosen: IndexArray, alternative: int) -> FloatArray | float:
        """(n,): the distances between polygons and the triangles of a template."""
        if self.axes is None:
            return 0.0
        points = selected_vectors(self.points, self.places[chosen])
        return thickness_of_quads(points, self.pattern, alternative, self.axes)

    def at(self, chosen: IndexArray) -> QuadsOfPattern:
        """Some of them, by ascending index."""
        return replace(self, places=self.places[chosen])

    def error_bounds(self, chosen: IndexArray, alternative: int) -> ErrorBounds:
        """As in ``template_choice.WithErrorBounds``."""
        places = self.places[chosen]
        return self.cells.error_bounds_of(places, self.pattern, alternative, self.points, PROMISING * self.limit)


@dataclass(frozen=True)
class QuadsAlone:
    """The same quads, whose distances are bounded without their neighbours, wherever parameters lie. rounding: that of
    ``AdaptiveRequest``."""

    quads: QuadsOfPattern
    rounding: float

    def distances(self, chosen: IndexArray, alternative: int) -> FloatArray:
        """As in ``template_choice.WithDistances``."""
        return self.quads.leaf_distances(chosen, alternative, self.rounding)


def _outline(points: FloatArray, pattern: int, alternative: int) -> Outline:
    """Of quads with points (8 or more, P, 3)."""
    middles = [4 + side if pattern >> side & 1 else -1 for side in range(4)]
    return Outline(points, templates(pattern)[alternative], range(4), middles)


def patterns_of(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    if not np.any(hanging):
        return np.full(len(turns), WHOLE, dtype=np.int8)
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)
