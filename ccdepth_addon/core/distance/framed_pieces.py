# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces in the frames of the corners of their triangles, and the walls of prisms beside them. docs/distance.md, Lemma
7, has the notation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, cross_products, dot_products, lengths, units
from ..surface.bicubic import QUARTERS
from ..surface.triangle_coefficients import triangle_quarters
from .piece_hulls import CORNERS_OF, Pieces, all_points, are_alike
from .shells import Shell

# Points within this part of the triangle's size of a corner's vector count as on the vector; bounds include the part.
ON_VECTOR = 2.0**-36

# The relative margin of bounds and conditions, above all rounding.
ROUNDING = 2.0**-40

# The coefficients of a piece's quarters, by the number of coefficients of the piece.
FINER = {
    16: np.unique(np.concatenate(QUARTERS), axis=0),
    28: np.unique(np.concatenate(triangle_quarters()), axis=0),
}


@dataclass(frozen=True)
class FramedPieces(Table, corners=-2, vectors=-2, sides=-2, points=-2, radii=-1, on_vectors=-1):
    """P pieces in the frames of their triangles.

    own: (P,), the triangles; turns: (P,), the corner and the side of each that count as corner 0 and side 0. corners,
    vectors: (3, P, 3), T and N; sides: (3, P, 3), from corner k to k + 1; points: (R, P, 3), the hull points, seen from
    corner 0. radii: (3, P), bounds of the distance of hull and drawn points from each corner. rows: n hull points that
    may be at corners; on_vectors: (3, n, P) bool, whether each of these lies on the vector of each corner. sizes: (P,),
    the longest sides of the triangles. heights: (P,), the largest heights over the triangles' planes.
    """

    own: IndexArray
    turns: IndexArray
    corners: FloatArray
    vectors: FloatArray
    sides: FloatArray
    points: FloatArray
    radii: FloatArray
    rows: list[int]
    on_vectors: BoolArray
    sizes: FloatArray
    heights: FloatArray

    @staticmethod
    def of(
        shell: Shell, pieces: Pieces, turns: IndexArray | None = None, rows: list[int] | None = None
    ) -> FramedPieces:
        """The pieces of a shell in frames. rows: the hull points that may be at corners, by default those over drawn
        corners."""
        own = pieces.triangles
        turns = np.zeros_like(own) if turns is None else turns
        corners, vectors = (
            component_major(np.stack([each[own, (turns + k) % 3] for k in range(3)]))
            for each in (shell.triangles.corners, shell.triangles.vectors)
        )
        sides = np.stack([corners[(k + 1) % 3] - corners[k] for k in range(3)])
        sizes = lengths(sides).max(axis=0)
        points_of = all_points(pieces).swapaxes(1, 2)
        low, high = points_of.min(axis=0).T, points_of.max(axis=0).T
        radii = (lengths((low + high) / 2 - corners) + lengths(high - low) / 2) * (1 + ROUNDING)
        if rows is None:
            rows = CORNERS_OF[len(pieces.flats)] if are_alike(pieces) else []
        is_on = np.ones((3, len(rows), len(own)), dtype=bool)
        for k in range(3):
            for each in (pieces.hulls, pieces.flats):
                away = each[rows] - corners[k]
                along = dot_products(away, vectors[k])
                is_on[k] &= lengths(away - along[..., None] * vectors[k]) <= ON_VECTOR * sizes
        points = pieces.hulls - corners[0]
        over_plane = dot_products(points, component_major(shell.triangles.normals[own]))
        heights = np.abs(over_plane).max(axis=0)
        if are_alike(pieces) and len(over_plane) in FINER:
            # The surface is lower than its coefficients; the coefficients over quarters are nearer to the surface.
            high = np.flatnonzero(heights > shell.ranges[own] * shell.cosines[own])
            finer = matrix_product(FINER[len(over_plane)], over_plane[:, high])
            heights[high] = np.abs(finer).max(axis=0, initial=0.0) * (1 + ROUNDING)
        return FramedPieces(own, turns, corners, vectors, sides, points, radii, rows, is_on, sizes, heights)

    def along(self, directions: FloatArray, corner: int) -> FloatArray:
        """(R, P): the components of hull points, seen from a corner, along directions (P, 3)."""
        found = dot_products(self.points, directions)
        if corner:
            found -= dot_products(self.corners[corner] - self.corners[0], directions)
        return found

    def include_on_vector(self, found: BoolArray, corner: int) -> None:
        """Set found (R, P) to True at points on the vector of a corner."""
        found[self.rows] |= self.on_vectors[corner]


@dataclass(frozen=True)
class Wall(Table, inwards=-2):
    """The wall over a side, seen from a corner. inwards: (P, 3), the unit normal of the plane of side and vector, on
    the wanted side. lengths: (P,), of the side's component across the vector. margins: (P,), m with inwards·r ≤ m|r|
    for points r of the wall, |r| their distance from the vector; infinite where no such bound is known."""

    inwards: FloatArray
    lengths: FloatArray
    margins: FloatArray

    @staticmethod
    def of(along: FloatArray, vector: FloatArray, other: FloatArray, ranges: FloatArray, sign: int) -> Wall:
        """The walls over sides along (P, 3) from a corner on. vector, other: (P, 3), N at the corner and at the other
        end."""
        length = lengths(along - dot_products(along, vector)[:, None] * vector)
        inwards = cross_products(vector, along) * (sign / np.maximum(length, 1e-300))[:, None]
        least = length - ranges * lengths(other - vector)
        off = ranges * np.abs(dot_products(inwards, other))
        return Wall(inwards, length, np.where(least > 0, off / np.maximum(least, 1e-300) + ROUNDING, np.inf))


@dataclass(frozen=True)
class Side(Table, heights=-1, are_inside=-1):
    """A side with its walls, seen from both ends. heights: (R, P) for each end, of hull points over the plane of the
    wall; are_inside: (R, P) bool, whether points are on the inner side of the wall, or on the vector of an end."""

    walls: tuple[Wall, Wall]
    heights: tuple[FloatArray, FloatArray]
    are_inside: tuple[BoolArray, BoolArray]

    @staticmethod
    def of(seen: FramedPieces, side: int, ranges: FloatArray) -> Side:
        walls, heights, are_inside = [], [], []
        for corner, other, sign in ((side, (side + 1) % 3, 1), ((side + 1) % 3, side, -1)):
            along = sign * seen.sides[side]
            walls.append(Wall.of(along, seen.vectors[corner], seen.vectors[other], ranges, sign))
            heights.append(seen.along(walls[-1].inwards, corner))
            are_inside.append(heights[-1] > walls[-1].margins * seen.radii[corner] + ROUNDING * seen.sizes)
            seen.include_on_vector(are_inside[-1], corner)
        return Side((walls[0], walls[1]), (heights[0], heights[1]), (are_inside[0], are_inside[1]))

    def stays_inside(self) -> BoolArray:
        """(P,) bool: whether no point of a piece is beyond the side."""
        first, second = self.are_inside
        found: BoolArray = first.all(axis=0) | second.all(axis=0)
        return found


def are_in_front(seen: FramedPieces, sides: Sequence[Side]) -> BoolArray:
    """(P,) bool: whether all points are in front of every corner, on the triangle's side. The unit normals of both
    walls at a corner add up to a vector between the sides."""
    found = np.ones(len(seen.own), dtype=bool)
    for corner in range(3):
        in_front = sides[corner].heights[0] + sides[corner - 1].heights[1] > ROUNDING * seen.sizes
        seen.include_on_vector(in_front, corner)
        found &= in_front.all(axis=0)
    return found


def off_side(seen: FramedPieces, side: int) -> FloatArray:
    """(R, P): the distances of hull points from the line of a side."""
    points = seen.points - (seen.corners[side] - seen.corners[0])
    along = units(seen.sides[side])
    return lengths(points - dot_products(points, along)[..., None] * along)


def slid_along(seen: FramedPieces, side: int, ranges: FloatArray) -> FloatArray:
    """(P,): bounds of the shift along a side between a point of the wall and its foot on the side."""
    along = units(seen.sides[side])
    first, second = (np.abs(dot_products(along, seen.vectors[k % 3])) for k in (side, side + 1))
    return ranges * np.maximum(first, second)
