# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances between the surface over a level's quads and the triangles that these are drawn as.

Of every quad two bounds: by places in the shell, and at equal parameters. docs/distance.md, Quads of a level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..adaptive.leaf_bounds.descent import Squares
from ..adaptive.leaf_bounds.triangle_bounds import coefficients_over
from ..adaptive.templates import QUAD_POINTS
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import lengths
from ..bounds.norm_bounds import Vertices
from ..surface.bicubic import HALVES
from ..surface.refinement import Refinement
from .leaf_surfaces import Tiles, tiles_of
from .shell_bounds import Curves, Pieces, curve_bounds, shell_bounds
from .shells import QUAD_TRIANGLES, SIDE_OF_TRIANGLE, TRIANGLE_AT_SIDE, Shell, Triangles, vertex_vectors

# How often tiles are halved both ways before a quad is given up.
SPLITS = 5

# Quads whose tiles are looked at together.
QUADS_AT_ONCE = 1 << 12

SQUARE = QUAD_POINTS[:4]
GREVILLE = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])

# The Bernstein coefficients on each side of a square.
ON_SIDES = np.array([[0, 4, 8, 12], [12, 13, 14, 15], [15, 11, 7, 3], [3, 2, 1, 0]])

# (2, 2, 2, 2): for each triangle of a quad, from parameters seen from its first corner to weights of the other two.
SIDES_THERE = SQUARE[QUAD_TRIANGLES[..., 1:]] - SQUARE[QUAD_TRIANGLES[..., :1]]
TRIANGLE_AXES = np.linalg.inv(SIDES_THERE)

# Places are sums of powers of a half: what is nearer than this is there.
SAME_PLACE = 2.0**-40


@dataclass(frozen=True)
class Leaves:
    """Quads of a level, the descendants of a refinement, and the triangles that they are drawn as.

    points: (K, 4, 3), their corners as drawn. is_turned: (K,) bool, whether they are drawn with the diagonal from
    corner 1 to 3. limit: no larger distance is of use.
    """

    refinement: Refinement
    points: FloatArray
    is_turned: BoolArray
    shell: Shell
    limit: float

    @staticmethod
    def of(refinement: Refinement, is_turned: BoolArray, vertices: Vertices, limit: float) -> Leaves:
        mesh, numbers = refinement.mesh, refinement.corner_vertices()
        limits, errors = refinement.limits_at_corners, None
        points = limits
        if vertices is Vertices.CONTROL:
            points = mesh.positions[numbers]
            errors = np.zeros_like(mesh.positions)
            errors[numbers] = points - limits
        points = points.reshape(-1, 4, 3)
        triangles = Triangles.of(mesh, points, vertex_vectors(mesh, errors), is_turned)
        return Leaves(refinement, points, is_turned, Shell.of(mesh, triangles, limit), limit)

    def distances(self, quads: IndexArray, tick: Callable[[], None]) -> tuple[FloatArray, FloatArray]:
        """(n,) twice, of some of the quads, rising: bounds by places in the shell and at equal parameters; infinite
        where none within the limit is found. The latter only where the former is not."""
        by_places, at_equal = np.zeros(len(quads)), np.full(len(quads), np.inf)
        for begin in range(0, len(quads), QUADS_AT_ONCE):
            part = slice(begin, begin + QUADS_AT_ONCE)
            by_places[part] = self._by_places(quads[part])
            tick()
            rest = begin + np.flatnonzero(~np.isfinite(by_places[part]))
            if len(rest):
                at_equal[rest] = self.at_equal_parameters(quads[rest])
                tick()
        return by_places, at_equal

    def _tiles(self, quads: IndexArray) -> Iterator[Tiles]:
        wanted = np.zeros(len(self.refinement.bases), dtype=bool)
        wanted[quads] = True
        return tiles_of(self.refinement.keep(wanted).numbered())

    def _by_places(self, quads: IndexArray) -> FloatArray:
        found = np.where(self.shell.ranges[2 * quads] * self.shell.ranges[2 * quads + 1] > 0, 0.0, np.inf)
        for tiles in self._tiles(quads):
            for parts in _parts(tiles, self.is_turned[quads]):
                self._include(found, quads, tiles, parts)
            self._include_curves(found, quads, tiles)
        return np.where(found <= self.limit, found, np.inf)

    def _include(self, found: FloatArray, quads: IndexArray, tiles: Tiles, parts: _Parts) -> None:
        """Raise what is found (n,) of quads to the bounds of parts of tiles, halved where that is needed."""
        pending = [(parts.pattern, np.arange(len(parts.chosen)))]
        splits = SPLITS if tiles.are_bicubic else 0
        for split in range(splits + 1):
            following = []
            for pattern, some in pending:
                bases = tiles.squares.bases[parts.chosen[some]]
                some = some[np.isfinite(found[bases])]
                if not len(some):
                    continue
                chosen = parts.chosen[some]
                bases = tiles.squares.bases[chosen]
                hulls = pattern.hulls(tiles.points, chosen)
                triangles = 2 * quads[bases] + parts.triangles[some]
                flats = self._drawn(tiles.squares.at(chosen), pattern.places, quads[bases], parts.triangles[some])
                pieces = Pieces(triangles, hulls, tiles.near[chosen], flats)
                bounds = shell_bounds(self.shell, pieces)
                is_open = bounds > self.limit
                np.maximum.at(found, bases[~is_open], bounds[~is_open])
                lost = is_open & (self._heights_at(pattern, pieces) > self.limit) if split < splits else is_open
                found[bases[lost]] = np.inf
                left = some[is_open & ~lost]
                if len(left):
                    following += [(child, left) for child in pattern.children()]
            pending = following

    def _drawn(self, squares: Squares, places: FloatArray, quads: IndexArray, triangles: IndexArray) -> FloatArray:
        """(n, R, 3): the points, or in its plane beyond, of a triangle of each quad, at places (R, 2) in squares."""
        at = squares.origins[:, None] + places @ squares.axes
        which = (self.is_turned[quads].astype(np.intp), triangles)
        order = QUAD_TRIANGLES[which]
        weights = np.matmul(at - SQUARE[order[:, :1]], TRIANGLE_AXES[which])
        first, second, third = (self.points[quads, order[:, corner]] for corner in range(3))
        return first[:, None] + np.matmul(weights, np.stack([second - first, third - first], axis=1))

    def _heights_at(self, pattern: _Pattern, pieces: Pieces) -> FloatArray:
        """(P,): the largest height over the planes that points of the surface reach: values among the hull points."""
        triangles = self.shell.triangles
        points = pieces.hulls[:, pattern.values] - triangles.corners[pieces.triangles, 0][:, None]
        return np.abs(np.matmul(points, triangles.normals[pieces.triangles][:, :, None])[..., 0]).max(axis=1)

    def _include_curves(self, found: FloatArray, quads: IndexArray, tiles: Tiles) -> None:
        """Raise what is found of quads to the bounds of the curves over closed sides."""
        if not np.any(self.shell.triangles.is_closed):
            return
        bases = tiles.squares.bases
        turned = self.is_turned[quads[bases]].astype(np.intp)
        corners = tiles.squares.corners()
        for side in range(4):
            triangles = 2 * quads[bases] + TRIANGLE_AT_SIDE[turned, side]
            sides = SIDE_OF_TRIANGLE[turned, side]
            is_closed = self.shell.triangles.is_closed[triangles, sides]
            axis, value = ((1, 0.0), (0, 1.0), (1, 1.0), (0, 0.0))[side]
            on_side = np.abs(corners[:, :, axis] - value) < SAME_PLACE
            for own in range(4):
                chosen = np.flatnonzero(is_closed & on_side[own] & on_side[(own + 1) % 4])
                if len(chosen):
                    rows = ON_SIDES[own] if tiles.are_bicubic else slice(None)
                    hulls = np.moveaxis(tiles.points[rows][:, chosen], 0, 1)
                    along = GREVILLE[rows] if tiles.are_bicubic else SQUARE[[own, (own + 1) % 4]]
                    some = tiles.squares.at(chosen)
                    flats = self._drawn(some, along, quads[bases[chosen]], TRIANGLE_AT_SIDE[turned[chosen], side])
                    curves = Curves(triangles[chosen], sides[chosen], hulls, tiles.near[chosen], flats)
                    np.maximum.at(found, bases[chosen], curve_bounds(self.shell, curves))

    def at_equal_parameters(self, quads: IndexArray) -> FloatArray:
        """(n,): of some quads, rising. The larger one of both diagonals, as it is not known which one a folded quad is
        drawn with."""
        found = np.zeros(len(quads))
        for turned in (False, True):
            is_turned = np.full(len(self.is_turned), turned)
            other = replace(self, is_turned=is_turned)
            for tiles in self._tiles(quads):
                for parts in _parts(tiles, is_turned[quads]):
                    patterns = parts.pattern.children() if tiles.are_bicubic else [parts.pattern]
                    bases = tiles.squares.bases[parts.chosen]
                    squares = tiles.squares.at(parts.chosen)
                    for pattern in patterns:
                        hulls = pattern.hulls(tiles.points, parts.chosen)
                        points = other._drawn(squares, pattern.places, quads[bases], parts.triangles)
                        off = hulls - points if tiles.are_bicubic else hulls[:, :, None] - points[:, None]
                        off = lengths(off).reshape(len(bases), -1).max(axis=1) + tiles.near[parts.chosen]
                        np.maximum.at(found, bases, off)
        return found


@dataclass(frozen=True)
class _Pattern:
    """A part of tiles: a triangle of the square's parameters, a square, or all of a hull. corners: (3 or 4, 2), or None
    for a hull."""

    corners: FloatArray | None

    @property
    def values(self) -> IndexArray:
        """Which hull points are points of the surface."""
        if self.corners is None:
            return np.zeros(0, dtype=np.intp)
        return np.array([0, 3, 12, 15] if len(self.corners) == 4 else [0, 21, 27])

    @property
    def places(self) -> FloatArray:
        """(R, 2): parameters in the square at which what is drawn has the hull points' coefficients; for a hull its
        corners."""
        return SQUARE if self.corners is None else self.rows() @ GREVILLE

    def rows(self) -> FloatArray:
        """(R, 16): the part's hull points from the tile's coefficients."""
        assert self.corners is not None
        return _rows(tuple(self.corners.ravel().tolist()))

    def hulls(self, points: FloatArray, chosen: IndexArray) -> FloatArray:
        """(n, R, 3): of some tiles."""
        some = points.take(chosen, axis=1)
        if self.corners is None:
            return np.ascontiguousarray(np.moveaxis(some, 0, 1))
        rows = self.rows()
        return np.ascontiguousarray(np.moveaxis((rows @ some.reshape(16, -1)).reshape(len(rows), -1, 3), 0, 1))

    def children(self) -> list[_Pattern]:
        """The quarters."""
        assert self.corners is not None
        corners = self.corners
        middles = (corners + np.roll(corners, -1, axis=0)) / 2
        if len(corners) == 3:
            inner = [np.stack([corners[k], middles[k], middles[k - 1]]) for k in range(3)]
            return [_Pattern(each) for each in (*inner, middles)]
        centre = corners.mean(axis=0)
        first = corners[0]
        return [_Pattern(first + (centre - first) * (SQUARE + shift)) for shift in SQUARE]


@lru_cache(maxsize=4096)
def _rows(places: tuple[float, ...]) -> FloatArray:
    corners = np.array(places).reshape(-1, 2)
    if len(corners) == 3:
        return coefficients_over(corners)
    (low_u, low_v), size = corners[0], corners[2, 0] - corners[0, 0]
    return np.kron(_restricted(low_u, size), _restricted(low_v, size))


def _restricted(low: float, size: float) -> FloatArray:
    """(4, 4): the coefficients of cubics over [low, low + size], a dyadic part of [0, 1]."""
    rows = np.eye(4)
    while size < 1:
        half = int(low >= 0.5)
        rows, low, size = HALVES[half] @ rows, 2 * low - half, 2 * size
    return rows


@dataclass(frozen=True)
class _Parts:
    """Parts of tiles that lie over one triangle each. chosen: (n,) intp, of the tiles; triangles: (n,) intp, which of
    their quads' two."""

    pattern: _Pattern
    chosen: IndexArray
    triangles: IndexArray


def _parts(tiles: Tiles, is_turned: BoolArray) -> Iterator[_Parts]:
    """Of all tiles. is_turned: of their quads."""
    turned = is_turned[tiles.squares.bases]
    u, v = np.moveaxis(tiles.squares.corners(), 2, 0)
    # Positive over the quad's first triangle.
    sides = np.where(turned, u + v - 1, u - v)
    straddles = (sides.min(axis=0) < -SAME_PLACE) & (sides.max(axis=0) > SAME_PLACE)
    if not tiles.are_bicubic:
        # At a corner that both triangles have, a hull is over either.
        yield _Parts(_Pattern(None), *_over(np.arange(len(turned)), sides.mean(axis=0)))
        both = np.flatnonzero(straddles)
        if len(both):
            yield _Parts(_Pattern(None), both, np.ones(len(both), dtype=np.intp))
        return
    whole = np.flatnonzero(~straddles)
    if len(whole):
        yield _Parts(_Pattern(SQUARE), *_over(whole, sides[:, whole].mean(axis=0)))
    # The quad's diagonal is one of the tile's.
    for diagonal in (0, 1):
        own = np.flatnonzero(straddles & ((np.abs(sides[0]) > SAME_PLACE) == bool(diagonal)))
        for triangle in QUAD_TRIANGLES[diagonal]:
            if len(own):
                middles = sides[:, own][triangle].mean(axis=0)
                yield _Parts(_Pattern(SQUARE[triangle]), *_over(own, middles))


def _over(chosen: IndexArray, sides: FloatArray) -> tuple[IndexArray, IndexArray]:
    return chosen, (sides < 0).astype(np.intp)
