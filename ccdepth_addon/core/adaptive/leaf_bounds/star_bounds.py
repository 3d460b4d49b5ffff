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
) -> FloatArray:
    """(wanted triangles,) float64: upper bounds of the distance in both directions; inf where the conditions fail.

    positions: (V, 3); triangles: (T, 3); normal, tangential: (T,), error bounds at equal parameters. closed: (V,)
    whether all the triangles around a vertex are there and close up to a disc. wanted: (T,) bool. rounding: the
    allowance for error bounds and positions (docs/adaptive.md, Rounding).
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
    around = _Stars(
        tilts=tilts,
        turns=turns,
        widths=widths,
        normal=_largest_at(corners, normal, count) + TURNED * rounding,
        tangential=_largest_at(corners, tangential, count) + TURNED * rounding,
        closed=closed,
    )
    chosen = np.flatnonzero(wanted)
    found = np.empty(len(chosen))
    for block in chunks(len(chosen), AT_ONCE):
        own = chosen[block]
        found[block] = around.bounds(corners[:, own], directions[:, own])
    return found


@dataclass(frozen=True)
class _Stars:
    """The stars of V vertices, (V,) each: the largest tilt of the triangles against the mean of their normals, the sum
    of their angles, the least of their heights, their error bounds along their normals and across, and whether they
    close up to a disc."""

    tilts: FloatArray
    turns: FloatArray
    widths: FloatArray
    normal: FloatArray
    tangential: FloatArray
    closed: BoolArray

    def bounds(self, corners: IndexArray, tilts: FloatArray) -> FloatArray:
        """(n,) the bounds of triangles with corners (3, n), tilted by (3, n) at each.

        NaN meets no condition.
        """
        off_normal, off_across = self.normal[corners], self.tangential[corners]
        off_across = off_across + ROUNDING_ACROSS * (off_normal + off_across)
        angles = np.minimum(self.tilts[corners] + tilts + ROUNDING, np.pi / 2)
        cosines, sines = np.cos(angles), np.sin(angles)
        holds = (cosines > LEAST_COSINE) & self.closed[corners]
        holds &= self.turns[corners] < 4 * np.pi * cosines * (1 - ROUNDING)
        holds &= off_across + off_normal < cosines * self.widths[corners] / 3 * (1 - ROUNDING)
        cosines = np.where(holds, cosines, 1.0)
        bounds = off_normal / cosines + 2 * sines / cosines * (off_across + off_normal * sines)
        return np.where(holds, bounds * (1 + ROUNDING), np.inf).max(axis=0)


def _angles(directions: FloatArray, axes: FloatArray) -> FloatArray:
    """(3, T): between unit vectors (3, 1, T) and (3, 3, T). By the chords, as cosines cannot resolve small angles."""
    chords = axes - directions
    chords *= chords
    halves = np.sqrt(chords.sum(axis=0)) / 2
    return 2 * np.arcsin(np.minimum(halves, 1.0))


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
