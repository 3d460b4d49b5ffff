# SPDX-License-Identifier: GPL-3.0-or-later
"""What triangles miss of the surface when gliding along it costs nothing (docs/adaptive.md, Along the surface).

At equal parameters a point of the surface is off a triangle along its normal, and across it. Where the triangles
around are nearly in one plane, what is off across hardly matters: another point of the mesh, or of the surface, is
nearer. Let τ be a triangle, and all triangles at a vertex of it be tilted against it by Θ at most and off by at most N
along their normals and by T across them. In the third of τ that is nearest to that vertex, both distances, from τ to
the surface and from the surface over τ to the mesh, are at most

    N / cos Θ + 2 tan Θ (T + N sin Θ)

provided that the triangles around the vertex close up to a disc, go round it once as seen along τ's normal, and are
wide enough: T + N is less than a third of cos Θ times the least of their heights over the vertex.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .mesh import FloatArray, IndexArray
from .norms import cross_products, squared_norms

# Steeper than this the bound is of no use any more.
LEAST_COSINE = 0.25

# What rounding may take from an angle or a ratio.
ROUNDING = 1e-9


# At degenerate triangles, and where normals cancel, there is nothing to divide by.
@np.errstate(divide="ignore", invalid="ignore")
def graph_bounds(
    positions: FloatArray,
    triangles: IndexArray,
    normal: FloatArray,
    tangential: FloatArray,
    closed: NDArray[np.bool_],
    wanted: NDArray[np.bool_],
) -> FloatArray:
    """The distance of each wanted triangle in both directions, float64, at most; inf where the conditions do not hold.

    positions: (V, 3); triangles: (T, 3); normal, tangential: (T,), how far each is off the surface at equal parameters,
    at most. closed: (V,) whether all the triangles around a vertex are there and close up to a disc. wanted: (T,).
    """
    sides: FloatArray = positions[np.roll(triangles, -1, axis=1)]
    sides -= positions[triangles]
    crosses = cross_products(sides[:, 0], sides[:, 1])
    doubled = np.sqrt(squared_norms(crosses))
    normals = crosses / doubled[:, None]
    heights = doubled[:, None] / np.sqrt(squared_norms(np.roll(sides, -1, axis=1)))
    sums = [np.bincount(triangles.ravel(), np.repeat(component, 3), len(positions)) for component in normals.T]
    axes: FloatArray = np.stack(sums, axis=1).astype(np.float64)
    axes = axes / np.sqrt(squared_norms(axes))[:, None]

    # (T, 3): for each triangle, what is so at each of its corners.
    tilts = _angles(np.einsum("ti,tki->tk", normals, axes[triangles]))
    angles = _corner_angles(sides)
    around = (
        _largest_at(triangles, tilts, len(positions)),
        np.bincount(triangles.ravel(), angles.ravel(), len(positions)),
        -_largest_at(triangles, -heights, len(positions)),
        _largest_at(triangles, np.repeat(normal, 3), len(positions)),
        _largest_at(triangles, np.repeat(tangential, 3), len(positions)),
    )
    # And for each that is wanted, what is so around each of its vertices. Comparisons are made so that what is not a
    # number meets no condition.
    own = triangles[wanted]
    largest_tilt, turns, width, off_normal, off_across = (values[own] for values in around)
    tilt = largest_tilt + tilts[wanted] + ROUNDING
    cosines = np.cos(np.minimum(tilt, np.pi / 2))
    holds = (cosines > LEAST_COSINE) & closed[own]
    holds &= turns < 4 * np.pi * cosines * (1 - ROUNDING)
    holds &= off_across + off_normal < cosines * width / 3 * (1 - ROUNDING)
    cosines = np.where(holds, cosines, 1.0)
    sines = np.sqrt(1 - cosines**2)
    bounds = off_normal / cosines + 2 * sines / cosines * (off_across + off_normal * sines)
    return np.where(holds, bounds * (1 + ROUNDING), np.inf).max(axis=1)


def _angles(cosines: FloatArray) -> FloatArray:
    return np.arccos(np.clip(cosines, -1.0, 1.0))


def _corner_angles(sides: FloatArray) -> FloatArray:
    """(T, 3): the angle of each triangle at each corner; sides: (T, 3, 3), from each corner to the next."""
    back = np.roll(sides, 1, axis=1)
    np.negative(back, out=back)
    sines = np.sqrt(squared_norms(cross_products(sides, back)))
    return np.arctan2(sines, np.einsum("tki,tki->tk", sides, back))


def _largest_at(triangles: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """(count,) the largest of the values at the corners (T · 3 in all) of each vertex."""
    largest = np.full(count, -np.inf)
    np.maximum.at(largest, triangles.ravel(), values.ravel())
    return largest
