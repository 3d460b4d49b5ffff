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

from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import dot_products, selected_vectors, squared_norms
from ...distance.leaf_surfaces import tiles_of
from ...mesh.submesh import corners_of_faces
from ...surface.refinement import Refinement
from ..leaf_approximation import Cells, LeafApproximation
from ..leaf_bounds.descent import Descent
from ..leaf_bounds.fan_bounds import QuarterNets
from ..leaf_bounds.irregular_bounds import fan_distances
from ..leaf_bounds.polygon_bounds import fan_normals, polygon_thickness
from ..quadtree import Quadtree
from ..request import AdaptiveRequest
from ..surface_pieces import DrawnTiles, half_keys, quarter_keys
from ..template_choice import triangle_normals
from ..templates import QUAD_POINTS, TRIANGLE_POINTS, WHOLE, Transitions, Triangle, triangle_template
from .irregular_cells import refined_children
from .patch_cells import LEAST_OF_A_KIND

PATTERN_BITS = np.array([1, 2, 4])
ALL_SPLIT = 7

# The alternative of triangles of the control mesh that are drawn as polygons, with their split sides' middles.
AS_POLYGON = 1

# The points of a triangle are its corners 0 to 2, the middles 3 to 5 of the sides from them, and its centre.
CORNERS, MIDDLES, FOLLOWING = [0, 1, 2], [3, 4, 5], [1, 2, 0]
CENTRE = 6

# The weights of the corners for the centroid, times six.
SIXTHS: FloatArray = np.full(3, 2.0)

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

    @cached_property
    def _quarters(self) -> Refinement:
        """With the faces around them, face by face."""
        return self.refinement.refined().numbered()

    def at(self, chosen: IndexArray) -> Self:
        """Some of them, by index."""
        wanted = np.zeros(len(self.nodes), dtype=bool)
        wanted[chosen] = True
        return type(self)(self.nodes[np.sort(chosen)], self.refinement.keep(wanted).numbered())

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        """As in ``Cells``."""
        return refined_children(tree, self.nodes, self.refinement, LEAST_OF_A_KIND)

    def approximate(self, hanging: BoolArray, request: AdaptiveRequest) -> LeafApproximation:
        """As in ``Cells``: by way of fans that bend at the middles of split sides."""
        limit = request.limit
        found = LeafApproximation.none(len(self.nodes))
        corners = self.refinement.limits_at_corners
        middles, centres = self.refinement.limits_inside()
        facets = self.refinement.facets_of_children(corners)
        facets[1] = np.where(hanging[:, None], middles, facets[1])
        facets[3] = facets[1][self.refinement.mesh.previous_corner[: len(corners)]]
        starts = self.refinement.mesh.face_starts[: len(self.nodes)]
        off_sides = middles - facets[1]
        found.least[:] = np.maximum.reduceat(np.sqrt(squared_norms(off_sides)), starts)
        normals = np.repeat(fan_normals(facets, starts), self.refinement.mesh.face_sizes[: len(self.nodes)], axis=0)
        heights = np.maximum(*(np.abs(dot_products(each, normals)) for each in (off_sides, centres - facets[2])))
        near = np.maximum.reduceat(heights, starts) <= limit
        chosen = np.flatnonzero((near | (found.least <= limit)) & ~np.logical_and.reduceat(hanging, starts))
        if len(chosen):
            kept, starts = self._corners_of(chosen)
            thickness = polygon_thickness(
                facets[:, kept], hanging[kept], starts, request.axes, largest=request.largest_coordinate
            )
            own = fan_distances(replace(self).descent, chosen, kept, facets[:, kept], limit)
            bounds = np.maximum.reduceat(own, starts) + thickness
            found.bounds[chosen] = np.where(bounds <= limit, bounds, np.inf)
            found.accepted[chosen] = (bounds <= limit) | (near[chosen] & (thickness <= limit))
            found.thickness[chosen] = thickness
        return found

    def drawn_tiles(self, approximation: LeafApproximation, hanging: BoolArray, levels: int) -> Iterator[DrawnTiles]:
        """As in ``Cells``: the halves of quarters, cut from corner to centroid."""
        mesh = self.refinement.mesh
        counts, starts = np.where(hanging, 2, 1), mesh.face_starts[: len(self.nodes)]
        faces, before = mesh.corner_faces[: len(hanging)], mesh.previous_corner[: len(hanging)]
        totals = np.add.reduceat(counts, starts)
        firsts = np.cumsum(counts) - counts
        firsts -= firsts[starts][faces]
        lasts = np.where(firsts == 0, totals[faces], firsts) - 1
        for tiles in tiles_of(self._quarters, levels):
            quarters = tiles.squares.bases
            after = half_keys(False, hanging), half_keys(True, hanging[before])
            for keys, own in zip(after, (firsts, lasts), strict=True):
                yield DrawnTiles(tiles, faces[quarters], keys[quarters], own[quarters])

    def _corners_of(self, chosen: IndexArray) -> tuple[IndexArray, IndexArray]:
        """The corners of chosen faces, and where each face's begin among these."""
        sizes = self.refinement.mesh.face_sizes[chosen]
        return corners_of_faces(self.refinement.mesh, chosen), np.cumsum(sizes) - sizes


@dataclass(frozen=True)
class TriangleCells(PolygonCells):
    """P triangles of the control mesh."""

    def children(self, tree: Quadtree) -> Iterator[Cells]:
        # Of few kinds, by the valence of the triangle's corner: all have nets.
        return refined_children(tree, self.nodes, self.refinement, least_of_a_kind=1)

    @cached_property
    def _nets(self) -> QuarterNets:
        return QuarterNets.of(self._quarters)

    def approximate(self, hanging: BoolArray, request: AdaptiveRequest) -> LeafApproximation:
        """As in ``Cells``; as polygons where sides are split and transitions are N-gons."""
        found = LeafApproximation.none(len(self.nodes))
        patterns = hanging.reshape(-1, 3) @ PATTERN_BITS
        whole, split = np.flatnonzero(patterns == WHOLE), np.flatnonzero((patterns != WHOLE) & (patterns != ALL_SPLIT))
        for chosen in filter(len, (whole, split)):
            part = self.at(chosen)
            if chosen is whole or request.transitions is Transitions.TRIANGLES:
                found.put(chosen, part._approximate_templates(patterns[chosen], request.limit))
            else:
                own = hanging.reshape(-1, 3)[chosen].ravel()
                own = super(TriangleCells, part).approximate(hanging.reshape(-1, 3)[chosen].ravel(), request)
                own.alternatives[:] = AS_POLYGON
                found.put(chosen, own)
        return found

    def _approximate_templates(self, patterns: IndexArray, limit: float) -> LeafApproximation:
        """With sides split in patterns (P,), either in none or in all of these."""
        drawn = TrianglesByPattern(self._points(), patterns)
        sampled = drawn.off_sides_and_centre()
        least = np.sqrt(squared_norms(sampled)).max(axis=0)
        heights = np.abs(dot_products(sampled, triangle_normals(drawn.points, ((0, 1, 2),))[0])).max(axis=0)
        found = LeafApproximation.none(len(self.nodes))
        found.least[:] = np.where(least <= limit, least, heights)
        found.accepted[:] = heights <= limit
        likely = np.flatnonzero(least <= limit)
        is_known = self._nets.is_known[likely]
        for chosen in filter(len, (likely[is_known], likely[~is_known])):
            distances = self._distances(chosen, drawn.at(chosen), limit)
            found.bounds[chosen] = np.where(distances <= limit, distances, np.inf)
        return found

    def drawn_tiles(self, approximation: LeafApproximation, hanging: BoolArray, levels: int) -> Iterator[DrawnTiles]:
        """As in ``Cells``."""
        patterns, are_polygons = hanging.reshape(-1, 3) @ PATTERN_BITS, approximation.alternatives == AS_POLYGON
        if np.any(are_polygons):
            for drawn in super().drawn_tiles(approximation, hanging, levels):
                yield drawn.at(np.flatnonzero(are_polygons[drawn.cells]))
        for tiles in tiles_of(self._quarters, levels):
            own, quarters = np.divmod(tiles.squares.bases, 3)
            drawn = DrawnTiles(tiles, own, quarter_keys(patterns[own], quarters), np.zeros_like(own))
            yield drawn.at(np.flatnonzero(~are_polygons[own]))

    def _points(self) -> FloatArray:
        """(7, P, 3): the triangles' points on the surface, and their centres."""
        limits = self._quarters.limits_at_corners.reshape(-1, 3, 4, 3)
        corners = self.refinement.limits_at_corners.reshape(-1, 3, 3)
        by_triangle = [corners, limits[:, :, 1], limits[:, :1, 2]]
        return np.ascontiguousarray(np.concatenate(by_triangle, axis=1).swapaxes(0, 1))

    def _distances(self, chosen: IndexArray, drawn: TrianglesByPattern, limit: float) -> FloatArray:
        """(n,): upper bounds of the distances of the triangles of templates, those of their fans plus their own
        distances from these, for chosen triangles, as they are drawn. Either all of them have nets or none."""
        fan = drawn.fan()
        # The quarters are in the order of the triangles.
        quarters = (3 * chosen[:, None] + np.arange(3)).ravel()
        facets = fan.facets.transpose(0, 2, 1, 3).reshape(4, -1, 3)
        if self._nets.is_known[chosen[0]]:
            own = self._nets.distances(quarters, facets)
        else:
            own = fan_distances(self.descent, chosen, quarters, facets, limit)
        return np.maximum.reduceat(own, 3 * np.arange(len(chosen))) + fan.gap()


@dataclass(frozen=True)
class _Fans:
    """The fans beside the templates of n triangles (docs/adaptive.md, Triangles on the surface): the corners of their
    quarters' facets (4, 3, n, 3), and how far the middles of split sides are off these, (3, n, 3), with factors
    (3, n)."""

    facets: FloatArray
    sagittas: FloatArray
    gaps: FloatArray

    def gap(self) -> FloatArray:
        """(n,): bounds of what is between templates and fans."""
        found: FloatArray = (self.gaps * np.sqrt(squared_norms(self.sagittas))).sum(axis=0)
        return found


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
