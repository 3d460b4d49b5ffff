# SPDX-License-Identifier: GPL-3.0-or-later
"""Which template approximates a cell: the first within the limit, in the order of what is sampled.

A template that exceeds the limit at equal parameters may be within it along the surface (``along_surface``). The
triangles around decide that later, so here a template is accepted by samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, selected_vectors, squared_norms, units
from ..mesh.folded_quads import is_folded
from .leaf_approximation import LeafApproximation
from .templates import COUNTS, WHOLE, Template

# Points of a quad (``templates.QUAD_POINTS``, then the centre): the corners its sides go from and to; and the middles
# of its sides and diagonals, each with what it is between.
STARTS, ENDS = [0, 1, 2, 3], [1, 2, 3, 0]
CHORDS = [(4, 0, 1), (5, 1, 2), (6, 2, 3), (7, 3, 0), (8, 0, 2), (8, 1, 3)]


class WithDistances(Protocol):
    """Cells whose distances from the templates for their patterns can be bounded."""

    def distances(self, chosen: IndexArray, alternatives: IndexArray) -> FloatArray:
        """(n,): upper bounds for some of them, by ascending index, and an alternative each (n,), as tight as it takes
        to compare them with the limit."""


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


def choose_along_surface(heights: FloatArray, limit: float) -> LeafApproximation:
    """The template that is sampled to be the lowest over its triangles (alternatives, P), where it is within the
    limit."""
    found = LeafApproximation.none(heights.shape[1])
    found.alternatives[:] = heights.argmin(axis=0)
    found.accepted[:] = heights.min(axis=0) <= limit
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


def sampled_heights(corners: FloatArray, off: FloatArray, patterns: NDArray[np.int8]) -> FloatArray:
    """(alternatives, P): the same along the quads' mean normals, from their corners (4 or more, P, 3) and S - T
    (6, P, 3) at the middles of their sides and diagonals."""
    normals = triangle_normals(corners, ((0, 1, 2), (0, 2, 3)))
    heights = np.abs(dot_products(off, (normals[0] + normals[1]) / 2))
    found = np.where(_is_alternative(patterns), np.where(_is_split(patterns), 0.0, heights[:4]).max(axis=0), np.inf)
    whole = np.flatnonzero(patterns == WHOLE)
    found[:2, whole] = np.maximum(found[:2, whole], heights[4:, whole])
    return found


def triangle_normals(points: FloatArray, template: Template) -> FloatArray:
    """(T, P, 3): unit normals of the triangles over points (…, P, 3); zero where there is no area."""
    a, b, c = (points[list(corners)] for corners in zip(*template, strict=True))
    return units(cross_products(b - a, c - a))
