# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances between the surface over a level's quads and the triangles that these are drawn as.

Of every quad two bounds: by places in the shell, and at equal parameters. docs/distance.md, Quads of a level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, selected_vectors, transformed_nets
from ..bounds.norm_bounds import Vertices
from ..surface.refinement import Refinement
from ..surface.squares import SQUARE, Squares
from ..surface.triangle_coefficients import coefficients_over
from .leaf_surfaces import ALL_LEVELS, FEW_LEVELS, Tiles, joined_tiles, tiles_of
from .level_quads import may_be_folded
from .piece_hulls import Pieces, off_at_equal
from .pieces import HULL_FORM, SQUARE_FORM, TRIANGLE_FORM, Form, include_pieces
from .shells import QUAD_TRIANGLES, Shell, Triangles, vertex_vectors

# Quads whose tiles are looked at together, and pieces of these.
QUADS_AT_ONCE, PIECES_AT_ONCE = 1 << 12, 1 << 12

# A level too many makes four times the faces: a quad is given up only where more pieces are open than on a curve.
MOST_GROWTH = 3.0

GREVILLE = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])

# (2, 2, 2, 2): for each triangle of a quad, from parameters seen from its first corner to weights of the other two.
SIDES_THERE = SQUARE[QUAD_TRIANGLES[..., 1:]] - SQUARE[QUAD_TRIANGLES[..., :1]]
TRIANGLE_AXES = np.linalg.inv(SIDES_THERE)

# Places are sums of powers of a half: what is nearer than this is there.
SAME_PLACE = 2.0**-40


@dataclass(frozen=True)
class Leaves:
    """Quads of a level, the descendants of a refinement, and the triangles that they are drawn as.

    points: (K, 4, 3), their corners as drawn. is_turned: (K,) bool, whether they are drawn with the diagonal from
    corner 1 to 3; is_folded: (K,) bool, whether it may be the other one. limit: no larger distance is of use.
    """

    refinement: Refinement
    points: FloatArray
    is_turned: BoolArray
    is_folded: BoolArray
    shell: Shell
    limit: float

    @staticmethod
    def of(
        refinement: Refinement,
        is_turned: BoolArray,
        vertices: Vertices,
        limit: float,
        axes: FloatArray | None = None,
    ) -> Leaves:
        """axes: of the object's space, where diagonals are chosen."""
        mesh, numbers = refinement.mesh, refinement.corner_vertices()
        limits, errors = refinement.limits_at_corners, None
        points = limits
        if vertices is Vertices.CONTROL:
            points = mesh.positions[numbers]
            errors = np.zeros_like(mesh.positions)
            errors[numbers] = points - limits
        points = points.reshape(-1, 4, 3)
        triangles = Triangles.of(mesh, points, vertex_vectors(mesh, errors), is_turned)
        faces = np.bincount(mesh.corner_vertices[: points.size // 3], minlength=mesh.vertex_count)
        shell = Shell.of(triangles, faces == mesh.vertex_face_counts, limit)
        return Leaves(refinement, points, is_turned, may_be_folded(points, is_turned, axes), shell, limit)

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

    def _by_places(self, quads: IndexArray, levels: int = FEW_LEVELS) -> FloatArray:
        """levels: as of ``tiles_of``: all of them where few leave too large a rest."""
        found = np.where(self.shell.ranges[2 * quads] * self.shell.ranges[2 * quads + 1] > 0, 0.0, np.inf)
        bicubic, rests = self._tiles(quads, levels)
        self._include(found, quads, bicubic)
        is_open = np.isfinite(found)
        for tiles in rests:
            self._include(found, quads, tiles)
        again = np.flatnonzero(is_open & ~np.isfinite(found))
        if levels < ALL_LEVELS and len(again):
            found[again] = self._by_places(quads[again], ALL_LEVELS)
        return np.where(found <= self.limit, found, np.inf)

    def _tiles(self, quads: IndexArray, levels: int) -> tuple[Tiles, list[Tiles]]:
        """The bicubic tiles of some quads, rising, and the others."""
        wanted = np.zeros(len(self.refinement.bases), dtype=bool)
        wanted[quads] = True
        tiles = list(tiles_of(self.refinement.keep(wanted).numbered(), levels))
        return joined_tiles([each for each in tiles if each.are_bicubic]), [
            each for each in tiles if not each.are_bicubic
        ]

    def _pieces(self, quads: IndexArray, tiles: Tiles, found: FloatArray) -> Iterator[tuple[IndexArray, Pieces, Form]]:
        """Pieces of the tiles of some quads, with the quad of each and their form. found: (n,), not those of quads
        where this is infinite."""
        for parts in _parts(tiles, self.is_turned[quads]):
            bases = tiles.squares.bases[parts.chosen]
            for some in index_chunks(np.arange(len(bases)), PIECES_AT_ONCE):
                some = some[np.isfinite(found[bases[some]])]
                if not len(some):
                    continue
                own, chosen, over = bases[some], parts.chosen[some], parts.triangles[some]
                hulls = _hulls(parts.rows, selected_vectors(tiles.points, chosen))
                flats = self._drawn(tiles.squares.at(chosen), parts.places, quads[own], over)
                yield own, Pieces(2 * quads[own] + over, hulls, flats), parts.form

    def _include(self, found: FloatArray, quads: IndexArray, tiles: Tiles) -> None:
        """Raise what is found (n,) of quads to the bounds of pieces of tiles, divided where that is needed."""
        for bases, pieces, form in self._pieces(quads, tiles, found):
            include_pieces(self.shell, found, bases, pieces, form, self.limit, growth=MOST_GROWTH)

    def _drawn(self, squares: Squares, places: FloatArray, quads: IndexArray, triangles: IndexArray) -> FloatArray:
        """(R, n, 3): the points, or in its plane beyond, of a triangle of each quad, at places (R, 2) in squares."""
        at = squares.origins[:, None] + places @ squares.axes
        which = (self.is_turned[quads].astype(np.intp), triangles)
        order = QUAD_TRIANGLES[which]
        weights = np.matmul(at - SQUARE[order[:, :1]], TRIANGLE_AXES[which])
        first, second, third = (self.points[quads, order[:, corner]] for corner in range(3))
        found = first[:, None] + np.matmul(weights, np.stack([second - first, third - first], axis=1))
        return component_major(found.swapaxes(0, 1))

    def at_equal_parameters(self, quads: IndexArray, levels: int = FEW_LEVELS) -> FloatArray:
        """(n,): of some quads, rising; of those that may be folded the larger one of both diagonals. levels: as of
        ``_by_places``."""
        bicubic, rests = self._tiles(quads, levels)
        found = self._off_at_equal(quads, [bicubic])
        is_open = found <= self.limit
        found = np.maximum(found, self._off_at_equal(quads, rests))
        again = np.flatnonzero(is_open & (found > self.limit))
        if levels < ALL_LEVELS and len(again):
            found[again] = self.at_equal_parameters(quads[again], ALL_LEVELS)
        return found

    def _off_at_equal(self, quads: IndexArray, tiles: list[Tiles]) -> FloatArray:
        """(n,): the largest distance at equal parameters in tiles of some quads."""
        found = np.zeros(len(quads))
        is_folded = self.is_folded[quads]
        ways = [(self, found)]
        if np.any(is_folded):
            ways.append((replace(self, is_turned=~self.is_turned), np.where(is_folded, 0.0, np.inf)))
        for leaves, looked_at in ways:
            for each in tiles:
                for bases, pieces, form in leaves._pieces(quads, each, looked_at):
                    if form.quarters:
                        bases, pieces = np.tile(bases, 4), pieces.divided(form.quarters)
                    np.maximum.at(found, bases, off_at_equal(pieces))
        return found


@dataclass(frozen=True)
class _Parts:
    """Parts of tiles that lie over one triangle each. rows: (R, 16), their hull points from the tiles' coefficients, or
    None for all points of the tiles; places: (R', 2), parameters in the square at which what is drawn has the same
    coefficients, or of its corners. chosen: (n,) intp, of the tiles; triangles: (n,) intp, which of their quads'
    two."""

    form: Form
    rows: FloatArray | None
    places: FloatArray
    chosen: IndexArray
    triangles: IndexArray


def _hulls(rows: FloatArray | None, points: FloatArray) -> FloatArray:
    """(R, n, 3): hull points of parts of tiles (R', n, 3)."""
    return points if rows is None else transformed_nets(rows, points)


def _parts(tiles: Tiles, is_turned: BoolArray) -> Iterator[_Parts]:
    """Of all tiles. is_turned: of their quads."""
    turned = is_turned[tiles.squares.bases]
    u, v = np.moveaxis(tiles.squares.corners(), 2, 0)
    # Positive over the quad's first triangle.
    sides = np.where(turned, u + v - 1, u - v)
    straddles = (sides.min(axis=0) < -SAME_PLACE) & (sides.max(axis=0) > SAME_PLACE)
    if not tiles.are_bicubic:
        # At a corner that both triangles have, a hull is over either.
        both = np.flatnonzero(straddles)
        first = _over(np.arange(len(turned)), sides.mean(axis=0))
        for chosen, triangles in (first, (both, np.ones(len(both), dtype=np.intp))):
            yield _Parts(HULL_FORM, None, SQUARE, chosen, triangles)
        return
    whole = np.flatnonzero(~straddles)
    yield _Parts(SQUARE_FORM, None, GREVILLE, *_over(whole, sides[:, whole].mean(axis=0)))
    # The quad's diagonal is one of the tile's.
    for diagonal in (0, 1):
        own = np.flatnonzero(straddles & ((np.abs(sides[0]) > SAME_PLACE) == bool(diagonal)))
        for triangle in QUAD_TRIANGLES[diagonal]:
            rows = coefficients_over(SQUARE[triangle])
            yield _Parts(TRIANGLE_FORM, rows, rows @ GREVILLE, *_over(own, sides[:, own][triangle].mean(axis=0)))


def _over(chosen: IndexArray, sides: FloatArray) -> tuple[IndexArray, IndexArray]:
    return chosen, (sides < 0).astype(np.intp)
