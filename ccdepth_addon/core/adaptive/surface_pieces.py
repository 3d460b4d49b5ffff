# SPDX-License-Identifier: GPL-3.0-or-later
"""The pieces of the surface over the triangles of templates, for the bounds of ``core/distance``.

Tiles cover the surface over a leaf, each over a square of the leaf's parameters. A tile inside a triangle of the
template is one piece. A bicubic tile across lines of the template is cut into triangles, or into smaller squares where
the lines are curved in the tile's parameters. A tile that is still across a line, or around an extraordinary vertex,
counts as over every triangle it meets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..arrays.ranges import ranges
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, selected_vectors, transformed_nets
from ..distance.leaf_surfaces import Tiles
from ..distance.piece_hulls import Pieces
from ..distance.pieces import HULL_FORM, SQUARE_FORM, TRIANGLE_FORM, Form
from ..surface.bicubic import GREVILLE, QUARTERS
from ..surface.squares import WHOLE_QUAD, Square, Squares
from .template_rows import barycentric_rows, clipped, functionals
from .templates import (
    COUNTS_OF_TRIANGLE,
    QUAD_POINTS,
    TRIANGLE_COUNTS,
    TRIANGLE_POINTS,
    TRIANGLES,
    TRIANGLES_OF_TRIANGLE,
)

# Weights below this are 0, as all weights are small multiples of powers of a half.
NOTHING = 2.0**-40

# The number of times squares are halved both ways where lines of a template are curved in their parameters.
SPLITS_AT_LINES = 1


@dataclass(frozen=True)
class Part:
    """A part of a tile over a triangle of a template. rows: (R, 16), the hull points as functionals of the tile's
    coefficients, or None for all points of the tile; weights: (R', 3), the barycentric weights of the drawn points."""

    form: Form
    rows: FloatArray | None
    weights: FloatArray


@dataclass(frozen=True)
class DrawnTiles(Table):
    """Tiles with their leaves (n,) and keys (n,). A key names the drawn triangles below a tile: of a template, of a
    quarter of a control triangle with a pattern of split sides, or of half a quarter of a larger polygon. firsts: (n,),
    the triangle, counted within the leaf, from which the triangles of parts are counted."""

    tiles: Tiles
    leaves: IndexArray
    keys: IndexArray
    firsts: IndexArray


# The halves of quarters of control polygons, drawn as triangles (centroid, a, b) around the centroid: at the side after
# the quarter's corner, whole or split, and at the side before, whole or split. Each half has its places in the quarter,
# counterclockwise from the corner, and the weights of the triangle's corners there.
AFTER, BEFORE = [(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]
HALVES_OF_QUARTERS: tuple[tuple[FloatArray, FloatArray], ...] = tuple(
    (np.array(places, dtype=np.float64), np.array(weights))
    for places, weights in (
        (AFTER, [[0, 1, 0], [0, 0.5, 0.5], [1, 0, 0]]),
        (AFTER, [[0, 1, 0], [0.0, 0, 1], [1, 0, 0]]),
        (BEFORE, [[0, 0, 1], [1, 0, 0], [0, 0.5, 0.5]]),
        (BEFORE, [[0, 0, 1], [1, 0, 0], [0.0, 1, 0]]),
    )
)

# Keys are indices: first the numbers of templates, then quarters, then halves.
FIRST_OF_QUARTERS = len(TRIANGLES)
FIRST_OF_HALVES = FIRST_OF_QUARTERS + 3 * len(TRIANGLES_OF_TRIANGLE)


def quarter_keys(patterns: IndexArray, quarters: IndexArray) -> IndexArray:
    """(P,): the keys of quarters of control triangles with patterns (P,) of split sides."""
    return FIRST_OF_QUARTERS + 3 * patterns + quarters


def half_keys(are_before: bool, are_split: BoolArray) -> IndexArray:
    """(P,): the keys of halves of quarters of polygons, at the sides before or after their corners (P,), split or whole
    (P,)."""
    return FIRST_OF_HALVES + 2 * int(are_before) + are_split


@dataclass(frozen=True)
class _Region:
    """The region of parameters below one drawn triangle. region: (4, 3), the weights of the region's corners as
    functions of 1, u, v and uv; drawn: (4, 3), the weights of the triangle's corners. corners: (3, 2), of the region in
    its quad; None in a quarter."""

    region: FloatArray
    drawn: FloatArray
    corners: FloatArray | None = None

    def weights(self, places: FloatArray) -> FloatArray:
        """(n, 3): the weights of the triangle's corners at places (n, 2)."""
        found: FloatArray = monomials(places) @ self.drawn
        return found


def monomials(places: FloatArray) -> FloatArray:
    """(…, 4): 1, u, v and uv at places (…, 2)."""
    u, v = np.moveaxis(places, -1, 0)
    return np.stack([np.ones_like(u), u, v, u * v], axis=-1)


# The matrix from weights at a square's corners to functions of 1, u, v and uv.
FROM_CORNERS = np.linalg.inv(monomials(QUAD_POINTS[:4]))

# The corners' weights at the Greville places of a square.
AT_GREVILLE = monomials(GREVILLE) @ FROM_CORNERS


def _over(corners: FloatArray, weights: FloatArray) -> _Region:
    """The region with corners (3, 2) in its quad, and weights (3, 3) of the drawn triangle's corners at these
    corners."""
    opposite, doubled_area = barycentric_rows(corners)
    region = np.insert(opposite[[2, 0, 1]] / doubled_area, 3, 0.0, axis=0)
    return _Region(region, region @ weights, corners)


def _all_regions() -> Iterator[list[_Region]]:
    """The regions of all triangles of each key."""
    for triangles, count in zip(TRIANGLES, TRIANGLE_COUNTS, strict=True):
        yield [_over(QUAD_POINTS[points], np.eye(3)) for points in triangles[:count]]
    for triangles, count in zip(TRIANGLES_OF_TRIANGLE, COUNTS_OF_TRIANGLE, strict=True):
        for quarter in range(3):
            ring = np.roll(np.array([[1, 0, 0], [0.5, 0.5, 0], [1 / 3, 1 / 3, 1 / 3], [0.5, 0, 0.5]]), quarter, axis=1)
            to_triangles = [np.rint(np.linalg.inv(TRIANGLE_POINTS[points])) for points in triangles[:count]]
            yield [_Region(each, each) for each in (FROM_CORNERS @ ring @ own for own in to_triangles)]
    for corners, weights in HALVES_OF_QUARTERS:
        yield [_over(corners, weights)]


REGIONS = list(_all_regions())


# The share of a tile over a triangle: all, some, or else the half without corner 0, 1, 2 or 3.
ALL, SOME = -1, -2

# The corners of these halves; for each half the matrix from the tile's coefficients to its own, and the weights of its
# corners at the coefficients of the drawn triangle.
HALVES_OF_SQUARES = [[(corner + k) % 4 for k in (1, 2, 3)] for corner in range(4)]
ROWS_OF_HALVES = [functionals(QUAD_POINTS[half], WHOLE_QUAD, QUAD_POINTS[half]) for half in HALVES_OF_SQUARES]


@dataclass(frozen=True)
class TilesOverTriangles(Table):
    """n pairs of a tile and a triangle whose region meets the tile. tiles: (n,) intp; triangles: (n,) intp, within the
    templates; weights: (n, 4, 3), of the triangle's corners at the tile's corners. shares: (n,) int8, the share of the
    tile over the triangle: ``ALL``, the half without this corner, or ``SOME``."""

    tiles: IndexArray
    triangles: IndexArray
    weights: FloatArray
    shares: NDArray[np.int8]

    @staticmethod
    def of(keys: IndexArray, squares: Squares) -> TilesOverTriangles:
        """The tiles over squares (P,), paired with the triangles of their keys."""
        kinds, places = np.unique(keys, return_inverse=True)
        regions = [REGIONS[key] for key in kinds.tolist()]
        counts = np.array([len(each) for each in regions], dtype=np.intp)[places.reshape(-1)]
        firsts = np.cumsum([0, *map(len, regions)])[places.reshape(-1)]
        tiles, which = np.repeat(np.arange(len(keys)), counts), ranges(firsts, counts)
        region, drawn = (
            np.stack([getattr(each, name) for of_kind in regions for each in of_kind]) for name in ("region", "drawn")
        )
        at_corners = monomials(np.moveaxis(squares.corners(), 0, 1))[tiles]
        inside = at_corners @ region[which]
        meets = np.flatnonzero(inside.max(axis=1).min(axis=1) > NOTHING)
        tiles, which, inside = tiles[meets], which[meets], inside[meets]
        shares = np.full(len(meets), SOME, dtype=np.int8)
        shares[inside.min(axis=(1, 2)) >= -NOTHING] = ALL
        for corner, half in enumerate(HALVES_OF_SQUARES):
            # A side of the region is the diagonal between both halves; in quarters of triangles no diagonal is drawn.
            is_cut = np.all(np.abs(inside[:, half[::2]]) <= NOTHING, axis=1) & (inside[:, corner] < -NOTHING)
            is_half = is_cut.any(axis=1) & (inside[:, half].min(axis=(1, 2)) >= -NOTHING)
            shares[is_half & np.all(region[which, 3] == 0, axis=1)] = corner
        return TilesOverTriangles(tiles, which - firsts[tiles], at_corners[meets] @ drawn[which], shares)


@lru_cache(maxsize=8192)
def parts_of(key: int, triangle: int, place: tuple[float, ...], *, are_bicubic: bool) -> tuple[Part, ...]:
    """The parts over one triangle of a tile over a square of the parameters. place: the square's origin and axes."""
    region, numbers = REGIONS[key][triangle], np.array(place)
    square = Square(numbers[:2], numbers[2:].reshape(2, 2))
    if region.corners is None:
        splits = SPLITS_AT_LINES if are_bicubic else 0
        return tuple(_over_squares(region, square, np.eye(16), splits, are_bicubic))
    pieces = clipped(region.corners, square)
    if not are_bicubic:
        return (Part(HULL_FORM, None, region.weights(square.corners())),) if pieces else ()
    found = []
    for piece in pieces:
        rows, inside = functionals(piece, square, region.corners)
        found.append(Part(TRIANGLE_FORM, rows, region.weights(inside @ region.corners)))
    return tuple(found)


def _over_squares(region: _Region, square: Square, rows: FloatArray, splits: int, are_bicubic: bool) -> Iterator[Part]:
    """The parts of a square over a region, by quarters while lines of the template cut the square."""
    at_corners = region.weights(square.corners())
    if np.any(np.all(at_corners <= NOTHING, axis=0)):
        return
    is_cut = bool(np.any(at_corners < -NOTHING))
    if not are_bicubic:
        yield Part(HULL_FORM, None, at_corners)
    elif is_cut and splits:
        for corner, halves in zip(QUAD_POINTS[[0, 3, 1, 2]], QUARTERS, strict=True):
            smaller = Square(square.origin + corner @ square.axes / 2, square.axes / 2)
            yield from _over_squares(region, smaller, halves @ rows, splits - 1, are_bicubic)
    else:
        yield Part(CUT_FORM if is_cut else SQUARE_FORM, rows, AT_GREVILLE @ at_corners)


# Points beyond a triangle have no height over the triangle.
CUT_FORM = Form(np.zeros(0, dtype=np.intp), SQUARE_FORM.quarters)


def grouped(*columns: IndexArray | FloatArray) -> Iterator[tuple[FloatArray, IndexArray]]:
    """Each distinct row of the columns (n,) or (n, k) together, with the indices of the row."""
    rows = np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])
    if not len(rows):
        return
    order = np.lexsort(rows.T)
    starts = np.flatnonzero(np.append(True, np.any(np.diff(rows[order], axis=0) != 0, axis=1)))
    for start, end in pairwise([*starts.tolist(), len(rows)]):
        yield rows[order[start]], order[start:end]


def pieces_of_tiles(
    corners: FloatArray, drawn: DrawnTiles, firsts: IndexArray
) -> Iterator[tuple[IndexArray, Pieces, Form]]:
    """The pieces of tiles, with the tile of each and their form. corners: (M, 3, 3), of triangles; firsts: (P,), the
    first triangle of each tile's leaf."""
    tiles, squares = drawn.tiles, drawn.tiles.squares
    over = TilesOverTriangles.of(drawn.keys, squares)
    yield from pieces_by_corners(corners, tiles, over, firsts)
    cut = over.at(over.shares == SOME if tiles.are_bicubic else over.shares != ALL)
    columns = (drawn.keys, squares.origins, squares.axes.reshape(-1, 4))
    for group, alike in grouped(cut.triangles, *(each[cut.tiles] for each in columns)):
        triangle, key, *place = group.tolist()
        chosen = cut.tiles[alike]
        for part in parts_of(int(key), int(triangle), tuple(place), are_bicubic=tiles.are_bicubic):
            yield chosen, pieces_over(corners, tiles, chosen, part, firsts[chosen] + int(triangle)), part.form


def pieces_by_corners(
    corners: FloatArray, tiles: Tiles, over: TilesOverTriangles, firsts: IndexArray
) -> Iterator[tuple[IndexArray, Pieces, Form]]:
    """The pieces that are a whole tile, or half of a bicubic tile, with the tile of each and their form. corners:
    (M, 3, 3), of triangles; firsts: (P,), the first triangle of each tile's leaf."""
    for share in range(-1, 4) if tiles.are_bicubic else [ALL]:
        some = over.at(over.shares == share)
        if not len(some.tiles):
            continue
        triangles = firsts[some.tiles] + some.triangles
        drawn = component_major((some.weights @ corners[triangles]).swapaxes(0, 1))
        hulls, form = selected_vectors(tiles.points, some.tiles), HULL_FORM
        if share != ALL:
            rows, weights = ROWS_OF_HALVES[share]
            hulls, form = transformed_nets(rows, hulls), TRIANGLE_FORM
            drawn = transformed_nets(weights, drawn[HALVES_OF_SQUARES[share]])
        elif tiles.are_bicubic:
            drawn, form = transformed_nets(AT_GREVILLE, drawn), SQUARE_FORM
        yield some.tiles, Pieces(triangles, hulls, drawn), form


def pieces_over(corners: FloatArray, tiles: Tiles, chosen: IndexArray, part: Part, triangles: IndexArray) -> Pieces:
    """The pieces of chosen tiles (n,) over one part of each. corners: (M, 3, 3), of triangles; triangles: (n,),
    indices."""
    points = selected_vectors(tiles.points, chosen)
    hulls = points if part.rows is None else transformed_nets(part.rows, points)
    return Pieces(triangles, hulls, transformed_nets(part.weights, corners[triangles].swapaxes(0, 1)))
