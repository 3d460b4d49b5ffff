# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the surface is from the triangles of a shell, in the shell: piece by piece, by convex hulls.

A piece is a part of the surface over a part of one triangle. Every point of it has a place in the shell, over the
triangle or one that shares a side with it, or near a corner over one that shares the corner; its distance along the
shell's vectors is at most the height over that triangle's plane by a cosine. docs/distance.md, Lemmas 5 to 8; letters
are those used there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.ranges import ranges as ranges_of
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import cross_products, dot_products, lengths, units
from .shells import Shell

# Points this near a corner's vector, as a part of the triangle's size, count as on it; a bound counts the part besides.
ON_VECTOR = 2.0**-36

# Of coordinates, relative: more than a point of a triangle is off by.
COORDINATE_ROUNDING = 2.0**-48

# A piece is placed in a shell as thick as this many times its largest height.
RANGE_FOR_HEIGHT = 1.5

# A piece no farther from a corner than this part of the range counts as that far from what is drawn.
NEAR_ENOUGH = 0.1

# Pairs of pieces and triangles looked at together.
PAIRS_AT_ONCE = 1 << 12

# Bounds are raised by this part, and conditions have this margin: nothing is off by as much for rounding.
ROUNDING = 2.0**-40


@dataclass(frozen=True)
class Pieces:
    """P pieces of the surface. triangles: (P,) intp, of a shell. hulls: (P, R, 3), points whose hull holds the piece;
    near: (P,), except for so much. flats: (P, R', 3), points of the triangle's plane whose hull holds what is drawn at
    equal parameters; R' is R where they are coefficients as well, of the same order."""

    triangles: IndexArray
    hulls: FloatArray
    near: FloatArray
    flats: FloatArray

    def at(self, chosen: IndexArray) -> Pieces:
        """Some of them."""
        return Pieces(self.triangles[chosen], self.hulls[chosen], self.near[chosen], self.flats[chosen])

    @staticmethod
    def joined(pieces: Sequence[Pieces]) -> Pieces:
        """Those of one form, one after the other."""
        return Pieces(*(np.concatenate([vars(each)[field.name] for each in pieces]) for field in fields(Pieces)))

    def divided(self, parts: tuple[FloatArray, ...]) -> Pieces:
        """All first parts, then all second ones and so on. parts: (R, R) each, from a piece's coefficients to those of
        a part of it."""
        hulls, flats = (np.concatenate([rows @ each for rows in parts]) for each in (self.hulls, self.flats))
        return Pieces(np.tile(self.triangles, len(parts)), hulls, np.tile(self.near, len(parts)), flats)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def shell_bounds(shell: Shell, pieces: Pieces, *, are_last: bool = True) -> FloatArray:
    """(P,): at least how far all points of each piece are from the points of the triangles at their places; infinite
    where no place within the shell is proved. are_last: whether they can't be divided, and it pays to look for all
    places around their triangles."""
    seen = _Seen.of(shell, pieces)
    heights = seen.heights_over(shell.triangles.normals[pieces.triangles], 0).max(axis=0) + pieces.near
    # A thin shell has the least margins, if it is thick enough.
    thin = RANGE_FOR_HEIGHT * heights / shell.cosines[pieces.triangles]
    bounds = _beside_triangle(shell, seen, np.minimum(thin, shell.ranges[pieces.triangles]), heights)
    rest = np.flatnonzero(np.isinf(bounds))
    if len(rest):
        some = pieces.at(rest)
        ranges = shell.ranges[some.triangles]
        bounds[rest] = _beside_triangle(shell, _Seen.of(shell, some), ranges, heights[rest])
    rest = np.flatnonzero(np.isinf(bounds))
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = np.minimum.reduce([_near_corner(shell, some, corner) for corner in range(3)])
        rest = rest[np.isinf(bounds[rest])]
    if are_last and len(rest):
        bounds[rest] = _around_triangle(shell, pieces.at(rest))
    bounds = np.where(shell.ranges[pieces.triangles] > 0, bounds, np.inf)
    return bounds * (1 + ROUNDING) + 2 * ON_VECTOR * seen.sizes


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def bridge_bounds(shell: Shell, pieces: Pieces, bounds: FloatArray, off_beyond: FloatArray) -> FloatArray:
    """(P,): the same bounds, raised for pieces at sides beyond which the surface is compared at equal parameters
    (docs/distance.md, Lemma 10). bounds: (P,), of ``shell_bounds``; off_beyond: (M, 3), how far it is off there at
    most, infinite at other sides."""
    found = bounds.copy()
    edges = EDGES[pieces.flats.shape[1]]
    own = pieces.triangles
    for side in range(3):
        chosen = np.flatnonzero(np.isfinite(off_beyond[own, side]) & np.isfinite(bounds))
        if not len(chosen):
            continue
        is_on = _are_on_side(shell, pieces.at(chosen), side, [start for start, _, _ in edges])
        for start, end, rows in edges:
            places = [first for first, _, _ in edges]
            some = chosen[is_on[places.index(start)] & is_on[places.index(end)]]
            if not len(some):
                continue
            hulls = pieces.hulls[some]
            curves = Pieces(
                own[some],
                hulls[:, rows] if hulls.shape[1] == pieces.flats.shape[1] else hulls,
                pieces.near[some],
                pieces.flats[some][:, rows],
            )
            off = off_beyond[own[some], side]
            found[some] = np.maximum(found[some], _bridged(shell, curves, side, bounds[some], off) * (1 + ROUNDING))
    return found


# The sides of squares, and of triangles, by how many points are drawn there: where their corners are among these, and
# which points are on them.
EDGES: dict[int, list[tuple[int, int, list[int]]]] = {
    4: [(0, 1, [0, 1]), (1, 2, [1, 2]), (2, 3, [2, 3]), (3, 0, [3, 0])],
    16: [(0, 12, [0, 4, 8, 12]), (12, 15, [12, 13, 14, 15]), (15, 3, [15, 11, 7, 3]), (3, 0, [3, 2, 1, 0])],
    28: [(0, 21, [0, 1, 3, 6, 10, 15, 21]), (21, 27, [21, 22, 23, 24, 25, 26, 27]), (27, 0, [27, 20, 14, 9, 5, 2, 0])],
}


def _bridged(shell: Shell, curves: Pieces, side: int, bounds: FloatArray, off_beyond: FloatArray) -> FloatArray:
    """(P,): at least how far the points of curves over a side are from all places on their ways, in a shell where these
    are within some bounds (P,)."""
    seen, triangles = _Seen.of(shell, curves), shell.triangles
    heights = seen.heights_over(triangles.normals[curves.triangles], 0).max(axis=0) + curves.near
    thin = RANGE_FOR_HEIGHT * heights / shell.cosines[curves.triangles]
    whole = shell.ranges[curves.triangles]
    ranges = np.where(bounds <= thin, np.minimum(thin, whole), whole)
    stays = seen.in_front()
    for other in range(3):
        crossing = _Crossing.of(shell, seen, other, ranges, heights)
        stays &= ~crossing.is_crossed | (crossing.is_placed if other == side else False)
    across = triangles.across[curves.triangles, side]
    there = seen.heights_over(triangles.normals[across], side).max(axis=0) + curves.near
    straight = np.maximum(there / shell.cosines[across], heights / shell.cosines[curves.triangles])
    return np.where(stays, straight, bounds + np.minimum(_off_at_equal(curves), off_beyond))


def _off_at_equal(pieces: Pieces) -> FloatArray:
    """(P,): how far pieces are from what is drawn at equal parameters, at most."""
    same = pieces.hulls.shape == pieces.flats.shape
    off = pieces.hulls - pieces.flats if same else pieces.hulls[:, :, None] - pieces.flats[:, None]
    found: FloatArray = lengths(off).reshape(len(pieces.near), -1).max(axis=1) + pieces.near
    return found


def _are_on_side(shell: Shell, pieces: Pieces, side: int, places: list[int]) -> BoolArray:
    """(n, P) whether points that are drawn, at these places, are on a side of their triangles."""
    corners = shell.triangles.corners[pieces.triangles]
    along = corners[:, (side + 1) % 3] - corners[:, side]
    points = pieces.flats[:, places].transpose(2, 1, 0)
    off = _beside(points - corners[:, side].T[:, None], units(along))
    # Far from the origin points on a side are off it by roundings of their coordinates; one too many does no harm.
    return off <= ON_VECTOR * lengths(along) + COORDINATE_ROUNDING * np.abs(corners).max(axis=(1, 2))


def _beside_triangle(shell: Shell, seen: _Seen, ranges: FloatArray, heights: FloatArray) -> FloatArray:
    """(P,): bounds for pieces whose points are over their triangle or those across its sides, in a shell of some
    ranges; infinite for others."""
    bounds = heights / _own_cosines(shell, seen, ranges)
    off_border = np.zeros_like(bounds)
    placed = seen.in_front()
    for side in range(3):
        crossing = _Crossing.of(shell, seen, side, ranges, heights)
        placed &= ~crossing.is_crossed | crossing.is_placed
        bounds = np.where(crossing.is_crossed, np.maximum(bounds, crossing.bounds), bounds)
        off_border = np.where(crossing.is_crossed, np.maximum(off_border, crossing.off_border), off_border)
    return np.where(placed & (bounds <= ranges), np.maximum(bounds, off_border), np.inf)


def _own_cosines(shell: Shell, seen: _Seen, ranges: FloatArray) -> FloatArray:
    """(P,): the least cosine between the triangle's normal and the vectors at the places of a piece over it."""
    own = seen.pieces.triangles
    normals = shell.triangles.normals[own]
    along, across = seen.sides[:, 0], -seen.sides[:, 2]
    at_corners = dot_products(normals[:, None], seen.vectors)
    # A place is off the foot on the plane by the part of s N across the normal, no more than the range.
    area = np.maximum(dot_products(normals, cross_products(along, across)), 1e-300)[:, None]
    slope = (at_corners[:, 1] - at_corners[:, 0])[:, None] * cross_products(across, normals) / area
    slope += (at_corners[:, 2] - at_corners[:, 0])[:, None] * cross_products(normals, along) / area
    least = at_corners[:, 0] + seen.along(slope, 0).min(axis=0) - (ranges + seen.pieces.near) * lengths(slope)
    return np.maximum(least * (1 - ROUNDING), shell.cosines[own])


@dataclass(frozen=True)
class _Seen:
    """Pieces seen from the corners of their triangles. corners, vectors: (P, 3, 3); sides: (P, 3, 3), from corner k to
    k + 1. hulls: (3, 3, R, P), from each corner on, coordinate by coordinate; beside: (3, R, P), how far points are
    from the line of its vector, or what is drawn there, if that is farther; is_on: (3, R, P) bool, whether they count
    as on it. sizes: (P,)."""

    pieces: Pieces
    corners: FloatArray
    vectors: FloatArray
    sides: FloatArray
    hulls: FloatArray
    beside: FloatArray
    is_on: BoolArray
    sizes: FloatArray

    @staticmethod
    def of(shell: Shell, pieces: Pieces) -> _Seen:
        corners = shell.triangles.corners[pieces.triangles]
        vectors = shell.triangles.vectors[pieces.triangles]
        sides = np.roll(corners, -1, axis=1) - corners
        sizes = lengths(sides).max(axis=1)
        points, drawn = (np.ascontiguousarray(each.transpose(2, 1, 0)) for each in (pieces.hulls, pieces.flats))
        hulls = points - corners.transpose(1, 2, 0)[:, :, None]
        beside = np.empty((3, *points.shape[1:]))
        for corner in range(3):
            vector = vectors[:, corner]
            own = _beside(hulls[corner], vector)
            there = _beside(drawn - corners[:, corner].T[:, None], vector)
            np.maximum(own, there if there.shape == own.shape else there.max(axis=0, keepdims=True), out=beside[corner])
        is_on = (beside <= ON_VECTOR * sizes) & (pieces.near == 0)
        return _Seen(pieces, corners, vectors, sides, hulls, beside, is_on, sizes)

    def heights_over(self, directions: FloatArray, corner: int) -> FloatArray:
        """(R, P): the sizes of the parts along directions (P, 3), seen from a corner."""
        return np.abs(self.along(directions, corner))

    def along(self, directions: FloatArray, corner: int) -> FloatArray:
        """(R, P): the parts of hull points along directions (P, 3), seen from a corner."""
        return _along(self.hulls[corner], directions)

    def in_front(self) -> BoolArray:
        """(P,) whether at every corner all points are in front of it, where the triangle is."""
        found = np.ones(len(self.sizes), dtype=bool)
        for corner in range(3):
            first, second = (
                units(_part_across(side, self.vectors[:, corner]))
                for side in (self.sides[:, corner], -self.sides[:, corner - 1])
            )
            along = self.along(units(first + second), corner) - self.pieces.near
            found &= np.all((along > 0) | self.is_on[corner], axis=0)
        return found


def _along(points: FloatArray, directions: FloatArray) -> FloatArray:
    """(R, P): the parts of points (3, R, P) along directions (P, 3)."""
    found = points[0] * directions[:, 0]
    found += points[1] * directions[:, 1]
    found += points[2] * directions[:, 2]
    return found


def _beside(points: FloatArray, vectors: FloatArray) -> FloatArray:
    """(R, P): how far points (3, R, P) are from lines through 0 along unit vectors (P, 3)."""
    along = _along(points, vectors)
    square = np.zeros_like(along)
    for axis in range(3):
        across = points[axis] - along * vectors[:, axis]
        across *= across
        square += across
    return np.sqrt(square, out=square)


def _part_across(points: FloatArray, vectors: FloatArray) -> FloatArray:
    """(P, 3): the same of one point each (P, 3)."""
    return points - dot_products(points, vectors)[:, None] * vectors


@dataclass(frozen=True)
class _Wall:
    """A wall seen from a corner (P, 3). inwards: (P, 3), the normal of the plane of side and vector, on the side that
    is asked for; lengths: (P,), of the side across the vector. margins: (P,), so much of the distance beside the vector
    is the product of a point of the wall with ``inwards`` at most; infinite where there is no such bound."""

    inwards: FloatArray
    lengths: FloatArray
    margins: FloatArray

    @staticmethod
    def of(along: FloatArray, vector: FloatArray, other: FloatArray, ranges: FloatArray, sign: int) -> _Wall:
        """along: (P, 3), the side from the corner on; vector, other: (P, 3), there and at its end."""
        inwards = sign * cross_products(vector, along)
        length = lengths(_part_across(along, vector))
        least = length - ranges * lengths(other - vector)
        off = ranges * np.abs(dot_products(inwards, other))
        margins = np.where(least > 0, off / np.maximum(least, 1e-300) + ROUNDING * length, np.inf)
        return _Wall(inwards, length, margins)

    def is_passed(self, seen: _Seen, corner: int) -> BoolArray:
        """(R, P) bool: points that are on the inner side, and not in the wall."""
        near = seen.pieces.near
        inside = seen.along(self.inwards, corner) - near * self.lengths
        return inside > self.margins * (seen.beside[corner] + near)


@dataclass(frozen=True)
class _Crossing:
    """What pieces do at one side. is_crossed: (P,) bool, whether some of a piece may be beyond its wall; is_placed:
    (P,) bool, whether what is beyond is over the triangle there; bounds: (P,), of |s| for what is beyond; off_border:
    (P,), how far that is from the side where it is closed, and 0 elsewhere."""

    is_crossed: BoolArray
    is_placed: BoolArray
    bounds: FloatArray
    off_border: FloatArray

    @staticmethod
    def of(shell: Shell, seen: _Seen, side: int, ranges: FloatArray, heights: FloatArray) -> _Crossing:
        triangles, own = shell.triangles, seen.pieces.triangles
        across = triangles.across[own, side]
        apex_at = (across, triangles.apexes[own, side])
        apex, apex_vector = triangles.corners[apex_at], triangles.vectors[apex_at]
        ends = (side, (side + 1) % 3)
        is_crossed, is_placed = np.ones((2, len(own)), dtype=bool)
        for corner, other, sign in ((*ends, 1), (*ends[::-1], -1)):
            vector, along = seen.vectors[:, corner], sign * seen.sides[:, side]
            to_apex = apex - seen.corners[:, corner]
            wall = _Wall.of(along, vector, seen.vectors[:, other], ranges, sign)
            outer = _Wall.of(to_apex, vector, apex_vector, ranges, sign)
            inside = wall.is_passed(seen, corner) | seen.is_on[corner]
            is_crossed &= ~np.all(inside, axis=0)
            is_placed &= np.all(inside | outer.is_passed(seen, corner), axis=0)
            is_placed &= _is_open(wall, outer, to_apex, ranges * lengths(apex_vector - vector))
        return _Crossing(is_crossed, is_placed, *_bounds_beyond(shell, seen, side, ranges, heights))


def _is_open(wall: _Wall, outer: _Wall, to_apex: FloatArray, moved: FloatArray) -> BoolArray:
    """(P,) whether the angle from a wall to the next one is larger than what margins take, and the prism between them
    is beyond the first."""
    down = -dot_products(wall.inwards, to_apex)
    sines = down / np.maximum(wall.lengths * outer.lengths, 1e-300)
    margins = wall.margins / np.maximum(wall.lengths, 1e-300) + outer.margins / np.maximum(outer.lengths, 1e-300)
    return (sines > 2 * margins) & (down > moved * wall.lengths)


def _bounds_beyond(
    shell: Shell, seen: _Seen, side: int, ranges: FloatArray, heights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """bounds and off_border of ``_Crossing``, for the parts of pieces beyond the wall over a side."""
    triangles, own, near = shell.triangles, seen.pieces.triangles, seen.pieces.near
    following = (side + 1) % 3
    along = units(seen.sides[:, side])
    first, second = seen.vectors[:, side], seen.vectors[:, following]
    inwards = units(cross_products(first + second, along))
    upwards = cross_products(along, inwards)
    # The wall is that near the plane of the side and the mean of its vectors.
    thick = ranges * np.maximum(*(np.abs(dot_products(inwards, vector)) for vector in (first, second)))
    beyond = seen.along(inwards, side) - near <= thick * (1 + ROUNDING)
    across = triangles.across[own, side]
    normals = triangles.normals[across]
    reached = np.where(beyond, seen.heights_over(normals, side), 0.0).max(axis=0) + near
    # In the plane of the side both heights are parts of one length.
    own_cosine, own_sine, cosine, sine = (
        dot_products(normal, axis) for normal in (triangles.normals[own], normals) for axis in (upwards, inwards)
    )
    share = cosine / own_cosine
    at_wall = np.abs(share) * heights + np.abs(sine - share * own_sine) * thick
    bounds = np.maximum(reached, at_wall) / shell.cosines[across]
    bounds = np.where(own_cosine > 0, bounds, np.inf)
    beside = np.where(beyond, _beside(seen.hulls[side], along), 0.0).max(axis=0) + near
    off = np.maximum(beside, (heights + 2 * thick) / np.maximum(own_cosine, 1e-300))
    off = np.hypot(off, _slid(along, first, second, ranges))
    return bounds, np.where(triangles.is_closed[own, side], off, 0.0)


def _slid(along: FloatArray, first: FloatArray, second: FloatArray, ranges: FloatArray) -> FloatArray:
    """(P,): how far a point of a wall is from its own along the side, seen across it, at most."""
    return ranges * np.maximum(*(np.abs(dot_products(along, vector)) for vector in (first, second)))


def _near_corner(shell: Shell, pieces: Pieces, corner: int) -> FloatArray:
    """(P,): bounds for pieces so near a corner that they are over the triangles there, whichever of these; infinite for
    others."""
    triangles, own = shell.triangles, pieces.triangles
    vertices = triangles.vertices[own, corner]
    seen = np.concatenate([pieces.hulls, pieces.flats], axis=1) - triangles.corners[own, corner][:, None]
    distances = lengths(seen).max(axis=1) + pieces.near
    bounds = np.full(len(own), np.inf)
    near = np.flatnonzero((distances < shell.radii[vertices]) & (shell.ranges[own] > 0))
    if not len(near):
        return bounds
    starts, counts = shell.star_starts[vertices[near]], np.diff(shell.star_starts)[vertices[near]]
    # What is near enough to the corner itself need not be compared with each triangle there.
    found = distances[near] / shell.least_cosines[vertices[near]]
    found = np.where(found <= NEAR_ENOUGH * shell.ranges[own[near]], found, 0.0)
    left = found == 0
    for place in range(int(counts[left].max(initial=0))):
        some = np.flatnonzero(left & (place < counts) & (found <= shell.ranges[own[near]]))
        there = shell.star_triangles[starts[some] + place]
        heights = np.abs(np.matmul(seen[near[some]], triangles.normals[there][:, :, None])[..., 0]).max(axis=1)
        found[some] = np.maximum(found[some], (heights + pieces.near[near[some]]) / shell.cosines[there])
    stays = (found <= shell.ranges[own[near]]) & (distances[near] + found < shell.radii[vertices[near]])
    found[~stays] = np.inf
    at_border = shell.is_border[vertices[near]]
    bounds[near] = np.where(at_border, distances[near] + 2 * found, found)
    return bounds


def _around_triangle(shell: Shell, pieces: Pieces) -> FloatArray:
    """(P,): bounds for pieces that are over triangles that share a corner with theirs, whichever of these they may
    meet; infinite for others."""
    own, vertices = pieces.triangles, shell.triangles.vertices[pieces.triangles]
    points = np.concatenate([pieces.hulls, pieces.flats], axis=1)
    at_border = np.any(shell.is_border[vertices], axis=1)
    found = np.where((shell.ranges[own] > 0) & ~at_border, 0.0, np.inf)
    possible = np.flatnonzero(np.isfinite(found))
    at = vertices[possible].ravel()
    counts = np.diff(shell.star_starts)[at]
    all_around, owners = ranges_of(shell.star_starts[at], counts), np.repeat(np.repeat(possible, 3), counts)
    for some in index_chunks(np.arange(len(owners)), PAIRS_AT_ONCE):
        there, pair = shell.star_triangles[all_around[some]], owners[some]
        near, ranges = pieces.near[pair], shell.ranges[own[pair]]
        meets, stays = _meetings(shell, points[pair], near, there, vertices[pair], ranges)
        seen = points[pair] - shell.triangles.corners[there, 0][:, None]
        heights = np.abs(np.matmul(seen, shell.triangles.normals[there][:, :, None])[..., 0]).max(axis=1)
        bound = (heights + near) / shell.cosines[there]
        bound = np.where(stays & (bound <= ranges), bound, np.inf)
        np.maximum.at(found, pair[meets], bound[meets])
    return found


def _meetings(
    shell: Shell,
    points: FloatArray,
    near: FloatArray,
    triangles: IndexArray,
    vertices: IndexArray,
    ranges: FloatArray,
) -> tuple[BoolArray, BoolArray]:
    """(n,) bool twice: whether hulls of points (n, R, 3) may meet the prisms of triangles (n,); and whether they are on
    the inner side of the walls there that do not touch any of the given vertices (n, 3)."""
    meets, stays = np.ones((2, len(triangles)), dtype=bool)
    corners, vectors = shell.triangles.corners[triangles], shell.triangles.vectors[triangles]
    numbers = shell.triangles.vertices[triangles]
    is_around = (numbers[:, :, None] == vertices[:, None]).any(axis=2)
    for side in range(3):
        following = (side + 1) % 3
        along = units(corners[:, following] - corners[:, side])
        first, second = vectors[:, side], vectors[:, following]
        inwards = units(cross_products(first + second, along))
        thick = ranges * np.maximum(*(np.abs(dot_products(inwards, vector)) for vector in (first, second)))
        seen = np.matmul(points - corners[:, None, side], inwards[:, :, None])[..., 0]
        margin = thick * (1 + ROUNDING) + near
        meets &= np.any(seen >= -margin[:, None], axis=1)
        is_outer = ~is_around[:, side] & ~is_around[:, following]
        stays &= ~is_outer | np.all(seen > margin[:, None], axis=1)
    return meets, stays


@dataclass(frozen=True)
class Curves:
    """P parts of the surface's curves over closed sides. triangles, sides: (P,) intp. hulls, near: as of ``Pieces``.
    flats: (P, R', 3), likewise, along the side."""

    triangles: IndexArray
    sides: IndexArray
    hulls: FloatArray
    near: FloatArray
    flats: FloatArray


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def curve_bounds(shell: Shell, curves: Curves) -> FloatArray:
    """(P,): at least how far the points of curves are from points of their sides that follow them."""
    own, side, rows = curves.triangles, curves.sides, np.arange(len(curves.sides))
    pieces = Pieces(own, curves.hulls, curves.near, curves.flats)
    seen = _Seen.of(shell, pieces)
    ranges = shell.ranges[own]
    following, apex = (side + 1) % 3, (side + 2) % 3
    start, end = seen.corners[rows, side], seen.corners[rows, following]
    along = end - start
    from_start = curves.hulls - start[:, None]
    part = np.matmul(from_start, along[:, :, None])[..., 0] / np.maximum(dot_products(along, along), 1e-300)[:, None]
    off = lengths(from_start - np.clip(part, 0.0, 1.0)[..., None] * along[:, None]).max(axis=1) + curves.near
    first, second = seen.vectors[rows, side], seen.vectors[rows, following]
    bounds = np.hypot(off, _slid(units(along), first, second, ranges)) * (1 + ROUNDING)
    placed = np.zeros(len(own), dtype=bool)
    for corner in range(3):
        # The walls of the other two sides, as seen from the ends of this one.
        chosen = side == corner
        walls = (
            _Wall.of(-seen.sides[:, corner - 1], seen.vectors[:, corner], seen.vectors[rows, apex], ranges, -1),
            _Wall.of(
                seen.sides[:, (corner + 1) % 3],
                seen.vectors[:, (corner + 1) % 3],
                seen.vectors[rows, apex],
                ranges,
                1,
            ),
        )
        inside = [
            np.all(wall.is_passed(seen, at) | seen.is_on[at], axis=0)
            for wall, at in zip(walls, (corner, (corner + 1) % 3), strict=True)
        ]
        placed |= chosen & inside[0] & inside[1]
    bounds = np.where(placed, bounds, np.inf)
    for corner in range(3):
        at_border = shell.is_border[shell.triangles.vertices[own, corner]]
        bounds = np.minimum(bounds, np.where(at_border, _near_corner(shell, pieces, corner), np.inf))
    return bounds + 2 * ON_VECTOR * seen.sizes
