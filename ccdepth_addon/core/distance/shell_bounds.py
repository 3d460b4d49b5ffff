# SPDX-License-Identifier: GPL-3.0-or-later
"""How far the surface is from the triangles of a shell, in the shell: piece by piece, by convex hulls.

A piece is a part of the surface over a part of one triangle. Every point of it has a place in the shell, over the
triangle or one that shares a side with it, or near a corner over one that shares the corner; its distance along the
shell's vectors is at most the height over that triangle's plane by a cosine. docs/distance.md, Lemmas 5 to 8; letters
are those used there.

Hulls and what is drawn are component-major (``vectors``): one number of all pieces after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.matrix_products import matrix_product
from ..arrays.ranges import ranges as ranges_of
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import (
    component_major,
    cross_products,
    dot_products,
    joined_vectors,
    lengths,
    selected_vectors,
    squared_norms,
    transformed_nets,
    units,
)
from ..surface.bicubic import HALVES
from ..surface.triangle_coefficients import triangle_quarters
from .shells import Shell

# Points this near a corner's vector, as a part of the triangle's size, count as on it; a bound counts the part besides.
ON_VECTOR = 2.0**-36

# Of coordinates, relative: more than a point of a triangle is off by.
COORDINATE_ROUNDING = 2.0**-48

# A piece is placed in a shell as thick as this many times its largest height.
RANGE_FOR_HEIGHT = 1.5

# Near a corner heights over all planes there are bounded together up to this part of the range.
NEAR_ENOUGH = 0.1

# More triangles than this at a vertex are never looked at one by one.
MANY_AROUND = 64

# Pairs of pieces and triangles looked at together.
PAIRS_AT_ONCE = 1 << 10

# Bounds are raised by this part, and conditions have this margin: nothing is off by as much for rounding.
ROUNDING = 2.0**-40

# The sides of squares, and of triangles, by how many points are drawn there: where their corners are among these, and
# which points are on them. Of four points the hull is another.
SIDES: dict[int, list[tuple[int, int, list[int]]]] = {
    3: [(0, 1, [0, 1]), (1, 2, [1, 2]), (2, 0, [2, 0])],
    4: [(0, 1, [0, 1]), (1, 2, [1, 2]), (2, 3, [2, 3]), (3, 0, [3, 0])],
    16: [(0, 12, [0, 4, 8, 12]), (12, 15, [12, 13, 14, 15]), (15, 3, [15, 11, 7, 3]), (3, 0, [3, 2, 1, 0])],
    28: [(0, 21, [0, 1, 3, 6, 10, 15, 21]), (21, 27, [21, 22, 23, 24, 25, 26, 27]), (27, 0, [27, 20, 14, 9, 5, 2, 0])],
}

# By how many coefficients a piece has, those of its quarters.
FINER = {
    16: np.unique(np.concatenate([np.kron(one, other) for one in HALVES for other in HALVES]), axis=0),
    28: np.unique(np.concatenate(triangle_quarters()), axis=0),
}


@dataclass(frozen=True)
class Pieces:
    """P pieces of the surface. triangles: (P,) intp, of a shell. hulls: (R, P, 3), points whose hull holds the piece.
    flats: (R', P, 3), points of the triangle's plane whose hull holds what is drawn at equal parameters; R' is R where
    they are coefficients as well, of the same order."""

    triangles: IndexArray
    hulls: FloatArray
    flats: FloatArray

    def at(self, chosen: IndexArray) -> Pieces:
        """Some of them."""
        hulls, flats = (selected_vectors(each, chosen) for each in (self.hulls, self.flats))
        return Pieces(self.triangles[chosen], hulls, flats)

    @staticmethod
    def joined(pieces: Sequence[Pieces]) -> Pieces:
        """Those of one form, one after the other."""
        hulls, flats = (joined_vectors([getattr(each, name) for each in pieces]) for name in ("hulls", "flats"))
        return Pieces(np.concatenate([each.triangles for each in pieces]), hulls, flats)

    def divided(self, parts: Sequence[FloatArray]) -> Pieces:
        """All first parts, then all second ones and so on. parts: (R, R) each, from a piece's coefficients to those of
        a part of it."""
        return Pieces.joined(
            [
                Pieces(self.triangles, *(transformed_nets(rows, each) for each in (self.hulls, self.flats)))
                for rows in parts
            ]
        )


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def shell_bounds(
    shell: Shell, pieces: Pieces, off_beyond: FloatArray | None = None, *, are_last: bool = True
) -> FloatArray:
    """(P,): at least how far all points of each piece are from the points of the triangles at their places, and those
    of its curves over closed sides from points of these sides; infinite where no place within the shell is proved.

    off_beyond: (M, 3), how far the surface is at most from what is drawn beyond sides where it is compared at equal
    parameters, infinite at other sides; ways to what is compared there count as well (docs/distance.md, Lemma 10).
    are_last: whether pieces can't be divided, and it pays to look for all places around their triangles.
    """
    own = pieces.triangles
    seen = _Seen.of(shell, pieces)
    # A thin shell has the least margins, if it is thick enough.
    thin = np.minimum(RANGE_FOR_HEIGHT * seen.heights / shell.cosines[own], shell.ranges[own])
    bounds = _beside_triangle(shell, seen, thin)
    rest = np.flatnonzero(np.isinf(bounds))
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = _beside_triangle(shell, _Seen.of(shell, some), shell.ranges[some.triangles])
        rest = rest[np.isinf(bounds[rest])]
    if len(rest):
        some = pieces.at(rest)
        bounds[rest] = np.minimum.reduce([_near_corner(shell, some, corner) for corner in range(3)])
        rest = rest[np.isinf(bounds[rest])]
    if are_last and len(rest):
        bounds[rest] = _around_triangle(shell, pieces.at(rest))
    bounds = np.where(shell.ranges[own] > 0, bounds, np.inf)
    bounds = raised_at_sides(shell, pieces, bounds, off_beyond)
    return bounds * (1 + ROUNDING) + 2 * ON_VECTOR * seen.sizes


@dataclass(frozen=True)
class _Seen:
    """Pieces in the frames of their triangles. own: (P,), the triangles; turns: (P,), which corner of each counts as
    corner 0, and which side, from there on, as side 0.

    corners, vectors: (3, P, 3), T and N; sides: (3, P, 3), from corner k to k + 1; points: (R, P, 3), of the hulls,
    from corner 0 on. radii: (3, P), how far any of what is drawn and of the hull is from each corner, at most.
    on_vectors: rows of the hull that may be at corners, and for each corner whether they are on its vector, (3, n, P).
    sizes: (P,), of the triangles. heights: (P,), the largest over the triangle's plane.
    """

    own: IndexArray
    turns: IndexArray
    corners: FloatArray
    vectors: FloatArray
    sides: FloatArray
    points: FloatArray
    radii: FloatArray
    on_vectors: tuple[list[int], BoolArray]
    sizes: FloatArray
    heights: FloatArray

    @staticmethod
    def of(shell: Shell, pieces: Pieces, turns: IndexArray | None = None, rows: list[int] | None = None) -> _Seen:
        """rows: of the hull's points that may be at corners, those over what is drawn there by default."""
        own = pieces.triangles
        turns = np.zeros_like(own) if turns is None else turns
        corners, vectors = (
            component_major(np.stack([each[own, (turns + k) % 3] for k in range(3)]))
            for each in (shell.triangles.corners, shell.triangles.vectors)
        )
        sides = np.stack([corners[(k + 1) % 3] - corners[k] for k in range(3)])
        sizes = lengths(sides).max(axis=0)
        points_of = [each.swapaxes(1, 2) for each in (pieces.hulls, pieces.flats)]
        low = np.minimum(*(each.min(axis=0) for each in points_of)).T
        high = np.maximum(*(each.max(axis=0) for each in points_of)).T
        radii = (lengths((low + high) / 2 - corners) + lengths(high - low) / 2) * (1 + ROUNDING)
        if rows is None:
            rows = [start for start, _, _ in SIDES[len(pieces.flats)]] if _are_alike(pieces) else []
        is_on = np.ones((3, len(rows), len(own)), dtype=bool)
        for k in range(3):
            for each in (pieces.hulls, pieces.flats):
                away = each[rows] - corners[k]
                along = dot_products(away, vectors[k])
                is_on[k] &= lengths(away - along[..., None] * vectors[k]) <= ON_VECTOR * sizes
        points = pieces.hulls - corners[0]
        over_plane = dot_products(points, component_major(shell.triangles.normals[own]))
        heights = np.abs(over_plane).max(axis=0)
        if _are_alike(pieces) and len(over_plane) in FINER:
            # The surface itself is lower than its coefficients: those over quarters are nearer to it.
            high = np.flatnonzero(heights > shell.ranges[own] * shell.cosines[own])
            finer = matrix_product(FINER[len(over_plane)], over_plane[:, high])
            heights[high] = np.abs(finer).max(axis=0, initial=0.0) * (1 + ROUNDING)
        return _Seen(own, turns, corners, vectors, sides, points, radii, (rows, is_on), sizes, heights)

    def at(self, chosen: IndexArray) -> _Seen:
        """Some of them, by index."""
        rows, is_on = self.on_vectors
        corners, vectors, sides, points = (
            selected_vectors(each, chosen) for each in (self.corners, self.vectors, self.sides, self.points)
        )
        return _Seen(
            self.own[chosen],
            self.turns[chosen],
            corners,
            vectors,
            sides,
            points,
            self.radii[:, chosen],
            (rows, is_on[..., chosen]),
            self.sizes[chosen],
            self.heights[chosen],
        )

    def along(self, directions: FloatArray, corner: int) -> FloatArray:
        """(R, P): the parts of hull points, from a corner on, along directions (P, 3)."""
        found = dot_products(self.points, directions)
        if corner:
            found -= dot_products(self.corners[corner] - self.corners[0], directions)
        return found

    def include_on_vector(self, found: BoolArray, corner: int) -> None:
        """Make found (R, P) true of points on the vector of a corner."""
        rows, is_on = self.on_vectors
        found[rows] |= is_on[corner]


def _are_alike(pieces: Pieces) -> bool:
    """Whether what is drawn are coefficients of the same order as the hulls."""
    return len(pieces.hulls) == len(pieces.flats)


@dataclass(frozen=True)
class _Wall:
    """A wall seen from a corner. inwards: (P, 3), the unit normal of the plane of side and vector, on the side that is
    asked for. lengths: (P,), of the side's part across the vector. margins: (P,), so much of the distance beside the
    vector is the product of a point of the wall with ``inwards`` at most; infinite where there is no such bound."""

    inwards: FloatArray
    lengths: FloatArray
    margins: FloatArray

    @staticmethod
    def of(along: FloatArray, vector: FloatArray, other: FloatArray, ranges: FloatArray, sign: int) -> _Wall:
        """along: (P, 3), the side from the corner on; vector, other: (P, 3), there and at its end."""
        length = lengths(along - dot_products(along, vector)[:, None] * vector)
        inwards = cross_products(vector, along) * (sign / np.maximum(length, 1e-300))[:, None]
        least = length - ranges * lengths(other - vector)
        off = ranges * np.abs(dot_products(inwards, other))
        return _Wall(inwards, length, np.where(least > 0, off / np.maximum(least, 1e-300) + ROUNDING, np.inf))


@dataclass(frozen=True)
class _Side:
    """A side as pieces see it from its ends, where its walls are. heights: for both ends (R, P), of hull points over
    the planes of the walls; are_inside: (R, P) bool, whether points are on the inner side of the wall, or on its
    vector."""

    walls: tuple[_Wall, _Wall]
    heights: tuple[FloatArray, FloatArray]
    are_inside: tuple[BoolArray, BoolArray]

    @staticmethod
    def of(seen: _Seen, side: int, ranges: FloatArray) -> _Side:
        walls, heights, are_inside = [], [], []
        for corner, other, sign in ((side, (side + 1) % 3, 1), ((side + 1) % 3, side, -1)):
            along = sign * seen.sides[side]
            walls.append(_Wall.of(along, seen.vectors[corner], seen.vectors[other], ranges, sign))
            heights.append(seen.along(walls[-1].inwards, corner))
            are_inside.append(heights[-1] > walls[-1].margins * seen.radii[corner] + ROUNDING * seen.sizes)
            seen.include_on_vector(are_inside[-1], corner)
        return _Side((walls[0], walls[1]), (heights[0], heights[1]), (are_inside[0], are_inside[1]))

    def stays_inside(self) -> BoolArray:
        """(P,) whether no point of a piece is beyond."""
        first, second = self.are_inside
        found: BoolArray = first.all(axis=0) | second.all(axis=0)
        return found

    def at(self, chosen: IndexArray) -> _Side:
        """For some pieces, by index."""
        first, second = (_Wall(each.inwards[chosen], each.lengths[chosen], each.margins[chosen]) for each in self.walls)
        heights, are_inside = self.heights, self.are_inside
        return _Side(
            (first, second),
            (heights[0][:, chosen], heights[1][:, chosen]),
            (are_inside[0][:, chosen], are_inside[1][:, chosen]),
        )


def _are_in_front(seen: _Seen, sides: Sequence[_Side]) -> BoolArray:
    """(P,) whether at every corner all points are in front of it, where the triangle is: the unit normals of both walls
    there add up to a vector between the sides."""
    found = np.ones(len(seen.own), dtype=bool)
    for corner in range(3):
        in_front = sides[corner].heights[0] + sides[corner - 1].heights[1] > ROUNDING * seen.sizes
        seen.include_on_vector(in_front, corner)
        found &= in_front.all(axis=0)
    return found


def _beside_triangle(shell: Shell, seen: _Seen, ranges: FloatArray) -> FloatArray:
    """(P,): bounds for pieces whose points are over their triangle or those across its sides, in a shell of some
    ranges; infinite for others."""
    bounds = seen.heights / _own_cosines(shell, seen, ranges)
    sides = [_Side.of(seen, side, ranges) for side in range(3)]
    placed = _are_in_front(seen, sides)
    for number, side in enumerate(sides):
        crossed = np.flatnonzero(placed & ~side.stays_inside())
        if len(crossed):
            beyond = _Beyond.of(shell, seen.at(crossed), number, side.at(crossed), ranges[crossed])
            placed[crossed] = beyond.are_placed
            bounds[crossed] = np.maximum(bounds[crossed], beyond.bounds())
    return np.where(placed & (bounds <= ranges), bounds, np.inf)


def _own_cosines(shell: Shell, seen: _Seen, ranges: FloatArray) -> FloatArray:
    """(P,): the least cosine between the triangle's normal and the vectors at the places of a piece over it."""
    normals = component_major(shell.triangles.normals[seen.own])
    along, across = seen.sides[0], -seen.sides[2]
    first, second, third = (dot_products(normals, vector) for vector in seen.vectors)
    # A place is off the foot on the plane by the part of s N across the normal, no more than the range.
    area = np.maximum(dot_products(normals, cross_products(along, across)), 1e-300)
    slope = ((second - first) / area)[:, None] * cross_products(across, normals)
    slope += ((third - first) / area)[:, None] * cross_products(normals, along)
    least = first + seen.along(slope, 0).min(axis=0) - ranges * lengths(slope)
    found: FloatArray = np.maximum(least * (1 - ROUNDING), shell.cosines[seen.own])
    return found


@dataclass(frozen=True)
class _Beyond:
    """What pieces do beyond a side. number: of the side; across: (P,), the triangle there. are_placed: (P,) bool,
    whether points beyond are over that triangle; heights: (R, P), of all points over its plane."""

    shell: Shell
    seen: _Seen
    number: int
    ranges: FloatArray
    across: IndexArray
    are_placed: BoolArray
    heights: FloatArray

    @staticmethod
    def of(shell: Shell, seen: _Seen, number: int, side: _Side, ranges: FloatArray) -> _Beyond:
        triangles, at = shell.triangles, (seen.own, (seen.turns + number) % 3)
        across = triangles.across[at]
        apex, apex_vector = (
            component_major(each[across, triangles.apexes[at]]) for each in (triangles.corners, triangles.vectors)
        )
        placed = np.ones(len(across), dtype=bool)
        for end, (corner, sign) in enumerate(((number, 1), ((number + 1) % 3, -1))):
            vector, to_apex = seen.vectors[corner], apex - seen.corners[corner]
            outer = _Wall.of(to_apex, vector, apex_vector, ranges, sign)
            passed = seen.along(outer.inwards, corner) > outer.margins * seen.radii[corner] + ROUNDING * seen.sizes
            placed &= np.all(side.are_inside[end] | passed, axis=0)
            placed &= _is_open(side.walls[end], outer, to_apex, ranges * lengths(apex_vector - vector))
        heights = np.abs(seen.along(component_major(triangles.normals[across]), number))
        return _Beyond(shell, seen, number, ranges, across, placed, heights)

    def bounds(self) -> FloatArray:
        """(P,): of |s| for what is beyond the wall; and where the side is closed also how far that is from the side."""
        triangles, seen, ranges = self.shell.triangles, self.seen, self.ranges
        along = units(seen.sides[self.number])
        first, second = (seen.vectors[k % 3] for k in (self.number, self.number + 1))
        inwards = units(cross_products(first + second, along))
        upwards = cross_products(along, inwards)
        # The wall is that near the plane of the side and the mean of its vectors.
        thick = ranges * np.maximum(*(np.abs(dot_products(inwards, vector)) for vector in (first, second)))
        are_beyond = seen.along(inwards, self.number) <= thick * (1 + ROUNDING) + ROUNDING * seen.sizes
        reached = np.where(are_beyond, self.heights, 0.0).max(axis=0)
        # In the plane of the side both heights are parts of one length.
        own_cosine, own_sine, cosine, sine = (
            dot_products(triangles.normals[each], axis)
            for each in (seen.own, self.across)
            for axis in (upwards, inwards)
        )
        share = cosine / own_cosine
        at_wall = np.abs(share) * seen.heights + np.abs(sine - share * own_sine) * thick
        bounds = np.maximum(reached, at_wall) / self.shell.cosines[self.across]
        bounds = np.where(own_cosine > 0, bounds, np.inf)
        closed = np.flatnonzero(triangles.is_closed[seen.own, (seen.turns + self.number) % 3])
        if len(closed):
            some = seen.at(closed)
            off = np.where(are_beyond[:, closed], _beside_side(some, self.number), 0.0).max(axis=0)
            lifted = (some.heights + 2 * thick[closed]) / np.maximum(own_cosine[closed], 1e-300)
            off = np.hypot(np.maximum(off, lifted), _slid(some, self.number, ranges[closed]))
            bounds[closed] = np.maximum(bounds[closed], off)
        return bounds


def _is_open(wall: _Wall, outer: _Wall, to_apex: FloatArray, moved: FloatArray) -> BoolArray:
    """(P,) whether the angle from a wall to the next one is larger than what margins take, and the prism between them
    is beyond the first."""
    down = -dot_products(wall.inwards, to_apex)
    return (down > 2 * (wall.margins + outer.margins) * outer.lengths) & (down > moved)


def _beside_side(seen: _Seen, side: int) -> FloatArray:
    """(R, P): how far hull points are from the line of a side."""
    points = seen.points - (seen.corners[side] - seen.corners[0])
    along = units(seen.sides[side])
    return lengths(points - dot_products(points, along)[..., None] * along)


def _slid(seen: _Seen, side: int, ranges: FloatArray) -> FloatArray:
    """(P,): how far a point of a wall is from its own along the side, seen across it, at most."""
    along = units(seen.sides[side])
    first, second = (np.abs(dot_products(along, seen.vectors[k % 3])) for k in (side, side + 1))
    return ranges * np.maximum(first, second)


def _near_corner(shell: Shell, pieces: Pieces, corner: int, *, at_side: bool = False) -> FloatArray:
    """(P,): bounds for pieces so near a corner that they are over the triangles there, whichever of these; infinite for
    others. at_side: whether they are followed by points of closed sides, as where they may be over flaps."""
    triangles, own = shell.triangles, pieces.triangles
    vertices = triangles.vertices[own, corner]
    at = component_major(triangles.corners[own, corner])
    distances = np.maximum(*(lengths(each - at).max(axis=0) for each in (pieces.hulls, pieces.flats)))
    bounds = np.full(len(own), np.inf)
    near = np.flatnonzero((distances < shell.radii[vertices]) & (shell.ranges[own] > 0))
    if not len(near):
        return bounds
    some, vertices, distances = pieces.at(near), vertices[near], distances[near]
    seen = _all_points(some) - at[near]
    starts, counts, ranges = shell.star_starts[vertices], np.diff(shell.star_starts)[vertices], shell.ranges[own[near]]
    # Each normal is the mean one and a vector no longer than the spread.
    together = np.abs(dot_products(seen, shell.mean_normals[vertices])).max(axis=0)
    together += shell.spreads[vertices] * distances
    found = np.minimum(together, distances) / shell.least_cosines[vertices]
    left = (found > NEAR_ENOUGH * ranges) & (counts <= MANY_AROUND)
    found[left] = 0.0
    for place in range(int(counts[left].max(initial=0))):
        chosen = np.flatnonzero(left & (place < counts) & (found <= ranges))
        there = shell.star_triangles[starts[chosen] + place]
        heights = np.abs(dot_products(selected_vectors(seen, chosen), triangles.normals[there])).max(axis=0)
        found[chosen] = np.maximum(found[chosen], heights / shell.cosines[there])
    stays = (found <= ranges) & (distances + found < shell.radii[vertices])
    at_border = at_side | _may_meet_flaps(shell, seen, vertices, ranges, distances)
    found = np.where(at_border, distances + 2 * found, found)
    bounds[near] = np.where(stays, found, np.inf)
    return bounds


def _may_meet_flaps(
    shell: Shell, seen: FloatArray, vertices: IndexArray, ranges: FloatArray, distances: FloatArray
) -> BoolArray:
    """(P,): whether hulls of points (R, P, 3), seen from some vertices, may meet prisms of flaps there. distances:
    (P,), of the farthest points."""
    meets, ends = shell.is_border[vertices], shell.star_starts[vertices + 1]
    chosen = np.flatnonzero(meets)
    meets[chosen], place = False, 1
    while len(chosen):
        # Flaps come last. Their first side is the closed one, and their prisms are within the wall's thickness of it.
        flaps = shell.star_triangles[ends[chosen] - place]
        is_flap = flaps >= len(shell.triangles.vertices)
        chosen, flaps, place = chosen[is_flap], flaps[is_flap], place + 1
        inwards, thick = _wall_plane(shell, flaps, 0, ranges[chosen])
        reached = dot_products(selected_vectors(seen, chosen), inwards).max(axis=0, initial=-np.inf)
        meets[chosen] |= reached >= -(thick + ROUNDING * distances[chosen])
        chosen = chosen[(ends[chosen] - place >= shell.star_starts[vertices[chosen]]) & ~meets[chosen]]
    found: BoolArray = meets
    return found


def _wall_plane(shell: Shell, triangles: IndexArray, side: int, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3), (n,): unit normals of planes through sides of triangles, inwards, and how far the walls are from these
    at most."""
    corners, vectors = (
        component_major(each[triangles].swapaxes(0, 1)) for each in (shell.triangles.corners, shell.triangles.vectors)
    )
    first, second = vectors[side], vectors[(side + 1) % 3]
    along = units(corners[(side + 1) % 3] - corners[side])
    inwards = units(cross_products(first + second, along))
    thick = ranges * np.maximum(*(np.abs(dot_products(inwards, vector)) for vector in (first, second)))
    return inwards, thick * (1 + ROUNDING)


def _around_triangle(shell: Shell, pieces: Pieces) -> FloatArray:
    """(P,): bounds for pieces that are over triangles that share a corner with theirs, whichever of these they may
    meet; infinite for others."""
    own, vertices = pieces.triangles, shell.triangles.vertices[pieces.triangles]
    points = _all_points(pieces)
    counts = np.diff(shell.star_starts)
    is_left_out = np.any(shell.is_border[vertices] | (counts[vertices] > MANY_AROUND), axis=1)
    found = np.where((shell.ranges[own] > 0) & ~is_left_out, 0.0, np.inf)
    possible = np.flatnonzero(np.isfinite(found))
    at = vertices[possible].ravel()
    counts = counts[at]
    all_around, owners = ranges_of(shell.star_starts[at], counts), np.repeat(np.repeat(possible, 3), counts)
    for some in index_chunks(np.arange(len(owners)), PAIRS_AT_ONCE):
        there, pair = shell.star_triangles[all_around[some]], owners[some]
        ranges, seen = shell.ranges[own[pair]], selected_vectors(points, pair)
        meets, stays = _meetings(shell, seen, there, vertices[pair], ranges)
        seen = seen - component_major(shell.triangles.corners[there, 0])
        bound = np.abs(dot_products(seen, shell.triangles.normals[there])).max(axis=0) / shell.cosines[there]
        bound = np.where(stays & (bound <= ranges), bound, np.inf)
        np.maximum.at(found, pair[meets], bound[meets])
    return found


def _meetings(
    shell: Shell, points: FloatArray, triangles: IndexArray, vertices: IndexArray, ranges: FloatArray
) -> tuple[BoolArray, BoolArray]:
    """(n,) bool twice: whether hulls of points (R, n, 3) may meet the prisms of triangles (n,); and whether they are on
    the inner side of the walls there that do not touch any of the given vertices (n, 3)."""
    meets, stays = np.ones((2, len(triangles)), dtype=bool)
    numbers = shell.triangles.vertices[triangles]
    is_around = (numbers[:, :, None] == vertices[:, None]).any(axis=2)
    for side in range(3):
        inwards, margin = _wall_plane(shell, triangles, side, ranges)
        seen = dot_products(points - component_major(shell.triangles.corners[triangles, side]), inwards)
        meets &= np.any(seen >= -margin, axis=0)
        is_outer = ~is_around[:, side] & ~is_around[:, (side + 1) % 3]
        stays &= ~is_outer | np.all(seen > margin, axis=0)
    return meets, stays


def _all_points(pieces: Pieces) -> FloatArray:
    """(R + R', P, 3): the points of hulls, and what is drawn."""
    return np.concatenate([each.swapaxes(1, 2) for each in (pieces.hulls, pieces.flats)]).swapaxes(1, 2)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def raised_at_sides(shell: Shell, pieces: Pieces, bounds: FloatArray, off_beyond: FloatArray | None) -> FloatArray:
    """(P,): bounds (P,) of pieces, raised to those of their curves over sides that are closed, or beside what is
    compared at equal parameters. off_beyond: as in ``shell_bounds``."""
    raised, counted = bounds.copy(), shell.triangles.is_closed
    if off_beyond is not None:
        counted = counted | np.isfinite(off_beyond)
    which, turns, curves = _curves_on(shell, pieces, np.isfinite(bounds)[:, None] & counted[pieces.triangles])
    is_closed = shell.triangles.is_closed[curves.triangles, turns]
    for chosen, are_closed in ((np.flatnonzero(is_closed), True), (np.flatnonzero(~is_closed), False)):
        if not len(chosen):
            continue
        some, own = curves.at(chosen), which[chosen]
        if are_closed:
            found = _closed_bounds(shell, some, turns[chosen])
        else:
            assert off_beyond is not None
            off = off_beyond[some.triangles, turns[chosen]]
            found = _bridge_bounds(shell, some, turns[chosen], bounds[own], off)
        np.maximum.at(raised, own, found)
    return raised


def _curves_on(shell: Shell, pieces: Pieces, counted: BoolArray) -> tuple[IndexArray, IndexArray, Pieces]:
    """The curves of pieces over sides of their triangles that are counted (P, 3): (n,) the piece of each, and which
    side that is."""
    sides, which, turns, curves = SIDES[len(pieces.flats)], [], [], []
    starts = [start for start, _, _ in sides]
    for turn in range(3):
        chosen = np.flatnonzero(counted[:, turn])
        are_on = _are_on_side(shell, pieces.triangles[chosen], turn, selected_vectors(pieces.flats[starts], chosen))
        for start, end, rows in sides:
            own = chosen[are_on[starts.index(start)] & are_on[starts.index(end)]]
            hulls = pieces.hulls[rows] if _are_alike(pieces) else pieces.hulls
            which.append(own)
            turns.append(np.full(len(own), turn))
            curves.append(Pieces(pieces.triangles, hulls, pieces.flats[rows]).at(own))
    return np.concatenate(which), np.concatenate(turns), Pieces.joined(curves)


def _are_on_side(shell: Shell, triangles: IndexArray, side: int, points: FloatArray) -> BoolArray:
    """(n, P) whether points that are drawn (n, P, 3) are on a side of their triangles."""
    corners = component_major(shell.triangles.corners[triangles].swapaxes(0, 1))
    along = corners[(side + 1) % 3] - corners[side]
    away, way = points - corners[side], units(along)
    off = lengths(away - dot_products(away, way)[..., None] * way)
    # Far from the origin points on a side are off it by roundings of their coordinates; one too many does no harm.
    return off <= ON_VECTOR * lengths(along) + COORDINATE_ROUNDING * np.abs(corners).max(axis=(0, 2))


def _seen_curves(shell: Shell, curves: Pieces, turns: IndexArray) -> _Seen:
    """Curves over sides of their triangles, which count as sides 0."""
    return _Seen.of(shell, curves, turns, [0, len(curves.hulls) - 1] if _are_alike(curves) else [])


def _bridge_bounds(
    shell: Shell, curves: Pieces, turns: IndexArray, bounds: FloatArray, off_beyond: FloatArray
) -> FloatArray:
    """(P,): at least how far the points of curves over sides are from all places on their ways, where those of the
    pieces they belong to are within some bounds (P,). off_beyond: (P,), as in ``shell_bounds``."""
    own = curves.triangles
    seen = _seen_curves(shell, curves, turns)
    thin = RANGE_FOR_HEIGHT * seen.heights / shell.cosines[own]
    ranges = np.where(bounds <= thin, np.minimum(thin, shell.ranges[own]), shell.ranges[own])
    sides = [_Side.of(seen, side, ranges) for side in range(3)]
    beyond = _Beyond.of(shell, seen, 0, sides[0], ranges)
    stays = _are_in_front(seen, sides) & sides[1].stays_inside() & sides[2].stays_inside()
    stays &= sides[0].stays_inside() | beyond.are_placed
    there = beyond.heights.max(axis=0) / shell.cosines[beyond.across]
    straight = np.maximum(there, seen.heights / shell.cosines[own])
    found: FloatArray = np.where(stays, straight, bounds + np.minimum(off_at_equal(curves), off_beyond))
    return found


def off_at_equal(pieces: Pieces) -> FloatArray:
    """(P,): how far pieces are from what is drawn at equal parameters, at most."""
    if _are_alike(pieces):
        return lengths(pieces.hulls - pieces.flats).max(axis=0)
    return np.max([lengths(pieces.hulls - each).max(axis=0) for each in pieces.flats], axis=0)


def _closed_bounds(shell: Shell, curves: Pieces, turns: IndexArray) -> FloatArray:
    """(P,): at least how far the points of curves over closed sides are from points of these that follow them."""
    own, ranges = curves.triangles, shell.ranges[curves.triangles]
    seen = _seen_curves(shell, curves, turns)
    along, from_start = seen.sides[0], seen.points
    part = dot_products(from_start, along) / np.maximum(squared_norms(along), 1e-300)
    off = lengths(from_start - np.clip(part, 0.0, 1.0)[..., None] * along).max(axis=0)
    bounds = np.hypot(off, _slid(seen, 0, ranges)) * (1 + ROUNDING)
    # The walls of the other two sides, as seen from the ends of this one.
    following, before = _Side.of(seen, 1, ranges), _Side.of(seen, 2, ranges)
    placed = following.are_inside[0].all(axis=0) & before.are_inside[1].all(axis=0)
    bounds = np.where(placed, bounds, np.inf)
    for corner in range(3):
        at_border = shell.is_border[shell.triangles.vertices[own, corner]]
        bounds = np.minimum(bounds, np.where(at_border, _near_corner(shell, curves, corner, at_side=True), np.inf))
    return bounds
