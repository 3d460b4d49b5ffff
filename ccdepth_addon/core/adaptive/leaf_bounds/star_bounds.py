# SPDX-License-Identifier: GPL-3.0-or-later
"""Error bounds where sliding along the surface costs nothing (docs/adaptive.md, Along the surface).

At equal parameters a point of the surface is off a triangle along its normal, and across it. Where the triangles
around are nearly in one plane, the error across hardly matters: another point of the mesh, or of the surface, is
nearer. Let τ be a triangle, and all triangles at a vertex of it be tilted against it by Θ at most and off by at most N
along their normals and by T across them. In the third of τ that is nearest to that vertex, both distances, from τ to
the surface and from the surface over τ to the mesh, are at most

    N / cos Θ + 2 tan Θ (T + N sin Θ)

provided that the triangles around the vertex close up to a disc, go round it once as seen along τ's normal, and are
wide enough: T + N is less than a third of cos Θ times the least of their heights over the vertex.

Where the stars are not wide enough, as around poles in nearly flat places, those of the vertices beside may be added,
and so on, ring by ring: then the conditions have to hold for each of these stars, Θ, N and T are the largest of all,
and each ring adds half the least height over one of its vertices (docs/adaptive.md, Wider stars).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...arrays.chunks import AT_ONCE, chunks
from ...arrays.types import BoolArray, FloatArray, IndexArray, ShortIndexArray

# The bound is of no use between steeper triangles.
LEAST_COSINE = 0.25

# Allowances for the rounding of an angle or a ratio; and of the error across, which is the root of a difference of
# squares, in parts of the whole error (docs/adaptive.md, Rounding).
ROUNDING = 1e-9
ROUNDING_ACROSS = 2.0**-24

# The factor of rounding along the normals and across, as it may turn the normals as well.
TURNED = 2.0

# The least sine of the angle at a triangle's second corner: rounding spoils the normals of thinner ones.
THINNEST = 1e-6


# At degenerate triangles, and where normals cancel, there is nothing to divide by.
@np.errstate(divide="ignore", invalid="ignore")
def star_bounds(
    positions: FloatArray,
    triangles: IndexArray | ShortIndexArray,
    normal: FloatArray,
    tangential: FloatArray,
    closed: BoolArray,
    wanted: BoolArray,
    rounding: float = 0.0,
    rings: int = 1,
) -> StarBounds:
    """Of the wanted triangles.

    positions: (V, 3); triangles: (T, 3); normal, tangential: (T,), error bounds at equal parameters. closed: (V,)
    whether all the triangles around a vertex are there and close up to a disc. wanted: (T,) bool. rounding: the
    allowance for error bounds and positions (docs/adaptive.md, Rounding). rings: how many the stars have at most; the
    best bound counts.
    """
    count = len(positions)
    corners, columns = np.ascontiguousarray(triangles.T), np.ascontiguousarray(positions.T)
    directions = np.empty((3, len(triangles)))
    turns, widths, tilts = np.zeros(count), np.full(count, np.inf), np.full(count, -np.inf)
    for block in chunks(len(triangles), AT_ONCE):
        directions[:, block], heights, angles = _shapes(columns[:, corners[:, block]])
        for vertices, of_height, of_angle in zip(corners[:, block], heights, angles, strict=True):
            np.minimum.at(widths, vertices, of_height)
            np.add.at(turns, vertices, of_angle)
    axes = np.stack([_sums_at(corners, component, count) for component in directions])
    axes /= np.sqrt(np.sum(axes * axes, axis=0))

    # (3, T): for each triangle, its normal, and then its tilts at each of its corners.
    for block in chunks(len(triangles), AT_ONCE):
        own = corners[:, block]
        directions[:, block] = _angles(directions[:, None, block], axes[:, own])
        for vertices, of_corner in zip(own, directions[:, block], strict=True):
            np.maximum.at(tilts, vertices, of_corner)
    stars = _Stars(
        tilts=tilts,
        turns=np.where(closed, turns, np.inf),
        widths=widths,
        beside=np.zeros(count),
        normal=_largest_at(corners, normal, count) + TURNED * rounding,
        tangential=_largest_at(corners, tangential, count) + TURNED * rounding,
    )
    edges = _edges(corners) if rings > 1 else np.zeros((2, 0), dtype=np.intp)
    between = _angles(axes[:, edges[0]], axes[:, edges[1]])
    chosen = np.flatnonzero(wanted)
    found = np.full((2, 3, len(chosen)), np.inf)
    for ring in range(rings):
        stars = stars.wider(edges, between) if ring else stars
        for block in chunks(len(chosen), AT_ONCE):
            own = chosen[block]
            of_stars = stars.bounds(corners[:, own], directions[:, own])
            np.minimum(found[:, :, block], of_stars, out=found[:, :, block])
    return StarBounds(*found.max(axis=1))


@dataclass(frozen=True)
class StarBounds:
    """(triangles,) float64 each: upper bounds of the distance in both directions, inf where the conditions fail; and
    what they would be if all stars were wide enough."""

    bounds: FloatArray
    with_room: FloatArray


@dataclass(frozen=True)
class _Stars:
    """The stars of V vertices, of one ring of triangles or several. (V,) each: the largest tilt of triangles against
    the mean of the normals at the vertex; the largest sum of angles at a vertex inside, inf if some do not close up to
    a disc; the largest error bounds along the triangles' normals and across. widths: the least height over the vertex.
    beside: half the least heights over vertices of further rings, in sum, on the shortest way to the border."""

    tilts: FloatArray
    turns: FloatArray
    widths: FloatArray
    beside: FloatArray
    normal: FloatArray
    tangential: FloatArray

    def wider(self, edges: IndexArray, between: FloatArray) -> _Stars:
        """With one ring more. edges: (2, E), of all triangles; between: (E,) the angles between the mean normals at
        their ends."""
        ways = self.widths / 2 + self.beside
        beside = np.full(len(ways), np.inf)
        tilts, turns, normal, tangential = (
            of_stars.copy() for of_stars in (self.tilts, self.turns, self.normal, self.tangential)
        )
        for start, end in (edges, edges[::-1]):
            np.minimum.at(beside, start, ways[end])
            np.maximum.at(tilts, start, self.tilts[end] + between)
            np.maximum.at(turns, start, self.turns[end])
            np.maximum.at(normal, start, self.normal[end])
            np.maximum.at(tangential, start, self.tangential[end])
        return _Stars(tilts, turns, self.widths, beside, normal, tangential)

    def bounds(self, corners: IndexArray, tilts: FloatArray) -> FloatArray:
        """(2, 3, n): those of triangles with corners (3, n), tilted by (3, n) at each, as in ``StarBounds``.

        NaN meets no condition.
        """
        off_normal, off_across = self.normal[corners], self.tangential[corners]
        off_across = off_across + ROUNDING_ACROSS * (off_normal + off_across)
        angles = np.minimum(self.tilts[corners] + tilts + ROUNDING, np.pi / 2)
        cosines, sines = np.cos(angles), np.sin(angles)
        flat = (cosines > LEAST_COSINE) & (self.turns[corners] < 4 * np.pi * cosines * (1 - ROUNDING))
        room = (self.widths[corners] / 3 + self.beside[corners]) * (1 - ROUNDING)
        wide = off_across + off_normal < cosines * room
        cosines = np.where(flat, cosines, 1.0)
        bounds = (off_normal / cosines + 2 * sines / cosines * (off_across + off_normal * sines)) * (1 + ROUNDING)
        return np.stack([np.where(flat & wide, bounds, np.inf), np.where(flat, bounds, np.inf)])


def _angles(directions: FloatArray, axes: FloatArray) -> FloatArray:
    """(…): between unit vectors (3, …). By the chords, as cosines cannot resolve small angles."""
    chords = axes - directions
    chords *= chords
    halves = np.sqrt(chords.sum(axis=0)) / 2
    return 2 * np.arcsin(np.minimum(halves, 1.0))


def _edges(corners: IndexArray) -> IndexArray:
    """(2, E): the edges of triangles with corners (3, T), each once."""
    ends = np.stack([corners.ravel(), np.roll(corners, -1, axis=0).ravel()]).astype(np.intp)
    count = int(ends.max(initial=0)) + 1
    return np.stack(np.divmod(np.unique(ends.min(axis=0) * count + ends.max(axis=0)), count))


def _shapes(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of triangles with corners (3, 3, T), coordinate by coordinate: their normals (3, T); and corner by corner (3, T)
    their heights and angles there. The heights of triangles that are too thin are 0."""
    sides = [points[:, 1] - points[:, 0], points[:, 2] - points[:, 1], points[:, 0] - points[:, 2]]
    crosses = np.stack([sides[0][i] * sides[1][j] - sides[0][j] * sides[1][i] for i, j in ((1, 2), (2, 0), (0, 1))])
    doubled = np.sqrt(_products(crosses, crosses))
    heights = np.stack(
        [doubled / np.sqrt(_products(opposite, opposite)) for opposite in (sides[1], sides[2], sides[0])]
    )
    angles = np.empty_like(heights)
    for corner in (0, 1):
        np.arctan2(doubled, -_products(sides[corner], sides[corner - 1]), out=angles[corner])
    angles[2] = np.pi - angles[0] - angles[1]
    heights[:, np.sin(angles[1]) < THINNEST] = 0.0
    return crosses / doubled, heights, angles


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    """(T,) the dot products of vectors (3, T)."""
    return np.einsum("it,it->t", a, b)


def _sums_at(corners: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """(count,) the sum of the values (T,) of the triangles at each vertex."""
    sums = np.zeros(count)
    for vertices in corners:
        sums += np.bincount(vertices, values, count)
    return sums


def _largest_at(corners: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """(count,) the largest of the values (T,) of the triangles at each vertex."""
    largest = np.full(count, -np.inf)
    for vertices in corners:
        np.maximum.at(largest, vertices, values)
    return largest
