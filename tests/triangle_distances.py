# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances from points to triangles, by other means than the extension's."""

import numpy as np
from scipy.spatial import cKDTree

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray

# How many triangles each point is compared with.
NEIGHBOURS = 24


def point_to_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """(N,) distances from points (N, 3) to triangles (N, 3, 3), by quadratic programming over all faces of each."""
    # Component by component, which takes a third of the time.
    a, b, c = np.ascontiguousarray(np.moveaxis(corners, 0, -1))
    ab, ac, ap = b - a, c - a, points.T - a
    along, across, twist = _dot(ab, ab), _dot(ac, ac), _dot(ab, ac)
    # The determinant of these; of products, as on thin triangles hardly more than rounding is left of differences.
    normal = np.cross(ab, ac, axis=0)
    determinant = _dot(normal, normal)
    # Where there is no area there is no inside.
    determinant[determinant == 0] = np.nan
    right = _dot(ab, ap), _dot(ac, ap)
    v = (across * right[0] - twist * right[1]) / determinant
    w = (along * right[1] - twist * right[0]) / determinant
    over = _dot(ap, normal) ** 2 / determinant
    best = np.where((v >= 0) & (w >= 0) & (v + w <= 1), over, np.inf)
    for start, side in ((ap, ab), (ap - ab, c - b), (ap - ac, -ac)):
        squared = _dot(side, side)
        squared[squared == 0] = 1.0
        off = start - np.clip(_dot(start, side) / squared, 0, 1) * side
        np.minimum(best, _dot(off, off), out=best)
    return np.sqrt(best)


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def distances(
    points: FloatArray, positions: FloatArray, triangles: IndexArray, beyond: float | None = None
) -> FloatArray:
    """(N,) to the triangles whose middles are nearest: no shorter than the true ones, and true where they are longer
    than ``beyond``."""
    corners = positions[triangles]
    middles = corners.mean(axis=1)
    # A triangle is no nearer than its middle by more than this; rounding is less by far than the last part.
    sizes = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1) * (1 + 1e-6)
    tree = cKDTree(middles)
    apart, near = tree.query(points, range(1, min(NEIGHBOURS, len(triangles)) + 1))
    found = point_to_triangles(points, corners[near[:, 0]])
    which, column = np.nonzero(apart[:, 1:] - sizes[near[:, 1:]] < found[:, None])
    np.minimum.at(found, which, point_to_triangles(points[which], corners[near[which, column + 1]]))
    if beyond is not None:
        far = np.flatnonzero(found > beyond)
        every = tree.query_ball_point(points[far], found[far] + sizes.max())
        which, chosen = np.repeat(far, [len(each) for each in every]), np.concatenate([[], *every]).astype(np.intp)
        np.minimum.at(found, which, point_to_triangles(points[which], corners[chosen]))
    return found
