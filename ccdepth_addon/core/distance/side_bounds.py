# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of the curves of pieces over closed sides, and over sides to leaves compared at equal parameters or by a map.
docs/distance.md, Closed sides and Lemma 10.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, dot_products, lengths, selected_vectors, squared_norms, units
from .beside_bounds import RANGE_FOR_HEIGHT, Beyond
from .corner_bounds import bounds_near_corner
from .framed_pieces import ON_VECTOR, ROUNDING, FramedPieces, Side, are_in_front, slid_along
from .piece_hulls import CORNERS_OF, SIDES, Pieces, are_alike, off_at_equal
from .shells import Shell

# A relative margin of coordinates, above the rounding of points of triangles.
COORDINATE_ROUNDING = 2.0**-48


@dataclass(frozen=True)
class Beside:
    """The sides of M triangles with another comparison beyond. at_equal: (M, 3), bounds of the distance between surface
    and triangles beyond a side at equal parameters; infinite at other sides. are_mapped: (M, 3) bool, whether the
    surface beyond is mapped onto the triangles of its leaf, each side of a triangle onto itself."""

    at_equal: FloatArray
    are_mapped: BoolArray


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def raised_at_sides(shell: Shell, pieces: Pieces, bounds: FloatArray, beside: Beside | None) -> FloatArray:
    """(P,): the bounds (P,) of pieces, raised to the bounds of their curves over closed sides, and over sides to
    another comparison."""
    raised, is_closed = bounds.copy(), shell.triangles.is_closed
    if beside is None:
        beside = Beside(np.full(is_closed.shape, np.inf), np.zeros_like(is_closed))
    is_counted = is_closed | beside.are_mapped | np.isfinite(beside.at_equal)
    which, turns, curves = _curves_on(shell, pieces, np.isfinite(bounds)[:, None] & is_counted[pieces.triangles])
    closed, mapped = is_closed[curves.triangles, turns], beside.are_mapped[curves.triangles, turns]

    def raise_to(bound: Callable[[Pieces, IndexArray, FloatArray], FloatArray], chosen: BoolArray) -> None:
        if len(some := np.flatnonzero(chosen)):
            np.maximum.at(raised, which[some], bound(curves.at(some), turns[some], bounds[which[some]]))

    def to_map(own: Pieces, sides: IndexArray, within: FloatArray) -> FloatArray:
        return _bridge_bounds(shell, _with_whole_sides(shell, own, sides), sides, within, off_at_equal(own))

    def to_equal(own: Pieces, sides: IndexArray, within: FloatArray) -> FloatArray:
        off = np.minimum(off_at_equal(own), beside.at_equal[own.triangles, sides])
        return _bridge_bounds(shell, own, sides, within, off)

    raise_to(lambda own, sides, _: _closed_bounds(shell, own, sides), closed)
    raise_to(to_map, mapped)
    raise_to(to_equal, ~closed & ~mapped)
    return raised


def _with_whole_sides(shell: Shell, curves: Pieces, turns: IndexArray) -> Pieces:
    """The curves with their whole sides for drawn points, in the curves' direction: images are anywhere there."""
    start, end = (component_major(shell.triangles.corners[curves.triangles, (turns + k) % 3]) for k in (0, 1))
    is_turned = dot_products(curves.flats[-1] - curves.flats[0], end - start) < 0
    first, last = (np.where(is_turned[:, None], *each) for each in ((end, start), (start, end)))
    shares = np.linspace(0.0, 1.0, len(curves.flats))[:, None, None]
    return Pieces(curves.triangles, curves.hulls, first + shares * (last - first))


def _curves_on(shell: Shell, pieces: Pieces, counted: BoolArray) -> tuple[IndexArray, IndexArray, Pieces]:
    """The curves of pieces over counted sides (P, 3) of their triangles: (n,) the piece of each curve, and its side."""
    sides, starts = SIDES[len(pieces.flats)], CORNERS_OF[len(pieces.flats)]
    which, turns, curves = [], [], []
    for turn in range(3):
        chosen = np.flatnonzero(counted[:, turn])
        are_on = _are_on_side(shell, pieces.triangles[chosen], turn, selected_vectors(pieces.flats[starts], chosen))
        for start, end, rows in sides:
            own = chosen[are_on[starts.index(start)] & are_on[starts.index(end)]]
            hulls = pieces.hulls[rows] if are_alike(pieces) else pieces.hulls
            which.append(own)
            turns.append(np.full(len(own), turn))
            curves.append(Pieces(pieces.triangles, hulls, pieces.flats[rows]).at(own))
    return np.concatenate(which), np.concatenate(turns), curves[0].joined(curves[1:])


def _are_on_side(shell: Shell, triangles: IndexArray, side: int, points: FloatArray) -> BoolArray:
    """(n, P) bool: whether drawn points (n, P, 3) are on a side of their triangles."""
    corners = component_major(shell.triangles.corners[triangles].swapaxes(0, 1))
    along = corners[(side + 1) % 3] - corners[side]
    away, way = points - corners[side], units(along)
    off = lengths(away - dot_products(away, way)[..., None] * way)
    # Far from the origin, rounding moves points off a side; counting one too many does no harm.
    return off <= ON_VECTOR * lengths(along) + COORDINATE_ROUNDING * np.abs(corners).max(axis=(0, 2))


def _seen_curves(shell: Shell, curves: Pieces, turns: IndexArray) -> FramedPieces:
    """The curves in frames in which their sides count as side 0."""
    return FramedPieces.of(shell, curves, turns, [0, len(curves.hulls) - 1] if are_alike(curves) else [])


def _bridge_bounds(shell: Shell, curves: Pieces, turns: IndexArray, bounds: FloatArray, off: FloatArray) -> FloatArray:
    """(P,): bounds of the distance between points of curves over sides and all places on their paths. bounds: (P,), of
    the pieces of the curves. off: (P,), what counts besides where paths may leave both triangles at the side."""
    own = curves.triangles
    seen = _seen_curves(shell, curves, turns)
    thin = RANGE_FOR_HEIGHT * seen.heights / shell.cosines[own]
    ranges = np.where(bounds <= thin, np.minimum(thin, shell.ranges[own]), shell.ranges[own])
    sides = [Side.of(seen, side, ranges) for side in range(3)]
    beyond = Beyond.of(shell, seen, 0, sides[0], ranges)
    there = beyond.heights.max(axis=0) / shell.cosines[beyond.across]
    straight = np.maximum(there, seen.heights / shell.cosines[own])
    stays = are_in_front(seen, sides) & sides[1].stays_inside() & sides[2].stays_inside() & (straight <= ranges)
    stays &= sides[0].stays_inside() | beyond.are_placed
    found: FloatArray = np.where(stays, straight, bounds + off)
    return found


def _closed_bounds(shell: Shell, curves: Pieces, turns: IndexArray) -> FloatArray:
    """(P,): bounds of the distance between points of curves over closed sides and the points that follow along these
    sides."""
    own, ranges = curves.triangles, shell.ranges[curves.triangles]
    seen = _seen_curves(shell, curves, turns)
    along, from_start = seen.sides[0], seen.points
    part = dot_products(from_start, along) / np.maximum(squared_norms(along), 1e-300)
    off = lengths(from_start - np.clip(part, 0.0, 1.0)[..., None] * along).max(axis=0)
    bounds = np.hypot(off, slid_along(seen, 0, ranges)) * (1 + ROUNDING)
    # The walls of the other two sides, seen from the ends of this side.
    following, before = Side.of(seen, 1, ranges), Side.of(seen, 2, ranges)
    placed = following.are_inside[0].all(axis=0) & before.are_inside[1].all(axis=0)
    bounds = np.where(placed, bounds, np.inf)
    for corner in range(3):
        at_border = shell.is_border[shell.triangles.vertices[own, corner]]
        bounds = np.minimum(
            bounds, np.where(at_border, bounds_near_corner(shell, curves, corner, at_side=True), np.inf)
        )
    return bounds
