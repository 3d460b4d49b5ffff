# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds and hull points of triangles of the control mesh, by the nets of their quarters.

docs/adaptive.md (Triangles on the surface) has the derivation.

A quarter has a corner of the triangle's, of whatever valence, and the centroid, of valence 3; the others are of
valence 4. Where all around is smooth and inside the surface, S is a known function of its net (``stencils``): bicubic
but for a last square at either of the two. A bilinear facet F is linear in its corners. So S - F is linear in both,
and a matrix for each valence bounds it over all quarters at once. Other quarters are refined (``irregular_bounds``,
``refined_hulls``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays.chunks import index_chunks
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, transformed_nets
from ...bounds.norm_bounds import certified_limit_factor
from ...surface.bicubic import FACET_ROWS
from ...surface.patches import classify_patches
from ...surface.refinement import Refinement
from ...surface.stencils import LARGEST_STENCIL_VALENCE, patch_stencils, quad_nets
from .leaf_distance import LEAVES_AT_ONCE, ExtraordinaryHullRows, Hull, extraordinary_hull_rows
from .triangle_bounds import ErrorBounds, differences_at_vertex, quad_pieces, square_at

# The hull points of a quarter that are near the surface: of two parts, and two for each curve.
NEAR_ROWS = 2 * 16 + 2 + 2


@dataclass(frozen=True)
class _LastSquare:
    """Functionals of the N points of a net and the 4 corners of a facet F, for a square at an extraordinary vertex.
    corners: (4, N + 4), B - F at its corners, where B is the bilinear facet over the limits there. differences:
    (2n + 10, N + 4), the second differences of its net; S - B is no longer than the longest of these, times factor, and
    no component of it than theirs."""

    corners: FloatArray
    differences: FloatArray
    factor: float


@dataclass(frozen=True)
class _QuarterRows:
    """S - F over a quarter, as functionals of the same. bicubic: (R, N + 4), Bernstein coefficients over its bicubic
    pieces; last: what is left at the vertex and at the centroid."""

    bicubic: FloatArray
    last: Sequence[_LastSquare]


@lru_cache(maxsize=LARGEST_STENCIL_VALENCE)
def _quarter_rows(valence: int) -> _QuarterRows:
    """For nets around a vertex of this valence."""
    pieces = quad_pieces((valence, 4, 3, 4))
    bicubic = [np.hstack([surface, -FACET_ROWS @ _at_corners(path)]) for path, surface in pieces.bicubic]
    last = []
    for path, own, net in pieces.last:
        corners = np.hstack([patch_stencils(own).limits @ net, -_at_corners(path)])
        differences = differences_at_vertex(own, net)
        with_facet = np.hstack([differences, np.zeros((len(differences), 4))])
        last.append(_LastSquare(corners, with_facet, certified_limit_factor(own)))
    return _QuarterRows(np.concatenate(bicubic), last)


def _at_corners(path: int) -> FloatArray:
    """(4, 4): from the corners of a bilinear facet to its points at the corners of the square at a path."""
    u, v = square_at(path).corners().T
    return np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)


@dataclass(frozen=True)
class QuarterNets:
    """The nets of quarters of P triangles, numbered triangle by triangle. is_known: (P,) bool, the triangles whose
    three quarters have nets. valences: of the vertices there are; and for each the quarters (m,), ascending, and their
    nets (N, m, 3)."""

    is_known: BoolArray
    valences: Sequence[int]
    quarters: Sequence[IndexArray]
    nets: Sequence[FloatArray]

    @staticmethod
    def of(refinement: Refinement) -> QuarterNets:
        """refinement: of the quarters, with the faces around them."""
        mesh, count = refinement.mesh, len(refinement.bases)
        around = mesh.vertex_face_counts[mesh.corner_vertices[mesh.face_starts[:count]]]
        is_inside = classify_patches(mesh).inside[:count] & (around <= LARGEST_STENCIL_VALENCE)
        is_known = np.logical_and.reduce(is_inside.reshape(-1, 3), axis=1)
        with_nets = np.repeat(is_known, 3)
        valences = np.unique(around[with_nets]).tolist()
        quarters = [np.flatnonzero(with_nets & (around == valence)) for valence in valences]
        nets = [
            quad_nets(mesh, mesh.face_starts[own], (valence, 4, 3, 4))
            for valence, own in zip(valences, quarters, strict=True)
        ]
        return QuarterNets(is_known, valences, quarters, nets)

    def error_bounds(self, chosen: IndexArray, facets: FloatArray, normals: FloatArray) -> ErrorBounds:
        """(C,): of chosen quarters (C,), ascending, whose triangles are known, and bilinear facets over their corners
        (4, C, 3). normals: (T, C, 3), those of all triangles there."""
        found = ErrorBounds(*(np.empty(len(chosen)) for _ in range(3)))
        for valence, quarters, nets in zip(self.valences, self.quarters, self.nets, strict=True):
            rows, own = _quarter_rows(valence), np.flatnonzero(np.isin(chosen, quarters, assume_unique=True))
            for block in index_chunks(own, LEAVES_AT_ONCE):
                of_block = selected_vectors(nets, np.searchsorted(quarters, chosen[block]))
                given = np.concatenate([of_block, selected_vectors(facets, block)])
                found.put(block, _error_bounds(rows, given, selected_vectors(normals, block)))
        return found

    def hull(self, chosen: IndexArray) -> Hull:
        """Hull points of chosen triangles (n,), ascending, that are known."""
        own_rows = [extraordinary_hull_rows((valence, 4, 3, 4)) for valence in self.valences]
        layout = _HullLayout.of(own_rows)
        points = np.empty((3, layout.row_count, 3, len(chosen))).swapaxes(2, 3)
        spread = np.zeros((3, layout.most_spread, 3, len(chosen))).swapaxes(2, 3)
        for rows, quarters, nets in zip(own_rows, self.quarters, self.nets, strict=True):
            matrix = rows.points[layout.rows_of(rows)]
            for place in range(3):
                own = np.flatnonzero(np.isin(3 * chosen + place, quarters, assume_unique=True))
                of_own = selected_vectors(nets, np.searchsorted(quarters, 3 * chosen[own] + place))
                points[place][:, own] = transformed_nets(matrix, of_own)
                spread[place, : len(rows.spread), own] = transformed_nets(rows.spread, of_own).swapaxes(0, 1)
        shape = (-1, len(chosen), 3)
        return Hull(points.reshape(shape), *layout.of_triangles(), spread.reshape(shape))


@dataclass(frozen=True)
class _HullLayout:
    """How the hull points of a quarter are arranged, whatever the valence of its vertex: those that are near, of two
    parts, of the curve over the side from the vertex, and over that to the vertex; then so many parts and points that
    are exact, in the same order. What a valence has less of is repeated. most_spread: as in ``Hull``, the most that any
    has."""

    exact_parts: int
    first_curve: int
    last_curve: int
    most_spread: int

    @staticmethod
    def of(rows: Sequence[ExtraordinaryHullRows]) -> _HullLayout:
        """With room for each of these."""
        sizes = [(*map(len, _parts_and_curves(own, is_near=False)), len(own.spread)) for own in rows]
        return _HullLayout(*np.max(sizes, axis=0).tolist())

    @property
    def row_count(self) -> int:
        return NEAR_ROWS + 16 * self.exact_parts + self.first_curve + self.last_curve

    def rows_of(self, rows: ExtraordinaryHullRows) -> IndexArray:
        """(row_count,): those of the functionals of a valence, in this order."""
        near, exact = (_parts_and_curves(rows, is_near=is_near) for is_near in (True, False))
        counts = [2, 2, 2, self.exact_parts, self.first_curve, self.last_curve]
        # A vertex of valence 4 has nothing that is near: exact points do as well.
        given = [own if len(own) else other for own, other in zip(near, exact, strict=True)] + exact
        repeated = [own[np.minimum(np.arange(count), len(own) - 1)] for own, count in zip(given, counts, strict=True)]
        return np.concatenate([own.ravel() for own in repeated])

    def of_triangles(self) -> tuple[IndexArray, Sequence[Sequence[IndexArray]], BoolArray]:
        """Of three quarters one after the other: parts, sides and is_near, as in ``Hull``."""
        starts, rows = self.row_count * np.arange(3)[:, None], np.arange(self.row_count)
        near_first, near_last = rows[NEAR_ROWS - 4 : NEAR_ROWS - 2], rows[NEAR_ROWS - 2 : NEAR_ROWS]
        exact, first, last = np.split(rows[NEAR_ROWS:], np.cumsum([16 * self.exact_parts, self.first_curve]))
        parts = starts + np.concatenate([rows[: NEAR_ROWS - 4], exact])
        first, last = (starts + np.concatenate(both) for both in ((near_first, first), (near_last, last)))
        sides = [[first[side], last[(side + 1) % 3]] for side in range(3)]
        return parts.reshape(-1, 16), sides, np.tile(rows < NEAR_ROWS, 3)


def _parts_and_curves(rows: ExtraordinaryHullRows, *, is_near: bool) -> list[IndexArray]:
    """Of a quarter, its rows that are near, or those that are not: (parts, 16) of its parts, and (rows,) each for the
    curves over its sides from the vertex and to the vertex."""
    each = [rows.parts, *(np.concatenate(rows.sides[side]) for side in (0, 3))]
    return [own[(rows.is_near[own].reshape(len(own), -1)[:, 0]) == is_near] for own in each]


def _error_bounds(rows: _QuarterRows, given: FloatArray, normals: FloatArray) -> ErrorBounds:
    """(m,): for nets and facets (N + 4, m, 3), and all normals (T, m, 3) each."""
    found = ErrorBounds.over_all(transformed_nets(rows.bicubic, given), normals)
    for last in rows.last:
        left, off = (
            ErrorBounds.over_all(transformed_nets(each, given), normals) for each in (last.corners, last.differences)
        )
        found = found.or_more(left + off.times(last.factor))
    return found
