# SPDX-License-Identifier: GPL-3.0-or-later
"""About the distances of points from Bézier pieces, by Newton's steps. Nothing is proved by these."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths, squared_norms
from .bezier_pieces import BezierPieces

# The largest step along a side, and the steps from the nearest point of the grid.
LARGEST_STEP, STEPS = 0.25, 8


def cubics(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(N, 4) twice: the cubic Bernstein polynomials at places (N,), and their derivatives."""
    to, no = at, 1 - at
    values = np.stack([no**3, 3 * no**2 * to, 3 * no * to**2, to**3], axis=1)
    slopes = 3 * np.stack([-(no**2), no**2 - 2 * no * to, 2 * no * to - to**2, to**2], axis=1)
    return values, slopes


# Five places along each side: the grid that steps begin at, and the points of the surface there, (25, 16).
ALONG = np.linspace(0.0, 1.0, 5)
GRID = np.stack(np.meshgrid(ALONG, ALONG, indexing="ij"), axis=2).reshape(-1, 2)
ON_GRID = np.kron(cubics(ALONG)[0], cubics(ALONG)[0])


def seen_from(points: FloatArray, rows: IndexArray, which: IndexArray, pieces: BezierPieces) -> FloatArray:
    """(P,): about the least distances of points (P, 3) from pieces, less their excess, by pairs (K,)."""
    points, coefficients, found = points[rows], pieces.coefficients[which], np.full(len(points), np.inf)
    apart = np.matmul(coefficients, ON_GRID.T) - points[:, :, None]
    at = GRID[(apart * apart).sum(axis=1).argmin(axis=1)]
    grid = coefficients.reshape(-1, 3, 4, 4)
    for _ in range(STEPS):
        (u, du), (v, dv) = cubics(at[:, 0]), cubics(at[:, 1])
        across = np.matmul(grid, v[:, None, :, None])[..., 0]
        off = np.matmul(across, u[:, :, None])[..., 0] - points
        along_u = np.matmul(across, du[:, :, None])[..., 0]
        along_v = np.matmul(np.matmul(grid, dv[:, None, :, None])[..., 0], u[:, :, None])[..., 0]
        a, b, c = squared_norms(along_u), dot_products(along_u, along_v), squared_norms(along_v)
        p, q, scale = dot_products(along_u, off), dot_products(along_v, off), a * c - b * b
        step = np.stack([c * p - b * q, a * q - b * p], axis=1)
        step = np.divide(step, scale[:, None], out=np.zeros_like(step), where=(scale > 1e-12 * a * c)[:, None])
        at = np.clip(at - np.clip(step, -LARGEST_STEP, LARGEST_STEP), 0.0, 1.0)
    np.minimum.at(found, rows, lengths(off) - pieces.excess[which])
    return found
