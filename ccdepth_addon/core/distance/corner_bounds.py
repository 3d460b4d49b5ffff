# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of pieces over any of the triangles at a corner, or around their own triangle. docs/distance.md, Lemma 8."""

from __future__ import annotations

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.ranges import ranges as ranges_of
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import component_major, dot_products, lengths, selected_vectors
from .framed_pieces import ROUNDING, wall_plane
from .piece_hulls import Pieces, all_points
from .shells import Shell

# Near a corner, heights over all planes are bounded together while the bound is at most this part of the range.
NEAR_ENOUGH = 0.1

# Above this number of triangles at a vertex, heights are only bounded together.
MANY_AROUND = 64

# The number of pairs of pieces and triangles in a chunk.
PAIRS_AT_ONCE = 1 << 10


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
        inwards, thick = wall_plane(shell, flaps, 0, ranges[chosen])
        reached = dot_products(selected_vectors(seen, chosen), inwards).max(axis=0, initial=-np.inf)
        meets[chosen] |= reached >= -(thick + ROUNDING * distances[chosen])
        chosen = chosen[(ends[chosen] - place >= shell.star_starts[vertices[chosen]]) & ~meets[chosen]]
    found: BoolArray = meets
    return found


def bounds_around(shell: Shell, pieces: Pieces) -> FloatArray:
    """(P,): bounds for pieces over triangles that share a corner with their own, over all triangles within the piece's
    reach; infinite for other pieces."""
    own, vertices = pieces.triangles, shell.triangles.vertices[pieces.triangles]
    points = all_points(pieces)
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
    """(n,) bool twice: whether hulls of points (R, n, 3) may meet the prisms of triangles (n,); and whether the hulls
    are on the inner side of all walls there without one of the given vertices (n, 3)."""
    meets, stays = np.ones((2, len(triangles)), dtype=bool)
    numbers = shell.triangles.vertices[triangles]
    is_around = (numbers[:, :, None] == vertices[:, None]).any(axis=2)
    for side in range(3):
        inwards, margin = wall_plane(shell, triangles, side, ranges)
        seen = dot_products(points - component_major(shell.triangles.corners[triangles, side]), inwards)
        meets &= np.any(seen >= -margin, axis=0)
        is_outer = ~is_around[:, side] & ~is_around[:, (side + 1) % 3]
        stays &= ~is_outer | np.all(seen > margin, axis=0)
    return meets, stays
