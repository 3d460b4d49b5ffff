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
from ...distance.leaf_surfaces import Tiles
from ..leaf_approximation import Cells, LeafApproximation
from ..leaf_bounds.polygon_bounds import thickness_of_quads
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..surface_pieces import DrawnTiles, quad_keys
from ..template_choice import (
    choose_along_surface,
    choose_within_limit,
    folded_quads,
    off_sides_and_diagonals,
    sampled_distances,
    sampled_heights,
)
from ..templates import (
    ALL_SPLIT,
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
    def tiles(self, levels: int) -> Iterator[Tiles]:
        """Their surface, over squares whose bases are the quads."""

    def scratch(self) -> QuadCells:
        """The same quads for a while: what their methods keep for each other goes with them."""
        return self

    def approximate(self, hanging: BoolArray, request: AdaptiveRequest) -> LeafApproximation:
        """As in ``Cells``."""
        patterns = patterns_of(hanging, self.turns())
        turns = self.turns().astype(np.int8)
        found = replace(LeafApproximation.none(len(self.nodes)), patterns=patterns, turns=turns)
        chosen = np.flatnonzero(patterns != ALL_SPLIT)
        if len(chosen):
            quads = QuadsByPattern(self.scratch(), chosen, patterns[chosen], self.points(), request)
            own = quads.approximate()
            own.folded[:] = quads.folded(own)
            found.put(chosen, replace(own, patterns=patterns[chosen], turns=turns[chosen]))
        return found

    def drawn_tiles(self, approximation: LeafApproximation, hanging: BoolArray, levels: int) -> Iterator[DrawnTiles]:
        """As in ``Cells``."""
        numbers = template_numbers(approximation.patterns, approximation.alternatives)
        keys = quad_keys(numbers, (approximation.turns - self.turns()) % 4)
        for tiles in self.tiles(levels):
            own = tiles.squares.bases
            yield DrawnTiles(tiles, own, keys[own], np.zeros_like(own))


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
        """By the templates, the likeliest first: one within the limit, or that may be along the surface."""
        limit, points = self.request.limit, self.own_points()
        sampled = sampled_distances(points, self.patterns)
        found = choose_within_limit(self, sampled, limit)
        least = sampled.min(axis=0)
        left = np.flatnonzero(~found.accepted)
        if len(left):
            some = selected_vectors(points, left)
            heights = sampled_heights(some, off_sides_and_diagonals(some), self.patterns[left])
            least[left] = np.where(least[left] > limit, heights.min(axis=0), least[left])
            found.put(left, choose_along_surface(heights, limit))
        found.thickness[:] = np.where(found.accepted, self.thickness(found.alternatives), 0.0)
        return replace(found, least=least)

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
                found[own] = thickness_of_quads(
                    points, pattern, alternative, self.request.axes, self.request.largest_coordinate
                )
        return found

    def at(self, chosen: IndexArray) -> QuadsByPattern:
        """Some of them, by ascending index."""
        return replace(self, places=self.places[chosen], patterns=self.patterns[chosen])


def patterns_of(hanging: BoolArray, turns: IndexArray) -> NDArray[np.int8]:
    """(P,) the patterns of quads, counted from slot ``turns`` on."""
    if not np.any(hanging):
        return np.full(len(turns), WHOLE, dtype=np.int8)
    sides = hanging.reshape(-1, 4)
    places = (np.arange(4) + turns[:, None]) % 4
    return (np.take_along_axis(sides, places, axis=1) @ PATTERN_BITS).astype(np.int8)
