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
from ..leaf_bounds.leaf_distance import Hull, Leaves, Outline, leaf_distances
from ..leaf_bounds.polygon_bounds import thickness_of_quads
from ..leaf_bounds.triangle_bounds import ErrorBounds
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..template_choice import (
    Samples,
    choose_alone,
    choose_along_surface,
    choose_shifted,
    choose_within_limit,
    folded_quads,
    off_sides_and_diagonals,
    sampled_distances,
)
from ..templates import (
    ALL_SPLIT,
    TRIANGLE_COUNTS,
    TRIANGLES,
    WHOLE,
    Transitions,
    template_groups,
    template_numbers,
)

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
    def distances_of(self, chosen: IndexArray, numbers: IndexArray, points: FloatArray, limit: float) -> FloatArray:
        """(n,): upper bounds of ‖S - T‖, for chosen quads by ascending index and the number of a template each (n,)
        (``template_numbers``), as tight as it takes to compare them with the limit. points: those of all."""

    @abstractmethod
    def error_bounds_of(self, chosen: IndexArray, numbers: IndexArray, points: FloatArray, limit: float) -> ErrorBounds:
        """(n,) each: error bounds along the normals and across, as tight as star bounds need them where the error along
        the normals is within the limit; chosen, numbers and points as in ``distances_of``."""

    def errors_along_normals_of(
        self, chosen: IndexArray, numbers: IndexArray, points: FloatArray, limit: float
    ) -> FloatArray:
        """(n,): the error bounds along the normals alone."""
        return self.error_bounds_of(chosen, numbers, points, limit).normal

    def shifted_distances_of(self, chosen: IndexArray, numbers: IndexArray, points: FloatArray) -> FloatArray:
        """(n,): the same at shifted parameters; inf where there are no such bounds."""
        return np.full(len(chosen), np.inf)

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
        flat: BoolArray | None = None,
        known: LeafApproximation | None = None,
    ) -> LeafApproximation:
        """As in ``Cells``."""
        patterns = patterns_of(hanging, self.turns())
        turns = self.turns().astype(np.int8)
        found = replace(LeafApproximation.none(len(self.nodes)), patterns=patterns, turns=turns)
        chosen = np.flatnonzero(patterns != ALL_SPLIT)
        if len(chosen):
            quads = QuadsByPattern(self.scratch(), chosen, patterns[chosen], self.points(), request)
            own = quads.approximate() if known is None else quads.approximate_alone(known.at(chosen))
            if flat is not None:
                over_flat = np.flatnonzero(flat[chosen])
                own.thickness[over_flat] = quads.at(over_flat).thickness(own.alternatives[over_flat])
                if known is None:
                    own.accept_over_flat_parts(over_flat, request.limit)
            own.folded[:] = quads.folded(own)
            found.put(chosen, replace(own, patterns=patterns[chosen], turns=turns[chosen]))
        return found

    def outlines(self, hanging: BoolArray, limit: float) -> Iterator[tuple[IndexArray, IndexArray, Outline, Hull]]:
        """As in ``Cells``."""
        cells, points = self.scratch(), self.points()
        patterns = patterns_of(hanging, self.turns())
        drawn = np.flatnonzero(patterns != ALL_SPLIT)
        hull = cells.hull_of(drawn, points, limit)
        for pattern in np.unique(patterns[drawn]).tolist():
            own = np.flatnonzero(patterns[drawn] == pattern)
            chosen = drawn[own]
            middles = [4 + side if pattern >> side & 1 else -1 for side in range(4)]
            outline = Outline(selected_vectors(points, chosen), range(4), middles)
            yield chosen, self.turns()[chosen], outline, hull.at(own)

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """As in ``Cells``."""
        cells, points = self.scratch(), self.points()
        numbers = template_numbers(approximation.patterns, approximation.alternatives)
        return cells.error_bounds_of(np.arange(len(self.nodes)), numbers, points, limit)


@dataclass(frozen=True)
class QuadsByPattern:
    """n quads of some cells, to be approximated by templates of patterns (n,).

    places: (n,), by ascending index; points: (9, P, 3), those of all the cells.
    """

    cells: QuadCells
    places: IndexArray
    patterns: NDArray[np.int8]
    points: FloatArray
    request: AdaptiveRequest

    def approximate(self) -> LeafApproximation:
        """By the templates, the likeliest first: one within the limit, or predicted to be."""
        limit, points = self.request.limit, self.own_points()
        sampled = sampled_distances(points, self.patterns)
        found = choose_within_limit(self, sampled, limit)
        least = sampled.min(axis=0)
        left = np.flatnonzero(~found.accepted)
        if len(left):
            samples = self.samples(left)
            least[left] = np.where(least[left] > limit, samples.alone().min(axis=0), least[left])
            found.put(left, choose_shifted(ShiftedQuads(self.at(left)), samples, limit))
            others = np.flatnonzero(~found.accepted[left])
            left, samples = left[others], samples.at(others)
            quads = self.at(left)
            tried = np.flatnonzero(~quads.as_polygons())
            found.put(left[tried], choose_along_surface(quads.at(tried), samples.at(tried), limit))
            last = np.flatnonzero(~found.accepted[left])
            nothing = LeafApproximation.none(len(last))
            found.put(left[last], choose_alone(QuadsAlone(quads.at(last), nothing), samples.at(last), limit))
        return replace(found, least=least)

    def approximate_alone(self, known: LeafApproximation) -> LeafApproximation:
        """Of each alone, without its neighbours. known: (n,), as in ``Cells``; those accepted there exceed the limit at
        equal parameters."""
        limit, least = self.request.limit, np.zeros(len(self.places))
        found, new = LeafApproximation.none(len(self.places)), np.flatnonzero(~known.accepted)
        if len(new):
            quads = self.at(new)
            found.put(new, choose_within_limit(quads, sampled_distances(quads.own_points(), quads.patterns), limit))
            new = new[~found.accepted[new]]
            found.put(new, choose_shifted(ShiftedQuads(self.at(new)), self.samples(new), limit))
        left = np.flatnonzero(~found.accepted)
        if len(left):
            samples = self.samples(left)
            least[left] = samples.alone().min(axis=0)
            found.put(left, choose_alone(QuadsAlone(self.at(left), known.at(left)), samples, limit))
        return replace(found, least=least)

    def samples(self, chosen: IndexArray) -> Samples:
        """Those of some of them."""
        points = selected_vectors(self.points, self.places[chosen])
        return Samples.of(points, off_sides_and_diagonals(points), self.patterns[chosen])

    def as_polygons(self) -> BoolArray:
        """(n,) which of them are drawn as polygons."""
        return (self.request.transitions is Transitions.NGONS) & (self.patterns != WHOLE)

    def folded(self, approximation: LeafApproximation) -> BoolArray:
        """(n,) which of them are folded, whole, as they are approximated."""
        whole = np.flatnonzero(approximation.accepted & (self.patterns == WHOLE))
        corners = selected_vectors(self.points[:4], self.places[whole])
        return folded_quads(approximation, whole, corners, self.request.axes)

    def own_points(self) -> FloatArray:
        """(9, n, 3)."""
        everything = len(self.places) == self.points.shape[1]
        return self.points if everything else selected_vectors(self.points, self.places)

    def distances(self, chosen: IndexArray, alternatives: IndexArray) -> FloatArray:
        """As in ``template_choice.WithDistances``."""
        numbers = template_numbers(self.patterns[chosen], alternatives)
        distances = self.cells.distances_of(self.places[chosen], numbers, self.points, self.request.limit)
        return self.with_thickness(distances, chosen, numbers)

    def leaf_distances(self, chosen: IndexArray, alternatives: IndexArray, normal: FloatArray) -> FloatArray:
        """(n,): the same of each leaf alone (``leaf_distance``). normal: (n,) error bounds along the normals, inf where
        they are not known."""
        limit, places, unknown = self.request.limit, self.places[chosen], np.flatnonzero(np.isinf(normal))
        numbers = template_numbers(self.patterns[chosen], alternatives)
        if len(unknown):
            of_unknown = places[unknown], numbers[unknown], self.points, limit
            normal[unknown] = self.cells.errors_along_normals_of(*of_unknown)
        distances, tried = np.full(len(chosen), np.inf), np.flatnonzero(normal <= limit)
        if len(tried):
            hull = self.cells.hull_of(places[tried], self.points, limit)
            is_whole = self.patterns[chosen[tried]] == WHOLE
            for near in filter(len, (np.flatnonzero(is_whole), np.flatnonzero(~is_whole))):
                own = tried[near]
                leaves = _leaves(selected_vectors(self.points, places[own]), numbers[own])
                distances[own] = leaf_distances(leaves, hull.at(near), normal[own], limit, self.request.rounding)
        return self.with_thickness(distances, chosen, numbers)

    def with_thickness(self, distances: FloatArray, chosen: IndexArray, numbers: IndexArray) -> FloatArray:
        """(n,): distances of the triangles of templates (n,), and of those within the limit that are drawn as polygons
        also how far the polygons are from the triangles."""
        if self.request.transitions is not Transitions.NGONS:
            return distances
        found, within = distances.copy(), np.flatnonzero(distances <= self.request.limit)
        found[within] += self.at(chosen[within])._thickness(numbers[within])
        return found

    def thickness(self, alternatives: NDArray[np.int8]) -> FloatArray:
        """(n,): how far those that are drawn as polygons are from the triangles of alternatives (n,); 0 elsewhere."""
        if self.request.transitions is not Transitions.NGONS:
            return np.zeros(len(self.places))
        return self._thickness(template_numbers(self.patterns, alternatives))

    def _thickness(self, numbers: IndexArray) -> FloatArray:
        """(n,): the same with N-gons, for numbers of templates (n,)."""
        found = np.zeros(len(self.places))
        for pattern, alternative, own in template_groups(numbers):
            if pattern != WHOLE:
                points = selected_vectors(self.points, self.places[own])
                found[own] = thickness_of_quads(points, pattern, alternative, self.request.axes)
        return found

    def at(self, chosen: IndexArray) -> QuadsByPattern:
        """Some of them, by ascending index."""
        return replace(self, places=self.places[chosen], patterns=self.patterns[chosen])

    def error_bounds(self, chosen: IndexArray, alternatives: IndexArray) -> ErrorBounds:
        """As in ``template_choice.WithErrorBounds``."""
        places, numbers = self.places[chosen], template_numbers(self.patterns[chosen], alternatives)
        return self.cells.error_bounds_of(places, numbers, self.points, self.request.limit)


@dataclass(frozen=True)
class ShiftedQuads:
    """The same quads, whose distances are bounded at shifted parameters."""

    quads: QuadsByPattern

    def distances(self, chosen: IndexArray, alternatives: IndexArray) -> FloatArray:
        """As in ``template_choice.WithDistances``."""
        quads, numbers = self.quads, template_numbers(self.quads.patterns[chosen], alternatives)
        distances = quads.cells.shifted_distances_of(quads.places[chosen], numbers, quads.points)
        return quads.with_thickness(distances, chosen, numbers)


@dataclass(frozen=True)
class QuadsAlone:
    """The same quads, whose distances are bounded without their neighbours, wherever parameters lie. known: (n,) how
    they are approximated, some with error bounds along the normals."""

    quads: QuadsByPattern
    known: LeafApproximation

    def distances(self, chosen: IndexArray, alternatives: IndexArray) -> FloatArray:
        """As in ``template_choice.WithDistances``."""
        is_known = self.known.alternatives[chosen] == alternatives
        normal = np.where(is_known, self.known.normal[chosen], np.inf)
        return self.quads.leaf_distances(chosen, alternatives, normal)


def _leaves(points: FloatArray, numbers: IndexArray) -> Leaves:
    """Of quads with points (8 or more, P, 3), and numbers of templates (P,)."""
    is_split = numbers % 16 >> np.arange(4)[:, None] & 1 > 0
    counts = TRIANGLE_COUNTS[numbers]
    return Leaves.of(points, is_split, TRIANGLES[numbers, : counts.max()].transpose(1, 2, 0), counts)


def patterns_of(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    if not np.any(hanging):
        return np.full(len(turns), WHOLE, dtype=np.int8)
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)
