# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces of the control mesh that are no quads, as cells: triangles, and polygons of more corners.

They are compared with the fan of bilinear facets over corner, middle of the side, centroid and middle of the side
before. The distance of a polygon from its fan, however it is triangulated, depends on its vertices alone
(``polygon_bounds``). A triangle is its own fan; one with split sides is near to a fan that bends with them
(``fan_of_template``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Self

import numpy as np

from ...arrays.chunks import index_chunks
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors, squared_norms
from ...mesh.submesh import corners_of_faces
from ...surface.refinement import Refinement
from ..leaf_approximation import Cells, LeafApproximation
from ..leaf_bounds.descent import Descent
from ..leaf_bounds.fan_bounds import QuarterNets
from ..leaf_bounds.irregular_bounds import fan_error_bounds
from ..leaf_bounds.leaf_distance import LEAVES_AT_ONCE, Hull, Leaves, Outline, leaf_distances
from ..leaf_bounds.polygon_bounds import polygon_thickness
from ..leaf_bounds.refined_hulls import hull_of_fans
from ..leaf_bounds.triangle_bounds import ErrorBounds
from ..leaf_bounds.triangle_shapes import along_and_across, least_heights, triangle_normals
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..template_choice import PROMISING, Samples, off_lines
from ..templates import QUAD_POINTS, WHOLE, Template, Transitions, Triangle, triangle_template
from .irregular_cells import refined_children
from .patch_cells import LEAST_OF_A_KIND

PATTERN_BITS = np.array([1, 2, 4])
ALL_SPLIT = 7

# The points of a triangle are its corners 0 to 2, the middles 3 to 5 of the sides from them, and its centre.
CORNERS, MIDDLES, FOLLOWING = [0, 1, 2], [3, 4, 5], [1, 2, 0]
CENTRE = 6

# Weights of the corners for the corners and the middles.
TRIANGLE_POINTS: FloatArray = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]], dtype=np.float64
)

# The weights of the corners for the centroid, times six.
SIXTHS: FloatArray = np.full(3, 2.0)

# The largest error of triangles, along and across together, in parts of their least height, at which ``star_bounds``
# may hold: it requires less than a third of the least height around.
LARGEST_OFFSET = 0.33

# How often a quarter is halved both ways where a template is compared with its fan: each time the bound is twice as
# near.
HALVINGS = 10


@dataclass(frozen=True)
class PolygonCells:
    """P faces by the refined mesh, with the neighbours it needs: descendant i is ``nodes[i]``."""

    nodes: IndexArray
    refinement: Refinement

    @cached_property
    def descent(self) -> Descent:
        """The descendants of their quarters, as far as they have been asked for."""
        return Descent.of_fans(self.refinement)

    def at(self, chosen: IndexArray) -> Self:
        """Some of them, by index."""
        wanted = np.zeros(len(self.nodes), dtype=bool)
        wanted[chosen] = True
        return type(self)(self.nodes[np.sort(chosen)], self.refinement.keep(wanted).numbered())

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """As in ``Cells``."""
        return refined_children(tree, self.nodes, self.refinement, LEAST_OF_A_KIND)

    def approximate(
        self,
        hanging: BoolArray,
        request: AdaptiveRequest,
        *,
        flat: BoolArray | None = None,
        known: LeafApproximation | None = None,
    ) -> LeafApproximation:
        """As in ``Cells``: by way of fans that bend at the middles of split sides."""
        limit = request.limit
        found = LeafApproximation.none(len(self.nodes))
        corners = self.refinement.limits_at_corners
        middles, _ = self.refinement.limits_inside()
        facets = self.refinement.facets_of_children(corners)
        facets[1] = np.where(hanging[:, None], middles, facets[1])
        facets[3] = facets[1][self.refinement.mesh.previous_corner[: len(corners)]]
        starts = self.refinement.mesh.face_starts[: len(self.nodes)]
        found.least[:] = np.maximum.reduceat(np.sqrt(squared_norms(middles - facets[1])), starts)
        over_flat = np.zeros(len(self.nodes), dtype=bool) if flat is None else flat
        is_split = np.logical_and.reduceat(hanging, starts)
        chosen = np.flatnonzero((over_flat | (found.least <= limit)) & ~is_split)
        thickness = np.full(len(self.nodes), np.inf)
        if len(chosen):
            kept, starts = self._corners_of(chosen)
            thickness[chosen] = polygon_thickness(facets[:, kept], hanging[kept], starts, request.axes)
        chosen = chosen[found.least[chosen] <= limit]
        if len(chosen):
            kept, starts = self._corners_of(chosen)
            normals = np.zeros((1, len(kept), 3))
            own = fan_error_bounds(replace(self).descent, chosen, kept, facets[:, kept], normals, limit)
            bounds = np.maximum.reduceat(own.whole, starts) + thickness[chosen]
            found.accepted[chosen] = bounds <= limit
            found.bounds[chosen] = np.where(bounds <= limit, bounds, np.inf)
        chosen = np.flatnonzero(over_flat)
        found.thickness[chosen] = thickness[chosen]
        found.accept_over_flat_parts(chosen, limit)
        return found

    def _corners_of(self, chosen: IndexArray) -> tuple[IndexArray, IndexArray]:
        """The corners of chosen faces, and where each face's begin among these."""
        sizes = self.refinement.mesh.face_sizes[chosen]
        return corners_of_faces(self.refinement.mesh, chosen), np.cumsum(sizes) - sizes

    def error_bounds(self, approximation: LeafApproximation, limit: float) -> ErrorBounds:
        """As in ``Cells``: both are at most the bounds of the whole distance, if these are at equal parameters."""
        bounds = np.where(approximation.alone, np.inf, approximation.bounds)
        return ErrorBounds(bounds, bounds, bounds)

    def outlines(self, hanging: BoolArray, limit: float) -> Iterator[tuple[IndexArray, IndexArray, Outline, Hull]]:
        """As in ``Cells``."""
        sizes = self.refinement.mesh.face_sizes[: len(self.nodes)]
        drawn = ~np.logical_and.reduceat(hanging, self.refinement.mesh.face_starts[: len(self.nodes)])
        for size in np.unique(sizes[drawn]).tolist():
            chosen = np.flatnonzero(drawn & (sizes == size))
            points, hull = self.at(chosen)._hull(size, limit)
            sides = hanging[self._corners_of(chosen)[0]].reshape(-1, size)
            patterns, groups = np.unique(sides, axis=0, return_inverse=True)
            for number, split in enumerate(patterns.tolist()):
                own = np.flatnonzero(groups.reshape(-1) == number)
                middles = [size + side if split[side] else -1 for side in range(size)]
                outline = Outline(selected_vectors(points, own), range(size), middles)
                yield chosen[own], np.zeros_like(own), outline, hull.at(own)

    def _hull(self, size: int, limit: float) -> tuple[FloatArray, Hull]:
        """(2n, P, 3), the corners of faces of n corners and the middles of their sides on the surface; and a hull."""
        middles, _ = self.refinement.limits_inside()
        corners, middles = (
            points.reshape(-1, size, 3).swapaxes(0, 1) for points in (self.refinement.limits_at_corners, middles)
        )
        hull = hull_of_fans(self.descent, np.arange(len(self.nodes)), corners, limit)
        return np.concatenate([corners, middles]), hull


@dataclass(frozen=True)
class TriangleCells(PolygonCells):
    """P triangles of the control mesh."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        # Of few kinds, by the valence of the triangle's corner: all have nets.
        return refined_children(tree, self.nodes, self.refinement, least_of_a_kind=1)

    @cached_property
    def _quarters(self) -> Refinement:
        """With the faces around them, triangle by triangle."""
        return self.refinement.refined().numbered()

    @cached_property
    def _nets(self) -> QuarterNets:
        return QuarterNets.of(self._quarters)

    def approximate(
        self,
        hanging: BoolArray,
        request: AdaptiveRequest,
        *,
        flat: BoolArray | None = None,
        known: LeafApproximation | None = None,
    ) -> LeafApproximation:
        """As in ``Cells``; as polygons where sides are split and transitions are N-gons."""
        found = LeafApproximation.none(len(self.nodes))
        patterns = hanging.reshape(-1, 3) @ PATTERN_BITS
        for pattern in np.unique(patterns[patterns != ALL_SPLIT]).tolist():
            chosen = np.flatnonzero(patterns == pattern)
            part = self.at(chosen)
            if pattern == WHOLE or request.transitions is Transitions.TRIANGLES:
                own_known = None if known is None else known.at(chosen)
                found.put(chosen, part._approximate_template(pattern, request, own_known))
                if flat is not None:
                    found.accept_over_flat_parts(chosen[flat[chosen]], request.limit)
            else:
                sides = np.tile((pattern & PATTERN_BITS) > 0, len(chosen))
                own_flat = None if flat is None else flat[chosen]
                found.put(chosen, super(TriangleCells, part).approximate(sides, request, flat=own_flat))
        return found

    def _approximate_template(
        self, pattern: int, request: AdaptiveRequest, known: LeafApproximation | None
    ) -> LeafApproximation:
        template, limit = _template_of(pattern), request.limit
        points = self._points()
        sampled = off_sides_and_centre(points, pattern)
        least = np.sqrt(squared_norms(sampled)).max(axis=0)
        found = replace(LeafApproximation.none(len(self.nodes)), least=least)
        tried = np.flatnonzero(least <= limit)
        if known is None and len(tried):
            # Where sides are split the fan's distance is only a part of the error, so its bound has to be tight.
            room = None if pattern == WHOLE else np.full(len(tried), np.inf)
            error_bounds = self._error_bounds(tried, pattern, template, points, limit, room)
            within = error_bounds.whole <= limit
            found.bounds[tried[within]] = error_bounds.whole[within]
            _accept(found, tried, within, error_bounds)
        samples = samples_of_triangles(points, sampled, pattern)
        nearest = samples.alone()[0]
        found.least[found.least > limit] = nearest[found.least > limit]
        tried = np.flatnonzero(~found.accepted & (samples.predicted_bounds()[0] <= PROMISING * limit))
        if known is None and len(tried):
            room = LARGEST_OFFSET * least_heights(points[:, tried], template)
            error_bounds = self._error_bounds(tried, pattern, template, points, limit, room)
            predicted = samples.at(tried).predict(error_bounds.normal, error_bounds.tangential)[0]
            promising = (predicted <= PROMISING * limit) & (error_bounds.normal + error_bounds.tangential <= room)
            _accept(found, tried, promising, error_bounds)
        tried = np.flatnonzero(~found.accepted & (nearest <= limit))
        if len(tried):
            normal = np.full(len(tried), np.inf) if known is None else known.normal[tried]
            distances = self._leaf_distances(tried, pattern, points, normal, request)
            near = tried[distances <= limit]
            found.accepted[near], found.alone[near] = True, True
            found.bounds[near] = distances[distances <= limit]
        return found

    def _points(self) -> FloatArray:
        """(7, P, 3): the triangles' points on the surface, and their centres."""
        limits = self._quarters.limits_at_corners.reshape(-1, 3, 4, 3)
        corners = self.refinement.limits_at_corners.reshape(-1, 3, 3)
        by_triangle = [corners, limits[:, :, 1], limits[:, :1, 2]]
        return np.ascontiguousarray(np.concatenate(by_triangle, axis=1).swapaxes(0, 1))

    def _hulls(self, chosen: IndexArray, points: FloatArray, limit: float) -> Iterator[tuple[IndexArray, Hull]]:
        """In blocks, of chosen triangles (n,): which of these, and their hull points; points: those of all."""
        is_known = self._nets.is_known[chosen]
        for own in index_chunks(np.flatnonzero(is_known), LEAVES_AT_ONCE):
            yield own, self._nets.hull(chosen[own])
        if len(rest := np.flatnonzero(~is_known)):
            yield rest, hull_of_fans(self.descent, chosen[rest], points[CORNERS][:, chosen[rest]], limit)

    def _leaf_distances(
        self, chosen: IndexArray, pattern: int, points: FloatArray, normal: FloatArray, request: AdaptiveRequest
    ) -> FloatArray:
        """(n,): as ``leaf_distance.leaf_distances``, for chosen triangles; points: those of all; normal: (n,) error
        bounds along the normals, inf where they are not known."""
        limit, unknown = request.limit, np.flatnonzero(np.isinf(normal))
        if len(unknown):
            template, room = _template_of(pattern), np.full(len(unknown), np.inf)
            normal[unknown] = self._error_bounds(chosen[unknown], pattern, template, points, limit, room).normal
        near = np.flatnonzero(normal <= limit)
        found = np.full(len(normal), np.inf)
        for own, hull in self._hulls(chosen[near], points, limit):
            places = near[own]
            is_split = ((pattern & PATTERN_BITS) > 0).tolist()
            leaves = Leaves.alike(points[:, chosen[places]], is_split, _template_of(pattern))
            found[places] = leaf_distances(leaves, hull, normal[places], limit, request.rounding)
        return found

    def _error_bounds(
        self,
        chosen: IndexArray,
        pattern: int,
        template: Template,
        points: FloatArray,
        limit: float,
        room: FloatArray | None,
    ) -> ErrorBounds:
        """(n,) each: error bounds of a template's triangles, those of their fan plus their own distance from it, for
        chosen triangles; points: those of all."""
        points = points[:, chosen]
        split_sides = (pattern & PATTERN_BITS) > 0
        chords = (points[CORNERS] + points[FOLLOWING]) / 2
        sagittas = np.where(split_sides[:, None, None], points[MIDDLES] - chords, 0.0)
        lifts, gaps = fan_of_template(pattern)
        middles = chords + sagittas
        centroids = points[CORNERS].mean(axis=0) + np.einsum("s,spi->pi", lifts, sagittas)
        facets = np.stack([points[CORNERS], middles, np.stack([centroids] * 3), np.roll(middles, 1, axis=0)])
        normals = triangle_normals(points, template)
        # The quarters are in the order of the triangles.
        own = self._fan_error_bounds(chosen, facets.transpose(0, 2, 1, 3).reshape(4, -1, 3), normals, limit, room)
        found = ErrorBounds(*(np.maximum.reduceat(each, 3 * np.arange(points.shape[1])) for each in own.columns()))
        for gap, sagitta in zip(gaps.tolist(), sagittas, strict=True):
            off = [along_and_across(sagitta[None], normal) for normal in normals]
            normal, tangential = (np.max(each, axis=0)[0] for each in zip(*off, strict=True))
            found = found + ErrorBounds(np.sqrt(squared_norms(sagitta)), normal, tangential).times(gap)
        return found

    def _fan_error_bounds(
        self, chosen: IndexArray, facets: FloatArray, normals: FloatArray, limit: float, room: FloatArray | None
    ) -> ErrorBounds:
        """(3n,) error bounds of bilinear facets over the corners (4, 3n, 3) of the quarters of chosen triangles (n,).
        normals: (T, n, 3), of the triangles of the template."""
        found, is_known = ErrorBounds(*(np.empty(3 * len(chosen)) for _ in range(3))), self._nets.is_known[chosen]
        for own in (known := np.flatnonzero(is_known)), np.flatnonzero(~is_known):
            if not len(own):
                continue
            places, quarters = ((3 * each[:, None] + np.arange(3)).ravel() for each in (own, chosen[own]))
            given = selected_vectors(facets, places), np.repeat(selected_vectors(normals, own), 3, axis=1)
            if own is known:
                found.put(places, self._nets.error_bounds(quarters, *given))
            else:
                own_room = None if room is None else np.repeat(room[own], 3)
                found.put(places, fan_error_bounds(self.descent, chosen[own], quarters, *given, limit, own_room))
        return found


def _template_of(pattern: int) -> Template:
    return ((0, 1, 2),) if pattern == WHOLE else triangle_template(pattern)


def _accept(found: LeafApproximation, tried: IndexArray, accepted: BoolArray, error_bounds: ErrorBounds) -> None:
    """Record the accepted ones (n,) of the cells that were tried, and their error bounds."""
    found.accepted[tried[accepted]] = True
    found.normal[tried[accepted]] = error_bounds.normal[accepted]
    found.tangential[tried[accepted]] = error_bounds.tangential[accepted]


def off_sides_and_centre(points: FloatArray, pattern: int) -> FloatArray:
    """(…, P, 3): S - T where nothing is split, from the triangles' points and centres (7, P, 3): at the middles of the
    sides, and at the centre if all are whole."""
    sides = points[MIDDLES] - (points[CORNERS] + points[FOLLOWING]) / 2
    sampled = sides[[side for side in range(3) if not pattern >> side & 1]]
    if pattern == WHOLE:
        return np.concatenate([sampled, [points[CENTRE] - points[CORNERS].mean(axis=0)]])
    return sampled


def samples_of_triangles(points: FloatArray, sampled: FloatArray, pattern: int) -> Samples:
    """Of triangles by their points and centres (7, P, 3), and S - T at some places (…, P, 3)."""
    off = points[MIDDLES] - (points[CORNERS] + points[FOLLOWING]) / 2
    normals = triangle_normals(points, ((0, 1, 2),))[0]
    sides = points[FOLLOWING] - points[CORNERS]
    squares = squared_norms(sides)
    slopes = Samples.slopes_of(along_and_across(off, normals)[0].max(axis=0), np.sqrt(squares.min(axis=0)))
    beside = off_lines(off, sides, squares, ((pattern & PATTERN_BITS) > 0)[:, None])
    normal, tangential = (each.max(axis=0, keepdims=True) for each in along_and_across(sampled, normals))
    return Samples(normal, tangential, slopes, beside)


@cache
def fan_of_template(pattern: int) -> tuple[FloatArray, FloatArray]:
    """A triangle's template against a fan, by how far the middles of split sides are off the sides: (3,) each.

    The template's triangles are those of the plain triangle and, for each split side s, its middle's way off times a
    function φ of the place: 1 at the middle, 0 at the other points and linear between. The fan's facets are those of
    the plain triangle and the same ways times functions ψ: bilinear, 1 at the middle, 0 at the corners and the other
    middles, and at the centroid what φ is there. Returns these values at the centroid, and what |φ - ψ| is at most
    (docs/adaptive.md, Triangles on the surface).
    """
    lifts, gaps = np.zeros(3), np.zeros(3)
    for side in (side for side in range(3) if pattern >> side & 1):
        pieces = [_hat_piece(triangle, side) for triangle in triangle_template(pattern)]
        lift = next(float(SIXTHS @ hat) for hat, inside in pieces if np.all(SIXTHS @ inside >= 0))
        lifts[side] = lift / 6
        gaps[side] = max(_gap_over_quarter(quarter, side, lift, pieces) for quarter in range(3)) / 6
    return lifts, gaps


def _hat_piece(triangle: Triangle, side: int) -> tuple[FloatArray, FloatArray]:
    """(3,) and (3, 3): from a place, by weights of the corners, to φ over one triangle of a template, and to the
    weights of this triangle's vertices. All are whole numbers."""
    inside = np.rint(np.linalg.inv(TRIANGLE_POINTS[list(triangle)]))
    return inside @ (np.array(triangle) == 3 + side), inside


def _gap_over_quarter(quarter: int, side: int, lift: float, pieces: list[tuple[FloatArray, FloatArray]]) -> float:
    """What 6|φ - ψ| is at most over a quarter of the triangle; lift: 6φ at the centroid.

    Over each triangle of the template φ is linear in the place and so bilinear in the quarter's parameters, as ψ is.
    A bilinear function is largest at a corner of a square. So a square is beside a triangle where one of this one's
    weights is negative at all four corners, and elsewhere |φ - ψ| is at most what it is at a corner, with the φ of some
    triangle that the square may meet. Squares for which that is not above a value that is reached are left alone, the
    others halved both ways. All numbers are multiples of 4⁻¹⁰ below 2⁶, so nothing is rounded.
    """
    before = (quarter - 1) % 3
    ring = 6 * np.stack([*TRIANGLE_POINTS[[quarter, 3 + quarter]], SIXTHS / 6, TRIANGLE_POINTS[3 + before]])
    bilinear = np.array([0.0, 6.0 * (quarter == side), lift, 6.0 * (before == side)])
    off = np.stack([np.rint(ring) @ hat - bilinear for hat, _ in pieces])
    weights = np.stack([np.rint(ring) @ inside for _, inside in pieces])
    origins, reached = np.zeros((1, 2)), 0.0
    for halving in range(HALVINGS + 1):
        u, v = np.moveaxis(origins[:, None] + QUAD_POINTS[:4] / 2**halving, 2, 0)
        basis = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=-1)
        at_corners = np.abs(np.einsum("sck,tk->tsc", basis, off))
        within = np.einsum("sck,tkw->tscw", basis, weights) >= 0
        reached = max(reached, float(at_corners[within.all(axis=3)].max(initial=0.0)))
        bounds = np.where(within.any(axis=2).all(axis=2), at_corners.max(axis=2), 0.0).max(axis=0)
        doubtful = bounds > reached
        halves = QUAD_POINTS[:4] / 2 ** (halving + 1)
        origins, bounds = (origins[doubtful, None] + halves).reshape(-1, 2), bounds[doubtful]
    return float(bounds.max(initial=reached))
