# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface that the mesh covers, seen along a direction.

What lies over every point of a convex region is odd in number when that is so at one point, and no border of what is
counted lies over the region. Then every point of the region has something over it, and heights bound distances both
ways. docs/deviation.md, Covering.
"""

from __future__ import annotations

import numpy as np

from ..mesh import FloatArray, IndexArray
from .bezier_pieces import CORNERS, BezierPieces
from .heights import BoolArray, SideViews, Views, axes_across, plane_functionals
from .triangles import Triangles

# Where in a region covering is counted: weights of corners without anything symmetric about them.
PLACE_IN_QUAD = np.array([0.313, 0.221, 0.187, 0.279])


def over_triangles(
    pieces: BezierPieces,
    block: IndexArray,
    directions: FloatArray,
    mesh: Triangles,
    pairs: tuple[IndexArray, IndexArray],
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray]:
    """(n,) the largest heights of pieces over triangles, infinite where these may not cover them; (n,) over which one.

    block: (n,) intp, the pieces; directions: (n, 3), unit vectors; pairs: which of the n, and which triangle, (K,)
    each. goals: (n,), bounds below these are as good. margin: what rounding can hide.
    """
    upper, worst = np.full(len(block), np.inf), np.zeros(len(block), dtype=np.intp)
    coefficients = pieces.coefficients[block]
    corners = coefficients[:, :, CORNERS]
    axes = axes_across(directions, corners[:, :, 1] - corners[:, :, 0])
    across = axes @ coefficients
    excess = pieces.excess[block] + margin
    low, high = across.min(axis=2) - excess[:, None], across.max(axis=2) + excess[:, None]
    owners, which = pairs
    points = mesh.points[:, which].swapaxes(0, 1)
    places = points @ axes[owners].swapaxes(1, 2)
    beyond = (places < low[owners][:, None], places > high[owners][:, None])
    over = np.flatnonzero(~np.logical_or(*(side.all(axis=1) for side in beyond)).any(axis=1))
    owners, which, points = owners[over], which[over], points[over]
    edges_beside = [(side[over] & side[over][:, [1, 2, 0]]).any(axis=2) for side in beyond]

    sides = SideViews.of(points, directions[owners], margin)
    plane, offsets, steepness, unevenness = plane_functionals(mesh.normals[which], points, directions[owners])
    values = np.concatenate([sides.inward, plane[:, None]], axis=1) @ coefficients[owners]
    values += np.concatenate([sides.offsets, offsets[:, None]], axis=1)[:, :, None]
    inside = values[:, :3]
    least, most = inside.min(axis=2) - excess[owners][:, None], inside.max(axis=2) + excess[owners][:, None]
    are_over = ~(most < 0).any(axis=1)
    meets = (least <= 0) & ~(edges_beside[0] | edges_beside[1]) & are_over[:, None]

    covered = _has_partners(owners, mesh.edges[:, which].T, meets, len(block))
    covered &= _are_odd(owners, inside[:, :, CORNERS] @ PLACE_IN_QUAD, len(block), margin)

    chosen = np.flatnonzero(are_over & covered[owners])
    owners, which = owners[chosen], which[chosen]
    views = Views(
        inside=inside[chosen],
        heights=values[chosen, 3],
        inward=sides.inward[chosen] @ axes[owners].swapaxes(1, 2),
        places=across[owners][:, :, CORNERS],
        excess=pieces.excess[block[owners]],
        steepness=steepness[chosen],
        unevenness=unevenness[chosen],
    )
    found = views.largest_heights(goals[owners], margin)
    found[(mesh.thickness[which] > 0) & (mesh.thickness[which] <= margin)] = 0.0
    upper[covered] = 0.0
    np.maximum.at(upper, owners, found)
    at_most = found == upper[owners]
    worst[owners[at_most]] = which[at_most]
    return upper, worst


def _has_partners(owners: IndexArray, edges: IndexArray, meets: BoolArray, count: int) -> BoolArray:
    """(count,) bool: whether every edge that may lie over a region belongs to an even number of triangles there."""
    rows, sides = np.nonzero(meets)
    keys = owners[rows] * (int(edges.max(initial=0)) + 1) + edges[rows, sides]
    keys, first, counts = np.unique(keys, return_index=True, return_counts=True)
    alone = first[counts % 2 == 1]
    covered = np.ones(count, dtype=bool)
    covered[owners[rows[alone]]] = False
    return covered


def _are_odd(owners: IndexArray, inside: FloatArray, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether an odd number of triangles lies over a place that is so far inside (K, 3) their sides."""
    is_inside, is_outside = (inside > margin).all(axis=1), (inside < -margin).any(axis=1)
    found = np.bincount(owners[is_inside], minlength=count) % 2 == 1
    found[owners[~is_inside & ~is_outside]] = False
    return found
