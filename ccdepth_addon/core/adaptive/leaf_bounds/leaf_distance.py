# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of one leaf from its surface, wherever parameters lie (docs/adaptive.md, A leaf on its own).

At equal parameters a point of the surface is off a triangle along its normal, and across it. Within the leaf, being
off across costs nothing as long as the leaf's border stays near: what counts is how far the surface is from the planes
of the triangles, how far the curves over the leaf's sides are from the sides, and how far the surface reaches beyond
them. That needs no neighbours, and holds at boundaries, creases and poles.

The surface is known by *hull points*: points, parts of which have convex hulls that hold the parts of the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays.chunks import chunks
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import cross_products, dot_products, selected_vectors, squared_norms, transformed_nets
from ...bounds.norm_bounds import certified_limit_factor
from ...bounds.norms import second_differences
from ...surface.bicubic import HALVES, SPLINE_TO_BERNSTEIN, tensor
from ...surface.stencils import Valences, patch_stencils, quad_stencils
from ..templates import Template
from .triangle_shapes import normals_of

# The bound is of no use between steeper triangles.
LEAST_COSINE = 0.25

# Temporary arrays for so many leaves stay in the processor's cache.
LEAVES_AT_ONCE = 1 << 8

# The size of the last square at an extraordinary vertex: it grows smaller by the subdominant eigenvalue at each level.
SMALL_SQUARE = 1 / 128

# Rounding of a ratio.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Leaves:
    """P leaves of S sides and the triangles over them, whose vertices lie on the surface.

    corners: (S, P, 3), in order; middles: (S, P, 3), of the sides from there; is_split: (S, P) bool, which of these are
    vertices. triangles: (T, 3, P, 3), the vertices of each, counter-clockwise; counts: (P,) of how many triangles; what
    a leaf has less of is repeated.
    """

    corners: FloatArray
    middles: FloatArray
    is_split: BoolArray
    triangles: FloatArray
    counts: IndexArray

    @staticmethod
    def of(points: FloatArray, is_split: BoolArray, vertices: IndexArray, counts: IndexArray) -> Leaves:
        """From points (2S or more, P, 3), the corners and then the middles of sides, some of which are split, (S, P);
        and the vertices (T, 3, P) of triangles among these."""
        size, components = len(is_split), points.swapaxes(1, 2)
        of_leaves = np.arange(points.shape[1])
        triangles = components[vertices[:, :, None], np.arange(3)[:, None], of_leaves].swapaxes(2, 3)
        return Leaves(points[:size], points[size : 2 * size], is_split, triangles, counts)

    @staticmethod
    def alike(points: FloatArray, is_split: Sequence[bool], template: Template) -> Leaves:
        """All with these sides split, and one template."""
        count = points.shape[1]
        vertices = np.broadcast_to(np.array(template)[:, :, None], (len(template), 3, count))
        split = np.broadcast_to(np.array(is_split)[:, None], (len(is_split), count))
        return Leaves.of(points, split, vertices, np.full(count, len(template)))

    def at(self, chosen: IndexArray) -> Leaves:
        """Some of them, by index."""
        corners, middles, triangles = (
            selected_vectors(each, chosen) for each in (self.corners, self.middles, self.triangles)
        )
        return Leaves(corners, middles, self.is_split[:, chosen], triangles, self.counts[chosen])

    def part(self, block: slice) -> Leaves:
        """Some of them, side by side."""
        corners, middles = self.corners[:, block], self.middles[:, block]
        return Leaves(corners, middles, self.is_split[:, block], self.triangles[:, :, block], self.counts[block])

    def vertices(self) -> FloatArray:
        """(V, P, 3): the corners and, where any leaf has sides split, after each the middle of its side; the corner
        again where that is whole."""
        if not np.any(self.is_split):
            return self.corners
        return _side_by_side(self.corners, np.where(self.is_split[..., None], self.middles, self.corners))

    def off_sides(self, hull: Hull) -> FloatArray:
        """(P,): how far the curves over the sides are off these at most."""
        ends, found, reach = np.roll(self.corners, -1, axis=0), np.zeros(len(self.counts)), hull.reach()
        for side, halves in enumerate(hull.sides):
            split, middles = self.is_split[side, :, None], self.middles[side]
            first = self.corners[side], np.where(split, middles, ends[side])
            second = np.where(split, middles, self.corners[side]), ends[side]
            for rows, segment in zip(halves, (first, second), strict=True):
                np.maximum(found, _off_segments(hull, reach, rows, *segment), out=found)
        return found


def _side_by_side(first: FloatArray, second: FloatArray) -> FloatArray:
    """(2S, P, 3): one of (S, P, 3) after the other by turns."""
    return np.stack([first, second], axis=1).reshape(-1, *first.shape[1:])


@dataclass(frozen=True)
class Outline:
    """The sides of P leaves.

    points: (V, P, 3), all lying on the surface; corners: the corners of the leaves, in order; middles: for each side
    from a corner the vertex at its middle if it is split, otherwise -1.
    """

    points: FloatArray
    corners: Sequence[int]
    middles: Sequence[int]

    def at(self, chosen: IndexArray) -> Outline:
        """Some of the leaves, by index."""
        return Outline(selected_vectors(self.points, chosen), self.corners, self.middles)

    def sides(self) -> list[tuple[int, int, int, bool, bool]]:
        """The sides of triangles along the border, from one vertex to the next: the number of the leaf's side, and
        whether its first half is part of it, and its second."""
        found = []
        for side, (start, middle) in enumerate(zip(self.corners, self.middles, strict=True)):
            end = self.corners[(side + 1) % len(self.corners)]
            if middle < 0:
                found.append((start, end, side, True, True))
            else:
                found += [(start, middle, side, True, False), (middle, end, side, False, True)]
        return found


@dataclass(frozen=True)
class Hull:
    """Hull points of P leaves. points: (R, P, 3). parts: (parts, rows), which of them have convex hulls that hold the
    surface together; a part of fewer has some twice. sides: for each side of a leaf and each half of it, (rows,) those
    for the curve over it. is_near: (R,) bool, the rows of parts that hold the surface nearly: there it may be off by a
    vector in the convex hull of spread (D, P, 3) and the opposites of these; and so may the curve along these rows.
    """

    points: FloatArray
    parts: IndexArray
    sides: Sequence[Sequence[IndexArray]]
    is_near: BoolArray
    spread: FloatArray

    def at(self, chosen: IndexArray) -> Hull:
        """Those of some leaves, by index."""
        return Hull(
            selected_vectors(self.points, chosen),
            self.parts,
            self.sides,
            self.is_near,
            selected_vectors(self.spread, chosen),
        )

    def part(self, block: slice) -> Hull:
        """Those of some leaves, side by side."""
        return Hull(self.points[:, block], self.parts, self.sides, self.is_near, self.spread[:, block])

    def reach(self) -> FloatArray:
        """(P,): how far from the hulls the surface may be, at most."""
        return np.sqrt(squared_norms(self.spread).max(axis=0, initial=0.0))

    def reach_along(self, directions: FloatArray) -> FloatArray:
        """(P,): how far in directions (P, 3), which need not be unit vectors, as products with these."""
        return np.abs(dot_products(self.spread, directions)).max(axis=0, initial=0.0)


def _bicubic_rows() -> FloatArray:
    """(49, 16): from Bernstein coefficients to those of the four quarters, [i, j] → 7i + j."""
    halves = np.concatenate([HALVES[0], HALVES[1][1:]])
    return tensor(halves, halves)


def _bicubic_parts() -> tuple[IndexArray, Sequence[Sequence[IndexArray]]]:
    """The parts and the sides of ``bicubic_hull``."""
    grid, halves = np.arange(49).reshape(7, 7), (slice(0, 4), slice(3, 7))
    along = [grid[:, 0], grid[6], grid[::-1, 6], grid[0, ::-1]]
    parts = np.stack([grid[u, v].ravel() for u in halves for v in halves])
    return parts, [[side[half] for half in halves] for side in along]


def bicubic_hull(coefficients: FloatArray) -> Hull:
    """Of bicubic quads with Bernstein coefficients (16, P, 3), [i, j] → 4i + j, u along i: those of their quarters."""
    points = transformed_nets(_bicubic_rows(), coefficients)
    return Hull(points, *_bicubic_parts(), np.zeros(len(points), dtype=bool), points[:0])


@dataclass(frozen=True)
class ExtraordinaryHullRows:
    """Functionals of a net of N points. points: (R, N), hull points; spread: (D, N), and the rest: as in ``Hull``."""

    points: FloatArray
    parts: IndexArray
    sides: Sequence[Sequence[IndexArray]]
    is_near: BoolArray
    spread: FloatArray


@lru_cache(maxsize=256)
def extraordinary_hull_rows(valences: Valences) -> ExtraordinaryHullRows:
    """Corner by corner the coefficients of the bicubic pieces of some levels, and the corners of a last square."""
    to_bernstein, children = tensor(SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN), quad_stencils(valences).children
    after, before, facet = np.array([0, 4, 8, 12]), np.array([3, 2, 1, 0]), np.arange(4)
    rows: list[FloatArray] = []
    parts: list[IndexArray] = []
    near: list[IndexArray] = []
    spread = [np.zeros((0, children[0].shape[1]))]
    # For each corner, the curves over the halves of the sides from there and to there.
    first, last = [], []
    start = 0
    for valence, net in zip(valences, children, strict=True):
        if valence == 4:
            rows.append(to_bernstein @ net)
            parts.append(start + np.arange(16))
            first.append(start + after)
            last.append(start + before)
            start += 16
            continue
        stencils, levels = patch_stencils(valence), _levels_at_vertex(valence) - 1
        # The pieces at corners 1 to 3 of each level.
        for _ in range(levels):
            rows.append(np.kron(np.eye(3), to_bernstein) @ stencils.regular @ net)
            net = stencils.refined @ net
        starts = start + 48 * np.arange(levels)[:, None]
        rows.append(stencils.limits @ net)
        own = start + 48 * levels + facet
        parts += [*(start + np.arange(48 * levels)).reshape(-1, 16), np.resize(own, 16)]
        near.append(own)
        first.append(np.concatenate([(starts + before).ravel(), own[[0, 1]]]))
        last.append(np.concatenate([(starts + 32 + after).ravel(), own[[3, 0]]]))
        start += 48 * levels + 4
        # The surface is off the bilinear facet over these corners by as much of each component as this one's second
        # differences tell: so by a vector in the hull of these, times the factor, and their opposites.
        middles, ones, others = second_differences(valence)
        spread.append(certified_limit_factor(valence) * (2 * net[middles] - net[ones] - net[others]))
    sides = [[first[side], last[(side + 1) % 4]] for side in range(4)]
    is_near = np.isin(np.arange(start), np.concatenate(near))
    return ExtraordinaryHullRows(np.concatenate(rows), np.stack(parts), sides, is_near, np.concatenate(spread))


def _levels_at_vertex(valence: int) -> int:
    """After so many the last square is small."""
    cosine = np.cos(np.pi / valence)
    rate = (4 + 2 * cosine**2 + cosine * np.sqrt(16 + 4 * cosine**2)) / 16
    return int(np.ceil(np.log(SMALL_SQUARE) / np.log(rate)))


def extraordinary_hull(nets: FloatArray, valences: Valences) -> Hull:
    """Of quads with corners of these valences, by nets (N, P, 3)."""
    rows = extraordinary_hull_rows(valences)
    points, spread = transformed_nets(rows.points, nets), transformed_nets(rows.spread, nets)
    return Hull(points, rows.parts, rows.sides, rows.is_near, spread)


def leaf_distances(leaves: Leaves, hull: Hull, normal: FloatArray, limit: float, rounding: float = 0.0) -> FloatArray:
    """(P,) float64: upper bounds of the distance in both directions between the surface of a leaf and its triangles;
    inf where there is no proof, or where the bound would exceed the limit.

    normal: (P,) float64, upper bounds of the error at equal parameters along the normals of the triangles. rounding:
    the allowance for these, hull points and vertices (docs/adaptive.md, Rounding).
    """
    count = len(leaves.counts)
    found = np.empty(count)
    for block in chunks(count, LEAVES_AT_ONCE):
        found[block] = _leaf_distances(leaves.part(block), hull.part(block), normal[block], limit, rounding)
    return found


# Degenerate triangles have no normals, and nothing is proved then.
@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _leaf_distances(leaves: Leaves, hull: Hull, normal: FloatArray, limit: float, rounding: float) -> FloatArray:
    """Test by test, each for the leaves that are within the limit by those before."""
    found = np.full(len(normal), np.inf)
    normal = normal + rounding
    sides = leaves.off_sides(hull) + rounding
    planes = _Planes.of(leaves, rounding)
    chosen = np.flatnonzero((normal <= limit) & (sides <= limit) & (planes.least(normal) <= limit))
    if not len(chosen):
        return found
    if len(chosen) < len(found):
        leaves, hull, planes = leaves.at(chosen), hull.at(chosen), planes.at(chosen)
    roofs = _Roofs.of(planes, hull, normal[chosen])
    from_triangles = np.maximum(roofs.nearest, sides[chosen] / planes.cosines + roofs.gaps)
    bounds = np.maximum(from_triangles, _from_surface(leaves, hull, roofs, rounding)) * (1 + ROUNDING)
    found[chosen] = np.where(bounds <= limit, bounds, np.inf)
    return found


@dataclass(frozen=True)
class _Roofs:
    """Over P leaves, the greatest of the heights of the triangles' planes, or the least of them.

    heights: (T, R, P) of hull points over the planes, turned round where it is the least. reach: (P,) by how much more
    the surface may be off where hulls hold it nearly. gaps: (P,) how far the triangles are off this function. nearest:
    (P,) how far the surface over the triangles is from them at most, along the axes; inf where the planes are too
    steep.
    """

    planes: _Planes
    heights: FloatArray
    reach: FloatArray
    gaps: FloatArray
    nearest: FloatArray

    @staticmethod
    def of(planes: _Planes, hull: Hull, normal: FloatArray) -> _Roofs:
        """normal: as in ``leaf_distances``."""
        heights = np.stack([dot_products(hull.points, scaled) for scaled in planes.scaled])
        heights -= planes.levels[:, None]
        reach = np.max([hull.reach_along(scaled) for scaled in planes.scaled], axis=0)
        vertical = normal / planes.cosines
        near = heights[:, hull.is_near]
        low = np.minimum(heights.min(axis=(0, 1)), near.min(axis=(0, 1), initial=np.inf) - reach)
        high = np.maximum(heights.max(axis=(0, 1)), near.max(axis=(0, 1), initial=-np.inf) + reach)
        as_greatest, as_least = np.maximum(vertical + planes.below, -low), np.maximum(vertical + planes.above, high)
        is_least = as_least < as_greatest
        heights *= np.where(is_least, -1.0, 1.0)
        nearest = np.minimum(as_greatest, as_least) + 2 * planes.residues
        nearest = np.where(planes.cosines > LEAST_COSINE, nearest, np.inf)
        gaps = np.where(is_least, planes.above, planes.below) + planes.residues
        return _Roofs(planes, heights, reach, gaps, nearest)


def _from_surface(leaves: Leaves, hull: Hull, roofs: _Roofs, rounding: float) -> FloatArray:
    """(P,): how far the surface is from the triangles at most."""
    slopes = roofs.planes.slopes
    beyond, dents = overshoot(leaves, hull.points, roofs.planes.axes)
    dents += rounding
    found = np.hypot(dents, roofs.nearest + slopes * dents)
    across = np.where(hull.is_near[hull.parts[:, :1]], hull.reach(), 0.0)
    parts, own = np.nonzero(np.any((beyond > 0)[hull.parts], axis=1) | (across > 0))
    rows = hull.parts[parts].T
    away = beyond[rows, own] + (across[parts, own] + dents[own])
    heights = roofs.heights[:, rows, own]
    lowest = heights.max(axis=1).argmin(axis=0)
    over = np.take_along_axis(heights, lowest[None, None], axis=0)[0] + roofs.gaps[own]
    off = np.maximum(over, -heights.min(axis=0)) + 2 * roofs.planes.residues[own]
    off += np.where(hull.is_near[rows], roofs.reach[own], 0.0)
    # By the heights of hull points, or by what holds for all heights.
    bounds = np.hypot(away, off + slopes[own] * away).max(axis=0)
    farthest = away.max(axis=0)
    bounds = np.minimum(bounds, np.hypot(farthest, roofs.nearest[own] + slopes[own] * farthest))
    np.maximum.at(found, own, bounds)
    return found


@dataclass(frozen=True)
class _Planes:
    """The planes of T triangles over each of P leaves, seen along axes (P, 3) of the leaves: the height of a point over
    a plane, along the axis, is its product with a vector scaled (T, P, 3), less levels (T, P). cosines and slopes: (P,)
    the least cosine of the triangles' tilt against the axis, and the greatest tangent. above, below and residues: (P,)
    how far vertices are above planes at most, and below, and how far off those of their own triangles."""

    axes: FloatArray
    scaled: FloatArray
    levels: FloatArray
    cosines: FloatArray
    slopes: FloatArray
    above: FloatArray
    below: FloatArray
    residues: FloatArray

    def at(self, chosen: IndexArray) -> _Planes:
        """Those of some leaves, by index."""
        return _Planes(
            self.axes[chosen],
            self.scaled[:, chosen],
            self.levels[:, chosen],
            self.cosines[chosen],
            self.slopes[chosen],
            self.above[chosen],
            self.below[chosen],
            self.residues[chosen],
        )

    @staticmethod
    def of(leaves: Leaves, rounding: float) -> _Planes:
        """rounding: as in ``leaf_distances``."""
        normals = normals_of(leaves.triangles)
        is_own = np.arange(len(normals))[:, None, None] < leaves.counts[:, None]
        axes = np.where(is_own, normals, 0.0).sum(axis=0)
        axes /= np.sqrt(squared_norms(axes))[:, None]
        cosines = dot_products(normals, axes)
        scaled = normals / cosines[..., None]
        levels = dot_products(leaves.triangles[:, 0], scaled)
        # By the chords, as cosines cannot resolve small angles.
        chords = squared_norms(normals - axes).max(axis=0)
        sines = np.sqrt(chords * np.maximum(1 - chords / 4, 0.0))
        least = cosines.min(axis=0)
        slopes = sines / least + ROUNDING
        heights = dot_products(leaves.vertices(), scaled[:, None]) - levels[:, None]
        above, below = (np.maximum(each.max(axis=(0, 1)), 0.0) for each in (heights, -heights))
        own = dot_products(leaves.triangles, scaled[:, None]) - levels[:, None]
        # Along the axes rounding counts for more.
        residues = np.abs(own).max(axis=(0, 1)) + rounding / least
        return _Planes(axes, scaled, levels, least, slopes, above, below, residues)

    def least(self, normal: FloatArray) -> FloatArray:
        """(P,): no bound is below this, whatever the surface; normal: as in ``leaf_distances``."""
        least = normal / self.cosines + np.minimum(self.above, self.below)
        return np.where(self.cosines > LEAST_COSINE, least, np.inf)


@dataclass(frozen=True)
class Side:
    """A side of triangles along the border of P leaves, from one of their vertices to another: part of the side of
    leaves with this number, its first half, its second, or all of it. off: (P,) how far the curves over it are off."""

    start: int
    end: int
    number: int
    is_first: bool
    is_second: bool
    off: FloatArray

    @property
    def is_whole(self) -> bool:
        return self.is_first and self.is_second


def off_sides(outline: Outline, hull: Hull) -> list[Side]:
    """All around, in order: at most so far."""
    found, reach = list[Side](), hull.reach()
    for start, end, number, is_first, is_second in outline.sides():
        rows = np.concatenate(hull.sides[number][0 if is_first else 1 : 2 if is_second else 1])
        off = _off_segments(hull, reach, rows, outline.points[start], outline.points[end])
        found.append(Side(start, end, number, is_first, is_second, off))
    return found


def _off_segments(hull: Hull, reach: FloatArray, rows: IndexArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(P,): how far the curves along some rows of a hull are off the segments between a and b, (P, 3) each. reach: that
    of the hull."""
    squares = _squares_off(hull.points[rows], a, b)
    nearly = squares[hull.is_near[rows]].max(axis=0, initial=0.0)
    return np.maximum(np.sqrt(squares.max(axis=0)), np.sqrt(nearly) + reach)


def _squares_off(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """(R, P): squared distances of points (R, P, D) from the segments between a and b, (P, D) each."""
    sides = b - a
    lengths = _products(sides, sides)
    off = points - a
    places = np.clip(_products(off, sides) / np.where(lengths > 0, lengths, 1.0), 0.0, 1.0)
    off -= places[..., None] * sides
    return _products(off, off)


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    """(…): dot products of vectors (…, D). Sums of strided columns are faster than a reduction over a short axis."""
    found = a[..., 0] * b[..., 0]
    for component in range(1, a.shape[-1]):
        found += a[..., component] * b[..., component]
    return np.asarray(found)


def overshoot(leaves: Leaves, points: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Seen along axes (P, 3): (R, P), how far points (R, P, 3) are from the convex outline of the triangles; and (P,)
    how deep this is dented, inf where it is not convex but for the middles of sides."""
    second = cross_products(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    second /= np.sqrt(squared_norms(second))[:, None]
    frame = np.stack([cross_products(second, axes), second])
    origin = leaves.corners[0]
    border, dents = _border(leaves, origin, frame)
    sides = np.roll(border, -1, axis=0) - border
    lengths = sides[:, 0] ** 2 + sides[:, 1] ** 2
    lengths[lengths == 0] = 1.0
    # Every vertex against the line of every side.
    off = border - border[:, None]
    outside = (sides[:, None, 1] * off[:, :, 0] - sides[:, None, 0] * off[:, :, 1]).max(axis=1)
    dents = np.maximum(dents, (4 * outside / np.sqrt(lengths)).max(axis=0))
    dents[~np.all(outside <= ROUNDING * lengths, axis=0)] = np.inf
    places = _seen(points, origin, frame)
    inside = np.ones(places.shape[1:], dtype=bool)
    for (x, y), (along_x, along_y) in zip(border, sides, strict=True):
        inside &= along_x * places[1] - along_y * places[0] >= along_x * y - along_y * x
    # Most hull points are inside.
    rows, own = np.nonzero(~inside)
    (seen_x, seen_y), squares = places[:, rows, own], np.full(len(rows), np.inf)
    for start, side, square in zip(border, sides, lengths, strict=True):
        (x, y), (along_x, along_y) = start[:, own], side[:, own]
        x, y = seen_x - x, seen_y - y
        part = np.clip((along_x * x + along_y * y) / square[own], 0.0, 1.0)
        np.minimum(squares, (x - part * along_x) ** 2 + (y - part * along_y) ** 2, out=squares)
    found = np.zeros(places.shape[1:])
    found[rows, own] = np.sqrt(squares)
    return found, dents


def _seen(points: FloatArray, origin: FloatArray, frame: FloatArray) -> FloatArray:
    """(2, …, P): points (…, P, 3) seen in frames (2, P, 3) at origins (P, 3)."""
    off = points - origin
    return np.stack([dot_products(off, frame[0]), dot_products(off, frame[1])])


def _border(leaves: Leaves, origin: FloatArray, frame: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The vertices around the leaves (``Leaves.vertices``), seen in frames, (V, 2, P), those that dent a side moved
    onto it; and (P,) the deepest dent."""
    corners = _seen(leaves.corners, origin, frame)
    if not np.any(leaves.is_split):
        return corners.swapaxes(0, 1), np.zeros(len(origin))
    ends, middles = np.roll(corners, -1, axis=1), _seen(leaves.middles, origin, frame)
    along, off = ends - corners, middles - corners
    is_dent = leaves.is_split & (along[0] * off[1] - along[1] * off[0] > 0)
    # All of the dent is within the longer of its sides' distances from its deepest point.
    squares = _squares_off(*(np.moveaxis(each, 0, -1) for each in (middles, corners, ends)))
    dents = np.where(is_dent, np.sqrt(squares), 0.0).max(axis=0)
    border = np.where(is_dent, (corners + ends) / 2, np.where(leaves.is_split, middles, corners))
    return np.stack([corners, border], axis=2).reshape(2, -1, len(origin)).swapaxes(0, 1), dents
