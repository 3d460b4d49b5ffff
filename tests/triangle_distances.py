# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances from points to triangles, by other means than the extension's."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray

# How many triangles each point is compared with.
NEIGHBOURS = 24


def point_to_triangles(points: FloatArray, corners: FloatArray) -> FloatArray:
    """(N,) distances from points (N, 3) to triangles (N, 3, 3), by quadratic programming over all faces of each."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    gram = np.stack([np.stack([(ab * ab).sum(1), (ab * ac).sum(1)]), np.stack([(ab * ac).sum(1), (ac * ac).sum(1)])])
    right = np.stack([(ab * ap).sum(1), (ac * ap).sum(1)])
    determinant = gram[0, 0] * gram[1, 1] - gram[0, 1] ** 2
    # Where there is no area there is no inside.
    determinant = np.where(determinant == 0, np.nan, determinant)
    v = (gram[1, 1] * right[0] - gram[0, 1] * right[1]) / determinant
    w = (gram[0, 0] * right[1] - gram[0, 1] * right[0]) / determinant
    inside = (v >= 0) & (w >= 0) & (v + w <= 1)
    best = np.where(inside, np.linalg.norm(ap - v[:, None] * ab - w[:, None] * ac, axis=1), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        squared = (along * along).sum(1)
        share = np.clip(((points - start) * along).sum(1) / np.where(squared > 0, squared, 1.0), 0, 1)
        best = np.minimum(best, np.linalg.norm(points - start - share[:, None] * along, axis=1))
    return best


def distances(points: FloatArray, positions: FloatArray, triangles: IndexArray) -> FloatArray:
    """(N,) to the triangles whose middles are nearest: no shorter than the true ones."""
    corners = positions[triangles]
    count = min(NEIGHBOURS, len(triangles))
    _, near = cKDTree(corners.mean(axis=1)).query(points, count)
    near = near.reshape(len(points), count)
    owners = np.repeat(np.arange(len(points)), count)
    return point_to_triangles(points[owners], corners[near.ravel()]).reshape(near.shape).min(axis=1)
