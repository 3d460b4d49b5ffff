# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of pieces over any of the triangles at a corner, or around their own triangle. docs/distance.md, Lemma 8."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.ranges import ranges as ranges_of
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, dot_products, lengths, selected_vectors
from .framed_pieces import ROUNDING
from .piece_hulls import Pieces, all_points
from .shells import Shell

# Near a corner, heights over all planes are bounded together while the bound is at most this part of the range.
NEAR_ENOUGH = 0.1

# Above this number of triangles at a vertex, heights are only bounded together.
MANY_AROUND = 64

# The number of pieces in a chunk that are compared with the triangles around.
PIECES_AT_ONCE = 1 << 10


def bounds_near_corner(shell: Shell, pieces: Pieces, corner: int, *, at_side: bool = False) -> FloatArray:
    """(P,): bounds for pieces near enough to a corner to be over some of the triangles there; infinite for other
    pieces. at_side: whether points of closed sides follow the pieces, as over flaps."""
    triangles, own = shell.triangles, pieces.triangles
    vertices = triangles.vertices[own, corner]
    at = component_major(triangles.corners[own, corner])
    distances = np.maximum(*(lengths(each - at).max(axis=0) for each in (pieces.hulls, pieces.flats)))
    bounds = np.full(len(own), np.inf)
    near = np.flatnonzero((distances < shell.radii[vertices]) & (shell.ranges[own] > 0))
    if not len(near):
        return bounds
    some, vertices, distances = pieces.at(near), vertices[near], distances[near]
    seen = all_points(some) - at[near]
    starts, counts, ranges = shell.star_starts[vertices], np.diff(shell.star_starts)[vertices], shell.ranges[own[near]]
    # Each normal is the sum of the mean normal and a vector no longer than the spread.
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
    """(P,) bool: whether hulls of points (R, P, 3), seen from vertices, may meet prisms of flaps there. distances:
    (P,), of the farthest points from the vertices."""
    meets, ends = shell.is_border[vertices], shell.star_starts[vertices + 1]
    chosen = np.flatnonzero(meets)
    meets[chosen], place = False, 1
    while len(chosen):
        # Flaps come last. Their first side is the closed one, and their prisms are within the wall's thickness of it.
        flaps = shell.star_triangles[ends[chosen] - place]
        is_flap = flaps >= len(shell.triangles.vertices)
        chosen, flaps, place = chosen[is_flap], flaps[is_flap], place + 1
        thick = shell.slopes[0, flaps] * ranges[chosen] * (1 + ROUNDING)
        reached = dot_products(selected_vectors(seen, chosen), shell.planes[0, flaps]).max(axis=0, initial=-np.inf)
        meets[chosen] |= reached >= -(thick + ROUNDING * distances[chosen])
        chosen = chosen[(ends[chosen] - place >= shell.star_starts[vertices[chosen]]) & ~meets[chosen]]
    found: BoolArray = meets
    return found


def bounds_around(shell: Shell, pieces: Pieces) -> FloatArray:
    """(P,): bounds for pieces over triangles that share a corner with their own, over all triangles within the piece's
    reach; infinite for other pieces."""
    own, vertices = pieces.triangles, shell.triangles.vertices[pieces.triangles]
    is_left_out = np.any(shell.is_border[vertices] | (np.diff(shell.star_starts)[vertices] > MANY_AROUND), axis=1)
    found = np.where((shell.ranges[own] > 0) & ~is_left_out, 0.0, np.inf)
    possible = np.flatnonzero(np.isfinite(found))
    if not len(possible):
        return found
    triangles, which = np.unique(own[possible], return_inverse=True)
    prisms, points = _Prisms.of(shell, triangles), all_points(pieces)
    for some in index_chunks(np.arange(len(possible)), PIECES_AT_ONCE):
        chosen, centre = possible[some], which.reshape(-1)[some]
        seen = selected_vectors(points, chosen) - component_major(shell.triangles.corners[own[chosen], 0])
        bounds, ranges = np.zeros(len(some)), shell.ranges[own[chosen]]
        for place in range(int(np.diff(prisms.starts)[centre].max())):
            left = np.flatnonzero((bounds <= ranges) & (place < np.diff(prisms.starts)[centre]))
            bounds[left] = np.maximum(
                bounds[left], prisms.bounds(prisms.starts[centre[left]] + place, selected_vectors(seen, left))
            )
        found[chosen] = np.where(bounds <= ranges, bounds, np.inf)
    return found


@dataclass(frozen=True)
class _Prisms:
    """The prisms of triangles that share a corner with others, seen from corner 0 of these. starts: (T + 1,), the first
    prism of each of T triangles. planes: (4, N, 3), the unit normals of the planes through the sides, inwards, and of
    the triangle; offsets: (4, N), the components of these planes along their normals. margins: (3, N), the walls'
    distances from their planes, with rounding; are_outer: (3, N) bool, whether no corner of the triangle in the middle
    is on a side. cosines: (N,), as of ``Shell``."""

    starts: IndexArray
    planes: FloatArray
    offsets: FloatArray
    margins: FloatArray
    are_outer: BoolArray
    cosines: FloatArray

    @staticmethod
    def of(shell: Shell, triangles: IndexArray) -> _Prisms:
        """The prisms around triangles (T,) of a shell, as thick as the ranges of the triangles in the middle."""
        every = shell.triangles
        at = every.vertices[triangles].ravel()
        counts = np.diff(shell.star_starts)[at]
        around = shell.star_triangles[ranges_of(shell.star_starts[at], counts)]
        owners = np.repeat(np.repeat(np.arange(len(triangles)), 3), counts)
        owners, around = np.divmod(np.unique(owners * len(every.corners) + around), len(every.corners))
        middle = triangles[owners]
        planes = selected_vectors(shell.planes, around)
        corners = every.corners[around][:, [0, 1, 2, 0]].swapaxes(0, 1) - every.corners[middle, 0]
        sides = every.corners[middle, 1:].swapaxes(0, 1) - every.corners[middle, 0]
        sizes = lengths(np.concatenate([corners, sides])).max(axis=0) + shell.ranges[middle]
        is_inner = (every.vertices[around][:, :, None] == every.vertices[middle][:, None]).any(axis=2).T
        return _Prisms(
            np.searchsorted(owners, np.arange(len(triangles) + 1)),
            planes,
            dot_products(corners, planes),
            shell.slopes[:, around] * shell.ranges[middle] * (1 + ROUNDING) + ROUNDING * sizes,
            ~is_inner & ~is_inner[[1, 2, 0]],
            shell.cosines[around],
        )

    def bounds(self, prisms: IndexArray, points: FloatArray) -> FloatArray:
        """(n,): bounds for hulls of points (R, n, 3) over the triangle of one prism (n,) each: 0 where the hull does
        not meet the prism, and infinite where it may leave all prisms there."""
        seen = (
            dot_products(points, selected_vectors(self.planes[plane], prisms)) - self.offsets[plane, prisms]
            for plane in range(4)
        )
        meets, stays = np.ones((2, len(prisms)), dtype=bool)
        for side in range(3):
            heights, margin = next(seen), self.margins[side, prisms]
            meets &= heights.max(axis=0) >= -margin
            stays &= ~self.are_outer[side, prisms] | (heights.min(axis=0) > margin)
        bounds = np.abs(next(seen)).max(axis=0) / self.cosines[prisms]
        return np.where(meets, np.where(stays, bounds, np.inf), 0.0)
