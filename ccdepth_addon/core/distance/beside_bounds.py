# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of pieces over their own triangle and the triangles across its sides. docs/distance.md, Lemma 7."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, cross_products, dot_products, lengths, units
from .framed_pieces import ROUNDING, FramedPieces, Side, Wall, are_in_front, off_side, slid_along
from .shells import Shell

# The thickness of the shell for a piece, in units of the piece's largest height.
RANGE_FOR_HEIGHT = 1.5


def bounds_beside(shell: Shell, seen: FramedPieces, ranges: FloatArray) -> FloatArray:
    """(P,): bounds for pieces over their own triangle and the triangles across its sides, in a shell of some ranges;
    infinite for other pieces."""
    bounds = seen.heights / _own_cosines(shell, seen, ranges)
    sides = [Side.of(seen, side, ranges) for side in range(3)]
    placed = are_in_front(seen, sides)
    for number, side in enumerate(sides):
        crossed = np.flatnonzero(placed & ~side.stays_inside())
        if len(crossed):
            beyond = Beyond.of(shell, seen.at(crossed), number, side.at(crossed), ranges[crossed])
            placed[crossed] = beyond.are_placed
            bounds[crossed] = np.maximum(bounds[crossed], beyond.bounds())
    return np.where(placed & (bounds <= ranges), bounds, np.inf)


def _own_cosines(shell: Shell, seen: FramedPieces, ranges: FloatArray) -> FloatArray:
    """(P,): the least cosine between a triangle's normal and the vectors at the places of a piece over the triangle."""
    normals = component_major(shell.triangles.normals[seen.own])
    along, across = seen.sides[0], -seen.sides[2]
    first, second, third = (dot_products(normals, vector) for vector in seen.vectors)
    # A place is off the foot on the plane by the part of s N across the normal, at most the range.
    area = np.maximum(dot_products(normals, cross_products(along, across)), 1e-300)
    slope = ((second - first) / area)[:, None] * cross_products(across, normals)
    slope += ((third - first) / area)[:, None] * cross_products(normals, along)
    least = first + seen.along(slope, 0).min(axis=0) - ranges * lengths(slope)
    found: FloatArray = np.maximum(least * (1 - ROUNDING), shell.cosines[seen.own])
    return found


@dataclass(frozen=True)
class Beyond:
    """The places of pieces beyond a side of their triangles. number: the side; across: (P,), the triangles across the
    side. are_placed: (P,) bool, whether points beyond the side are over that triangle; heights: (R, P), of all points
    over the triangle's plane."""

    shell: Shell
    seen: FramedPieces
    number: int
    ranges: FloatArray
    across: IndexArray
    are_placed: BoolArray
    heights: FloatArray

    @staticmethod
    def of(shell: Shell, seen: FramedPieces, number: int, side: Side, ranges: FloatArray) -> Beyond:
        triangles, at = shell.triangles, (seen.own, (seen.turns + number) % 3)
        across = triangles.across[at]
        apex, apex_vector = (
            component_major(each[across, triangles.apexes[at]]) for each in (triangles.corners, triangles.vectors)
        )
        placed = np.ones(len(across), dtype=bool)
        for end, (corner, sign) in enumerate(((number, 1), ((number + 1) % 3, -1))):
            vector, to_apex = seen.vectors[corner], apex - seen.corners[corner]
            outer = Wall.of(to_apex, vector, apex_vector, ranges, sign)
            passed = seen.along(outer.inwards, corner) > outer.margins * seen.radii[corner] + ROUNDING * seen.sizes
            placed &= np.all(side.are_inside[end] | passed, axis=0)
            placed &= _is_open(side.walls[end], outer, to_apex, ranges * lengths(apex_vector - vector))
        heights = np.abs(seen.along(component_major(triangles.normals[across]), number))
        return Beyond(shell, seen, number, ranges, across, placed, heights)

    def bounds(self) -> FloatArray:
        """(P,): bounds of |s| beyond the wall, and of the distance from the side where the side is closed."""
        triangles, seen, ranges = self.shell.triangles, self.seen, self.ranges
        along = units(seen.sides[self.number])
        first, second = (seen.vectors[k % 3] for k in (self.number, self.number + 1))
        inwards = units(cross_products(first + second, along))
        upwards = cross_products(along, inwards)
        # This bounds the distance of the wall from the plane of the side and the mean of its vectors.
        thick = ranges * np.maximum(*(np.abs(dot_products(inwards, vector)) for vector in (first, second)))
        are_beyond = seen.along(inwards, self.number) <= thick * (1 + ROUNDING) + ROUNDING * seen.sizes
        reached = np.where(are_beyond, self.heights, 0.0).max(axis=0)
        # In the plane of the side both heights are fractions of one length.
        own_cosine, own_sine, cosine, sine = (
            dot_products(triangles.normals[each], axis)
            for each in (seen.own, self.across)
            for axis in (upwards, inwards)
        )
        share = cosine / own_cosine
        # Points at the wall belong to the hull, which may be higher than the surface.
        highest = np.abs(seen.along(component_major(triangles.normals[seen.own]), 0)).max(axis=0)
        at_wall = np.abs(share) * highest + np.abs(sine - share * own_sine) * thick
        bounds = np.maximum(reached, at_wall) / self.shell.cosines[self.across]
        bounds = np.where(own_cosine > 0, bounds, np.inf)
        closed = np.flatnonzero(triangles.is_closed[seen.own, (seen.turns + self.number) % 3])
        if len(closed):
            some = seen.at(closed)
            off = np.where(are_beyond[:, closed], off_side(some, self.number), 0.0).max(axis=0)
            lifted = (highest[closed] + 2 * thick[closed]) / np.maximum(own_cosine[closed], 1e-300)
            off = np.hypot(np.maximum(off, lifted), slid_along(some, self.number, ranges[closed]))
            bounds[closed] = np.maximum(bounds[closed], off)
        return bounds


def _is_open(wall: Wall, outer: Wall, to_apex: FloatArray, moved: FloatArray) -> BoolArray:
    """(P,) bool: whether the angle from a wall to the next wall exceeds the margins, with the prism between both beyond
    the first wall."""
    down = -dot_products(wall.inwards, to_apex)
    return (down > 2 * (wall.margins + outer.margins) * outer.lengths) & (down > moved)
