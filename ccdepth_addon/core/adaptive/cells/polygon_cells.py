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
from ..leaf_bounds.triangle_shapes import along_and_across, least_heights, normals_of, triangle_normals
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..template_choice import PROMISING, Samples, off_lines
from ..templates import QUAD_POINTS, WHOLE, Template, Transitions, Triangle, triangle_table, triangle_template
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
        if known is None:
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
        whole, split = np.flatnonzero(patterns == WHOLE), np.flatnonzero((patterns != WHOLE) & (patterns != ALL_SPLIT))
        for chosen in filter(len, (whole, split)):
            part, own_known = self.at(chosen), None if known is None else known.at(chosen)
            if chosen is whole or request.transitions is Transitions.TRIANGLES:
                found.put(chosen, part._approximate_templates(patterns[chosen], request, own_known))
                if flat is not None and known is None:
                    found.accept_over_flat_parts(chosen[flat[chosen]], request.limit)
            else:
                sides, own_flat = hanging.reshape(-1, 3)[chosen].ravel(), None if flat is None else flat[chosen]
                own = super(TriangleCells, part).approximate(sides, request, flat=own_flat, known=own_known)
                found.put(chosen, own)
        return found

    def _approximate_templates(
        self, patterns: IndexArray, request: AdaptiveRequest, known: LeafApproximation | None
    ) -> LeafApproximation:
        """With sides split in patterns (P,), either in none or in all of these."""
        limit, drawn = request.limit, TrianglesByPattern(self._points(), patterns)
        sampled = drawn.off_sides_and_centre()
        samples, least = drawn.samples(sampled), np.sqrt(squared_norms(sampled)).max(axis=0)
        nearest, predicted = samples.alone()[0], samples.predicted_bounds()[0]
        likely, near = least <= limit, nearest <= limit
        # Where sides are split, most predictions turn out to be wrong.
        promising = (predicted <= PROMISING * limit) & (patterns == WHOLE)
        found = replace(LeafApproximation.none(len(self.nodes)), least=np.where(likely, least, nearest))
        if known is None:
            errors = _Errors.of(self, drawn, np.flatnonzero(likely | promising | near))
            errors.accept_within_limit(found, np.flatnonzero(likely), limit)
            errors.accept_along_surface(found, np.flatnonzero(promising & ~found.accepted), samples, limit)
            normal = np.full(len(self.nodes), np.inf)
        else:
            normal = known.normal.copy()
            errors = _Errors.of(self, drawn, np.flatnonzero(near & np.isinf(normal)))
        tried = np.flatnonzero(near & ~found.accepted)
        if len(tried):
            unknown = tried[np.isinf(normal[tried])]
            normal[unknown] = errors.at(unknown, limit, np.full(len(unknown), np.inf)).normal
            distances = self._leaf_distances(tried, drawn.at(tried), normal[tried], request)
            within = distances <= limit
            found.accepted[tried[within]] = found.alone[tried[within]] = True
            found.bounds[tried[within]] = distances[within]
        return found

    def _points(self) -> FloatArray:
        """(7, P, 3): the triangles' points on the surface, and their centres."""
        limits = self._quarters.limits_at_corners.reshape(-1, 3, 4, 3)
        corners = self.refinement.limits_at_corners.reshape(-1, 3, 3)
        by_triangle = [corners, limits[:, :, 1], limits[:, :1, 2]]
        return np.ascontiguousarray(np.concatenate(by_triangle, axis=1).swapaxes(0, 1))

    def _hulls(self, chosen: IndexArray, corners: FloatArray, limit: float) -> Iterator[tuple[IndexArray, Hull]]:
        """In blocks, of chosen triangles (n,): which of these, and their hull points; corners: (3, n, 3) on the
        surface."""
        is_known = self._nets.is_known[chosen]
        for own in index_chunks(np.flatnonzero(is_known), LEAVES_AT_ONCE):
            yield own, self._nets.hull(chosen[own])
        if len(rest := np.flatnonzero(~is_known)):
            yield rest, hull_of_fans(self.descent, chosen[rest], corners[:, rest], limit)

    def _leaf_distances(
        self, chosen: IndexArray, drawn: TrianglesByPattern, normal: FloatArray, request: AdaptiveRequest
    ) -> FloatArray:
        """(n,): as ``leaf_distance.leaf_distances``, for chosen triangles, as they are drawn; normal: (n,) error
        bounds along the normals."""
        near = np.flatnonzero(normal <= request.limit)
        found = np.full(len(normal), np.inf)
        for own, hull in self._hulls(chosen[near], drawn.points[CORNERS][:, near], request.limit):
            leaves = drawn.at(near[own]).leaves()
            found[near[own]] = leaf_distances(leaves, hull, normal[near[own]], request.limit, request.rounding)
        return found

    def error_bounds_of(
        self, chosen: IndexArray, drawn: TrianglesByPattern, limit: float, room: FloatArray | None
    ) -> ErrorBounds:
        """(n,) each: error bounds of the triangles of templates, those of their fans plus their own distances from
        these, for chosen triangles, as they are drawn. Either all of them have nets or none; without, for limit and
        room see ``fan_error_bounds``."""
        fan, normals = drawn.fan(), normals_of(drawn.triangles())
        # The quarters are in the order of the triangles.
        quarters = (3 * chosen[:, None] + np.arange(3)).ravel()
        facets = fan.facets.transpose(0, 2, 1, 3).reshape(4, -1, 3)
        given = facets, np.repeat(normals, 3, axis=1)
        if self._nets.is_known[chosen[0]]:
            own = self._nets.error_bounds(quarters, *given)
        else:
            own_room = None if room is None else np.repeat(room, 3)
            own = fan_error_bounds(self.descent, chosen, quarters, *given, limit, own_room)
        found = ErrorBounds(*(np.maximum.reduceat(each, 3 * np.arange(len(chosen))) for each in own.columns()))
        return found + fan.gaps_along(normals)


@dataclass(frozen=True)
class _Errors:
    """Error bounds of the triangles of some cells, as they are drawn; those with nets are all evaluated together."""

    cells: TriangleCells
    drawn: TrianglesByPattern
    is_known: BoolArray
    found: ErrorBounds

    @staticmethod
    def of(cells: TriangleCells, drawn: TrianglesByPattern, chosen: IndexArray) -> _Errors:
        """Ready for chosen cells."""
        is_known, found = cells._nets.is_known, ErrorBounds(*np.full((3, len(cells.nodes)), np.inf))
        with_nets = chosen[is_known[chosen]]
        if len(with_nets):
            found.put(with_nets, cells.error_bounds_of(with_nets, drawn.at(with_nets), np.inf, None))
        return _Errors(cells, drawn, is_known, found)

    def at(self, chosen: IndexArray, limit: float, room: FloatArray | None) -> ErrorBounds:
        """(n,): of chosen cells, those with nets among the cells these are ready for; for limit and room see
        ``fan_error_bounds``."""
        found, rest = self.found.at(chosen), np.flatnonzero(~self.is_known[chosen])
        if len(rest):
            own, own_room = chosen[rest], None if room is None else room[rest]
            found.put(rest, self.cells.error_bounds_of(own, self.drawn.at(own), limit, own_room))
        return found

    def accept_within_limit(self, found: LeafApproximation, tried: IndexArray, limit: float) -> None:
        """Accept those of some cells that are within the limit at equal parameters."""
        if not len(tried):
            return
        # Where sides are split the fan's distance is only a part of the error, so its bound has to be tight.
        room = None if np.all(self.drawn.patterns == WHOLE) else np.full(len(tried), np.inf)
        error_bounds = self.at(tried, limit, room)
        within = error_bounds.whole <= limit
        found.bounds[tried[within]] = error_bounds.whole[within]
        _accept(found, tried, within, error_bounds)

    def accept_along_surface(self, found: LeafApproximation, tried: IndexArray, samples: Samples, limit: float) -> None:
        """Accept those of some cells that are predicted to be within the limit along the surface. samples: of all."""
        if not len(tried):
            return
        room = LARGEST_OFFSET * least_heights(self.drawn.at(tried).triangles())
        error_bounds = self.at(tried, limit, room)
        predicted = samples.at(tried).predict(error_bounds.normal, error_bounds.tangential)
        is_wide = error_bounds.normal + error_bounds.tangential <= room
        _accept(found, tried, (predicted <= PROMISING * limit) & is_wide, error_bounds)


@dataclass(frozen=True)
class _Fans:
    """The fans beside the templates of n triangles (docs/adaptive.md, Triangles on the surface): the corners of their
    quarters' facets (4, 3, n, 3), and how far the middles of split sides are off these, (3, n, 3), with factors
    (3, n)."""

    facets: FloatArray
    sagittas: FloatArray
    gaps: FloatArray

    def gaps_along(self, normals: FloatArray) -> ErrorBounds:
        """(n,): bounds of what is between templates and fans, with unit normals (T, n, 3)."""
        off = [along_and_across(self.sagittas, normal) for normal in normals]
        normal, tangential = (np.max(each, axis=0) for each in zip(*off, strict=True))
        whole = np.sqrt(squared_norms(self.sagittas))
        return ErrorBounds(*((self.gaps * each).sum(axis=0) for each in (whole, normal, tangential)))


@dataclass(frozen=True)
class TrianglesByPattern:
    """n triangles of the control mesh by their points and centres on the surface (7, n, 3), drawn by the templates for
    their patterns of split sides (n,)."""

    points: FloatArray
    patterns: IndexArray

    def at(self, chosen: IndexArray) -> TrianglesByPattern:
        """Some of them, by index."""
        return TrianglesByPattern(selected_vectors(self.points, chosen), self.patterns[chosen])

    def is_split(self) -> BoolArray:
        """(3, n) which sides are."""
        return (self.patterns & PATTERN_BITS[:, None]) > 0

    def leaves(self) -> Leaves:
        """As ``leaf_distances`` sees them."""
        counts = TRIANGLE_COUNTS[self.patterns]
        vertices = TRIANGLES[self.patterns, : counts.max()].transpose(1, 2, 0)
        return Leaves.of(self.points, self.is_split(), vertices, counts)

    def triangles(self) -> FloatArray:
        """(T, 3, n, 3): the vertices of those that are drawn; what a template has less of is repeated."""
        return self.leaves().triangles

    def fan(self) -> _Fans:
        corners, lifts_and_gaps = self.points[CORNERS], _fans_of_templates()[:, self.patterns]
        chords = (corners + self.points[FOLLOWING]) / 2
        sagittas = np.where(self.is_split()[:, :, None], self.points[MIDDLES] - chords, 0.0)
        middles, (lifts, gaps) = chords + sagittas, lifts_and_gaps.swapaxes(1, 2)
        centroids = corners.mean(axis=0) + np.einsum("sp,spi->pi", lifts, sagittas)
        facets = np.stack([corners, middles, np.stack([centroids] * 3), np.roll(middles, 1, axis=0)])
        return _Fans(facets, sagittas, gaps)

    def off_sides_and_centre(self) -> FloatArray:
        """(4, n, 3): S - T where nothing is split: at the middles of the sides, and at the centre if all are whole; 0
        elsewhere."""
        points = self.points
        sides = points[MIDDLES] - (points[CORNERS] + points[FOLLOWING]) / 2
        centre = points[CENTRE] - points[CORNERS].mean(axis=0)
        is_whole = np.concatenate([~self.is_split(), [self.patterns == WHOLE]])
        return np.where(is_whole[..., None], np.concatenate([sides, centre[None]]), 0.0)

    def samples(self, sampled: FloatArray) -> Samples:
        """From S - T at some places (…, n, 3)."""
        points = self.points
        off = points[MIDDLES] - (points[CORNERS] + points[FOLLOWING]) / 2
        normals = triangle_normals(points, ((0, 1, 2),))[0]
        sides = points[FOLLOWING] - points[CORNERS]
        squares = squared_norms(sides)
        slopes = Samples.slopes_of(along_and_across(off, normals)[0].max(axis=0), np.sqrt(squares.min(axis=0)))
        beside = off_lines(off, sides, squares, self.is_split())
        normal, tangential = (each.max(axis=0, keepdims=True) for each in along_and_across(sampled, normals))
        return Samples(normal, tangential, slopes, beside)


def _template_of(pattern: int) -> Template:
    return ((0, 1, 2),) if pattern == WHOLE else triangle_template(pattern)


def _accept(found: LeafApproximation, tried: IndexArray, accepted: BoolArray, error_bounds: ErrorBounds) -> None:
    """Record the accepted ones (n,) of the cells that were tried, and their error bounds."""
    found.accepted[tried[accepted]] = True
    found.normal[tried[accepted]] = error_bounds.normal[accepted]
    found.tangential[tried[accepted]] = error_bounds.tangential[accepted]


# By patterns, as in ``triangle_table``.
TRIANGLES, TRIANGLE_COUNTS = triangle_table([_template_of(pattern) for pattern in range(ALL_SPLIT)])


def _fans_of_templates() -> FloatArray:
    """(2, patterns, 3): ``fan_of_template`` by patterns."""
    return np.stack([np.stack(fan_of_template(pattern)) for pattern in range(ALL_SPLIT)], axis=1)


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
