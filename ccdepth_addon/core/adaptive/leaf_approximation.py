# SPDX-License-Identifier: GPL-3.0-or-later
"""The triangles or polygons of leaves, by their split sides, and estimates of their distances from the surface.

Samples are the corners, the middles of the sides and the centre of a quad, and the middles and centre of any other
face. The height of a sample over the leaf's plane is at most its distance, so a leaf with a height beyond the limit has
to be split; ``leaf_bounds`` proves the other leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray
from ..arrays.vectors import cross_products, dot_products, lengths, selected_vectors, units
from ..bounds.polygon_bounds import fan_normals, polygon_thickness
from ..mesh.folded_quads import is_folded
from ..surface.refinement import Refinement
from .rectangle_tree import ALONG_U, ALONG_V, QUARTERS
from .request import AdaptiveRequest
from .templates import ALL_SPLIT, COUNTS, WHOLE, Template

# The points of a quad (``templates.QUAD_POINTS``, then the centre) that are compared with the middle of two others: the
# middles of sides, and the centre for both diagonals.
CHORDS = [(4, 0, 1), (5, 1, 2), (6, 2, 3), (7, 3, 0), (8, 0, 2), (8, 1, 3), (8, 7, 5), (8, 4, 6)]

# The points whose heights count along u, and along v.
CHORDS_ALONG = [[0, 2, 6], [1, 3, 7]]

PATTERN_BITS = np.array([1, 2, 4, 8])


@dataclass(frozen=True)
class LeafApproximation(Table):
    """The triangles or polygons of P leaves, with estimates of their distances from the surface: (P,) each.

    accepted: bool, whether the estimate is within the limit. patterns, alternatives: int8, the template (``templates``)
    of a quad, or of a triangle, without alternatives; 0 for polygons of more sides. folded: bool, whether the triangles
    of a whole quad face apart, here or where Blender triangulates the quad, so that two triangles are drawn. thickness:
    float64, a bound of the distance between a polygon of more sides and the triangles that replace it in proofs; 0 for
    quads and triangles. along_u, along_v: float64, the estimates along u and v of a quad, or of the whole face.
    ways: int8, how to split the leaf (``RectangleTree.split``).
    """

    accepted: BoolArray
    patterns: NDArray[np.int8]
    alternatives: NDArray[np.int8]
    folded: BoolArray
    thickness: FloatArray
    along_u: FloatArray
    along_v: FloatArray
    ways: NDArray[np.int8]

    @staticmethod
    def none(count: int) -> LeafApproximation:
        """An approximation with nothing accepted."""
        accepted, folded = np.zeros((2, count), dtype=bool)
        patterns, alternatives = np.zeros((2, count), dtype=np.int8)
        thickness, along_u, along_v = np.zeros((3, count))
        ways = np.full(count, QUARTERS, dtype=np.int8)
        return LeafApproximation(accepted, patterns, alternatives, folded, thickness, along_u, along_v, ways)


def approximate_quads(
    points: FloatArray,
    is_split: BoolArray,
    is_border: BoolArray,
    are_bicubic: BoolArray,
    limits: FloatArray,
    axes: FloatArray,
) -> LeafApproximation:
    """The approximation of quads. points: (9, P, 3), of quads and their centres. is_split, is_border: (4, P) bool,
    whether sides are split, and whether the curve has to follow the side instead of the plane alone. limits: (P,), the
    largest distances allowed. axes: of the space where Blender triangulates."""
    found = LeafApproximation.none(points.shape[1])
    found.patterns[:] = PATTERN_BITS @ is_split
    off = np.stack([points[middle] - (points[start] + points[end]) / 2 for middle, start, end in CHORDS])
    normals = triangle_normals(points, ((0, 1, 2), (0, 2, 3))).mean(axis=0)
    missed, distances = np.abs(dot_products(off, normals)), lengths(off)
    for side in range(4):
        at_border = np.flatnonzero(is_border[side])
        chord = units(points[CHORDS[side][2], at_border] - points[CHORDS[side][1], at_border])
        away = off[side, at_border]
        missed[side, at_border] = lengths(away - dot_products(away, chord)[:, None] * chord)
    sampled, heights = (_of_templates(each, is_split, found.patterns) for each in (distances, missed))
    by_distance = sampled.min(axis=0) <= limits
    found.alternatives[:] = np.where(by_distance, sampled.argmin(axis=0), heights.argmin(axis=0))
    least = heights.min(axis=0)
    found.accepted[:] = (least <= limits) & (found.patterns != ALL_SPLIT)
    found.folded[:] = _are_folded(points, found, axes)
    for each, rows in zip((found.along_u, found.along_v), CHORDS_ALONG, strict=True):
        each[:] = missed[rows].max(axis=0)
    # Any split halves an error along the diagonals alone: split the longer sides.
    sides = [lengths(points[one] - points[other]) for one, other in ((7, 5), (4, 6))]
    is_twisted = np.maximum(found.along_u, found.along_v) < least / 2
    is_longer = np.where(is_twisted, sides[0] >= sides[1], found.along_u >= found.along_v)
    is_halved = are_bicubic & (found.patterns != ALL_SPLIT)
    found.ways[:] = np.where(is_halved, np.where(is_longer, ALONG_U, ALONG_V), QUARTERS)
    return found


def ways_by_coefficients(coefficients: FloatArray) -> NDArray[np.int8]:
    """(P,): how to halve bicubic quads with coefficients (16, P, 3): along the parameter with the larger second
    derivatives; where mixed derivatives are the largest, across the shorter sides, as any split halves mixed
    derivatives."""
    net = coefficients.reshape(4, 4, -1, 3)
    along_u, along_v = (6 * lengths(np.diff(net, n=2, axis=axis)).max(axis=(0, 1)) for axis in (0, 1))
    mixed = 9 * lengths(np.diff(np.diff(net, axis=0), axis=1)).max(axis=(0, 1))
    sides = [lengths(np.diff(net, axis=axis)).max(axis=(0, 1)) for axis in (0, 1)]
    is_u = np.where(np.maximum(along_u, along_v) < mixed, sides[0] >= sides[1], along_u >= along_v)
    return np.where(is_u, ALONG_U, ALONG_V).astype(np.int8)


def _of_templates(missed: FloatArray, is_split: BoolArray, patterns: NDArray[np.int8]) -> FloatArray:
    """(alternatives, P): the largest errors (8, P) over the whole sides of quads and, without split sides, the
    diagonals; inf beyond the alternatives of a pattern (P,)."""
    counts = COUNTS[patterns]
    sides = np.where(is_split, 0.0, missed[:4]).max(axis=0)
    found = np.where(np.arange(COUNTS.max())[:, None] < np.maximum(counts, 1), sides, np.inf)
    whole = np.flatnonzero(patterns == WHOLE)
    found[:2, whole] = np.maximum(sides[whole], missed[4:6, whole])
    return found


def _are_folded(points: FloatArray, found: LeafApproximation, axes: FloatArray) -> BoolArray:
    """(P,) bool: whether whole quads are drawn folded. axes: of the space where Blender triangulates."""
    spaces = [np.eye(3)] if np.array_equal(axes, np.eye(3)) else [np.eye(3), axes]
    folded = np.zeros(len(found.folded), dtype=bool)
    for alternative, order in enumerate(([0, 1, 2, 3], [1, 2, 3, 0])):
        own = np.flatnonzero(found.accepted & (found.patterns == WHOLE) & (found.alternatives == alternative))
        folded[own] = is_folded(selected_vectors(points, own)[order], *spaces)
    return folded


def approximate_polygons(
    refinement: Refinement, is_split: BoolArray, limits: FloatArray, request: AdaptiveRequest
) -> LeafApproximation:
    """The approximation of the faces of a refinement, none of them quads. is_split: (C,) bool, the split sides, face by
    face. limits: (P,), the largest distances allowed. Triangles have the triangles of their templates; other faces are
    drawn whole, with the middles of split sides."""
    mesh = refinement.mesh
    count = len(refinement.bases)
    sizes, starts = mesh.face_sizes[:count], mesh.face_starts[:count]
    found = LeafApproximation.none(count)
    corners = refinement.limits_at_corners
    middles, centres = refinement.limits_inside()
    facets = refinement.facets_of_children(corners)
    off_sides = middles - facets[1]
    facets[1] = np.where(is_split[:, None], middles, facets[1])
    facets[3] = facets[1][mesh.previous_corner[: len(corners)]]
    is_any_split = np.logical_or.reduceat(is_split, starts)
    is_triangle = sizes == 3
    of_triangles = is_split[(starts[is_triangle, None] + np.arange(3))]
    found.patterns[is_triangle] = of_triangles @ PATTERN_BITS[:3]
    normals = np.repeat(fan_normals(facets, starts), sizes, axis=0)
    is_border = mesh.edge_face_counts[mesh.corner_edges[: len(corners)]] != 2
    sides = units(corners[mesh.next_corner[: len(corners)]] - corners)
    across = lengths(off_sides - dot_products(off_sides, sides)[:, None] * sides)
    missed = np.where(is_border, across, np.abs(dot_products(off_sides, normals)))
    at_centres = np.where(np.repeat(is_any_split & is_triangle, sizes), 0.0, dot_products(centres - facets[2], normals))
    found.along_u[:] = np.maximum.reduceat(np.maximum(missed, np.abs(at_centres)), starts)
    found.along_v[:] = found.along_u
    least = np.maximum.reduceat(np.where(is_split, np.abs(at_centres), np.maximum(missed, np.abs(at_centres))), starts)
    polygons = np.flatnonzero(~is_triangle)
    if len(polygons):
        kept = np.flatnonzero(np.repeat(~is_triangle, sizes))
        of_polygons = np.cumsum(sizes[polygons]) - sizes[polygons]
        found.thickness[polygons] = polygon_thickness(
            facets[:, kept], is_split[kept], of_polygons, request.axes, largest=request.largest_coordinate
        )
    found.accepted[:] = (least <= limits) & (found.thickness <= limits) & ~np.logical_and.reduceat(is_split, starts)
    return found


def triangle_normals(points: FloatArray, template: Template) -> FloatArray:
    """(T, P, 3): unit normals of the triangles over points (…, P, 3); zero where there is no area."""
    a, b, c = (points[list(corners)] for corners in zip(*template, strict=True))
    return units(cross_products(b - a, c - a))
