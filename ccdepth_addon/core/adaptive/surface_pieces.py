# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface over the triangles of templates: what ``core/distance`` compares with these.

The surface of a cell comes as tiles, over squares of its parameters. A tile inside a triangle of the template is one
piece; a bicubic tile that the template's lines cut is cut into triangles, or into smaller squares where these lines are
no lines in its parameters. What is still cut, or left around an extraordinary vertex, counts as over every triangle
that it meets: each has a part of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..distance.leaf_surfaces import Tiles
from ..distance.pieces import HULL_FORM, SQUARE_FORM, TRIANGLE_FORM, Form
from ..distance.shell_bounds import Curves, Pieces
from ..distance.shells import Shell
from ..surface.bicubic import HALVES
from .leaf_bounds.triangle_bounds import Square, barycentric, clipped, functionals
from .templates import (
    COUNTS_OF_TRIANGLE,
    QUAD_POINTS,
    TRIANGLE_COUNTS,
    TRIANGLE_POINTS,
    TRIANGLES,
    TRIANGLES_OF_TRIANGLE,
)

# (16, 2): the parameters of the Bernstein coefficients of a bicubic square; and those of its sides.
GREVILLE = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])
SIDES_OF_SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
ON_SIDES = ([0, 4, 8, 12], [12, 13, 14, 15], [15, 11, 7, 3], [3, 2, 1, 0])

# Weights nearer to 0 than this are: all are small multiples of powers of a half.
NOTHING = 2.0**-40

# How often squares are halved both ways where a template's lines cut them and are no lines in their parameters.
SPLITS_AT_LINES = 3


@dataclass(frozen=True)
class AtSide:
    """A side of a part that lies on a side of its triangle. side: the latter; hull, drawn: which of the part's hull
    points, and of those that are drawn, are there."""

    side: int
    hull: Sequence[int] | slice
    drawn: Sequence[int]


@dataclass(frozen=True)
class Part:
    """A part of a tile over one triangle of a template. rows: (R, 16), its hull points from the tile's coefficients, or
    None for all points of the tile; weights: (R', 3), of the triangle's corners for what is drawn there."""

    triangle: int
    form: Form
    rows: FloatArray | None
    weights: FloatArray
    at_sides: tuple[AtSide, ...]


@dataclass(frozen=True)
class DrawnTiles:
    """Tiles, the cell of each, (n,), and keys (n,) of what they are drawn as: of a template and its turn, of a pattern
    and the quarter of a triangle of the control mesh, or of half a quarter of a larger polygon. firsts: (n,), from the
    first triangle of their leaves on, the one from which the triangles of parts are counted."""

    tiles: Tiles
    cells: IndexArray
    keys: IndexArray
    firsts: IndexArray

    def at(self, chosen: IndexArray) -> DrawnTiles:
        """Some of them, by index."""
        return DrawnTiles(self.tiles.at(chosen), self.cells[chosen], self.keys[chosen], self.firsts[chosen])


def quad_keys(numbers: IndexArray, turns: IndexArray) -> IndexArray:
    """(P,): keys of quads that are drawn by templates (P,), counted from corners ``turns`` on."""
    return 4 * numbers + turns


def quarter_keys(patterns: IndexArray, quarters: IndexArray) -> IndexArray:
    """(P,): keys of quarters of triangles of the control mesh, drawn with sides split in patterns (P,)."""
    return -1 - 3 * patterns - quarters


# Halves of the quarters of polygons of the control mesh, drawn as triangles (centroid, a, b) around the centroid: at
# the side after the quarter's corner, whole or split, and at the side before, whole or split. Of each the places in the
# quarter, corner and centroid first, and the weights of the triangle's corners there.
AFTER, BEFORE = [(0, 0), (1, 1), (1, 0)], [(0, 0), (1, 1), (0, 1)]
HALVES_OF_QUARTERS: tuple[tuple[FloatArray, FloatArray], ...] = tuple(
    (np.array(places, dtype=np.float64), np.array(weights))
    for places, weights in (
        (AFTER, [[0, 1, 0], [1, 0, 0], [0, 0.5, 0.5]]),
        (AFTER, [[0, 1, 0], [1, 0, 0], [0.0, 0, 1]]),
        (BEFORE, [[0, 0, 1], [1, 0, 0], [0, 0.5, 0.5]]),
        (BEFORE, [[0, 0, 1], [1, 0, 0], [0.0, 1, 0]]),
    )
)
FIRST_OF_HALVES = -100


def half_keys(are_before: bool, are_split: BoolArray) -> IndexArray:
    """(P,): keys of halves of quarters of polygons, at the sides before their corners or after them, which are split or
    not (P,)."""
    return FIRST_OF_HALVES - 2 * int(are_before) - are_split


@lru_cache(maxsize=8192)
def parts_of(key: int, place: tuple[float, ...], *, are_bicubic: bool) -> tuple[Part, ...]:
    """The parts of tiles over a square of the parameters, place: its origin and axes."""
    if key <= FIRST_OF_HALVES:
        corners, weights = HALVES_OF_QUARTERS[FIRST_OF_HALVES - key]
        # Places are counted counterclockwise.
        order = [0, 2, 1] if FIRST_OF_HALVES - key < 2 else [0, 1, 2]
        return tuple(_parts_over(0, corners[order], weights[order], _square(place), are_bicubic))
    if key < 0:
        return tuple(_parts_of_quarter(*divmod(-1 - key, 3), _square(place), are_bicubic))
    return tuple(_parts_of_quad(*divmod(key, 4), _square(place), are_bicubic))


def _parts_of_quad(number: int, turn: int, square: Square, are_bicubic: bool) -> Iterator[Part]:
    for triangle, points in enumerate(TRIANGLES[number, : TRIANGLE_COUNTS[number]]):
        corners = QUAD_POINTS[(points + turn) % 4 + points // 4 * 4]
        yield from _parts_over(triangle, corners, np.eye(3), square, are_bicubic)


def _parts_over(
    triangle: int, corners: FloatArray, weights: FloatArray, square: Square, are_bicubic: bool
) -> Iterator[Part]:
    """Of a square and a region with corners (3, 2) in its quad, drawn in a triangle: weights (3, 3) of the triangle's
    corners at those of the region."""
    pieces = clipped(corners, square)
    if not pieces:
        return
    at_corners = barycentric(corners, square.corners())
    if not are_bicubic:
        yield _rest(triangle, at_corners @ weights)
    elif np.all(at_corners >= 0):
        inside = barycentric(corners, square.origin + GREVILLE @ square.axes)
        yield Part(triangle, SQUARE_FORM, None, inside @ weights, _sides_of_square(at_corners @ weights))
    else:
        for piece in pieces:
            yield _clipped_part(triangle, piece, square, corners, weights)


def _square(place: tuple[float, ...]) -> Square:
    numbers = np.array(place)
    return Square(numbers[:2], numbers[2:].reshape(2, 2))


def _clipped_part(triangle: int, piece: FloatArray, square: Square, corners: FloatArray, weights: FloatArray) -> Part:
    rows, inside = functionals(piece, square, corners)
    at_corners, own = barycentric(corners, piece) @ weights, barycentric(piece, inside @ corners)
    sides = []
    for start in range(3):
        rows_there = np.flatnonzero(np.abs(own[:, (start + 2) % 3]) < NOTHING).tolist()
        sides += [AtSide(side, rows_there, rows_there) for side in _on(at_corners, start, (start + 1) % 3)]
    return Part(triangle, TRIANGLE_FORM, rows, inside @ weights, tuple(sides))


def _rest(triangle: int, at_corners: FloatArray) -> Part:
    sides = [AtSide(side, slice(None), list(ends)) for ends in SIDES_OF_SQUARE for side in _on(at_corners, *ends)]
    return Part(triangle, HULL_FORM, None, at_corners, tuple(sides))


def _sides_of_square(at_corners: FloatArray) -> tuple[AtSide, ...]:
    return tuple(
        AtSide(side, rows, rows)
        for ends, rows in zip(SIDES_OF_SQUARE, ON_SIDES, strict=True)
        for side in _on(at_corners, *ends)
    )


def _on(at_corners: FloatArray, start: int, end: int) -> list[int]:
    """The sides of a triangle that the line between two of some corners lies on, by their weights."""
    return [side for side in range(3) if np.all(np.abs(at_corners[[start, end], (side + 2) % 3]) < NOTHING)]


def _parts_of_quarter(pattern: int, quarter: int, square: Square, are_bicubic: bool) -> Iterator[Part]:
    ring = np.roll(np.array([[1, 0, 0], [0.5, 0.5, 0], [1 / 3, 1 / 3, 1 / 3], [0.5, 0, 0.5]]), quarter, axis=1)
    for triangle in range(int(COUNTS_OF_TRIANGLE[pattern])):
        inside = np.rint(np.linalg.inv(TRIANGLE_POINTS[TRIANGLES_OF_TRIANGLE[pattern, triangle]]))
        splits = SPLITS_AT_LINES if are_bicubic else 0
        yield from _over_squares(triangle, ring @ inside, square, np.eye(16), splits, are_bicubic)


def _over_squares(
    triangle: int, ring: FloatArray, square: Square, rows: FloatArray, splits: int, are_bicubic: bool
) -> Iterator[Part]:
    """Of a square, or its quarters while the lines of the template cut them. ring: (4, 3), weights at the quarter's
    corners, bilinear between."""
    at_corners = _bilinear(ring, square.corners())
    if np.any(np.all(at_corners <= NOTHING, axis=0)):
        return
    is_cut = bool(np.any(at_corners < -NOTHING))
    if not are_bicubic:
        yield _rest(triangle, at_corners)
    elif is_cut and splits:
        for child, halves in enumerate(_QUARTERS):
            smaller = Square(square.origin + QUAD_POINTS[child] @ square.axes / 2, square.axes / 2)
            yield from _over_squares(triangle, ring, smaller, halves @ rows, splits - 1, are_bicubic)
    else:
        weights = _bilinear(ring, square.origin + GREVILLE @ square.axes)
        yield Part(triangle, CUT_FORM if is_cut else SQUARE_FORM, rows, weights, _sides_of_square(at_corners))


# What reaches beyond a triangle says nothing of its height.
CUT_FORM = Form(np.zeros(0, dtype=np.intp), SQUARE_FORM.quarters)

# (16, 16) each: the coefficients of a square's quarters, at its corners 0 to 3.
_QUARTERS = tuple(np.kron(HALVES[int(u)], HALVES[int(v)]) for u, v in QUAD_POINTS[:4])


def _bilinear(ring: FloatArray, places: FloatArray) -> FloatArray:
    u, v = places[:, :1], places[:, 1:]
    return (1 - u) * (1 - v) * ring[0] + u * (1 - v) * ring[1] + u * v * ring[2] + (1 - u) * v * ring[3]


def grouped(*columns: IndexArray | FloatArray) -> Iterator[tuple[FloatArray, IndexArray]]:
    """Each row that the columns (n,) or (n, k) have together, and where."""
    rows = np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])
    if not np.any(rows != rows[:1]):
        yield rows[0], np.arange(len(rows))
        return
    order = np.lexsort(rows.T)
    starts = np.flatnonzero(np.append(True, np.any(np.diff(rows[order], axis=0) != 0, axis=1)))
    for start, end in pairwise([*starts.tolist(), len(rows)]):
        yield rows[order[start]], order[start:end]


def pieces_over(shell: Shell, tiles: Tiles, chosen: IndexArray, part: Part, firsts: IndexArray) -> Pieces:
    """The pieces of chosen tiles (n,) over one part of each. firsts: (n,), the first triangle of each one's leaf in the
    shell."""
    points, triangles = tiles.points[:, chosen], firsts + part.triangle
    hulls = points if part.rows is None else (part.rows @ points.reshape(16, -1)).reshape(-1, len(chosen), 3)
    flats = part.weights @ shell.triangles.corners[triangles]
    return Pieces(triangles, np.ascontiguousarray(np.moveaxis(hulls, 0, 1)), tiles.near[chosen], flats)


def closed_curves(shell: Shell, part: Part, pieces: Pieces) -> Iterator[tuple[IndexArray, Curves]]:
    """The curves of a part's pieces over closed sides, with the indices of the pieces."""
    for at_side in part.at_sides:
        own = np.flatnonzero(shell.triangles.is_closed[pieces.triangles, at_side.side])
        if len(own):
            some = pieces.at(own)
            hulls, flats = some.hulls[:, at_side.hull], some.flats[:, at_side.drawn]
            yield own, Curves(some.triangles, np.full(len(own), at_side.side), hulls, some.near, flats)
