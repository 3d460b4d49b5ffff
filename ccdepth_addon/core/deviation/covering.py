# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface that the mesh covers, and triangles that the surface covers, seen along a direction.

What lies over every point of a convex region is odd in number when that is so at one point, and no border of what is
counted lies over the region. Then every point of the region has something over it, and heights bound distances both
ways. docs/deviation.md, Covering.
"""

from __future__ import annotations

import numpy as np

from ..mesh import FloatArray, IndexArray
from .bezier_pieces import CORNERS, NONE, SIDES, BezierPieces
from .heights import BoolArray, SideViews, Views, axes_across, plane_functionals
from .triangles import Triangles, dot

# Where in a region covering is counted: weights of corners without anything symmetric about them.
PLACE_IN_QUAD = np.array([0.313, 0.221, 0.187, 0.279])
PLACE_IN_TRIANGLE = np.array([0.4137, 0.3271, 0.2592])

# An excess beyond this part of what is wanted stands in the way.
EXCESS_SHARE = 0.02


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


def over_pieces(
    pieces: BezierPieces,
    corners: FloatArray,
    normals: FloatArray,
    pairs: tuple[IndexArray, IndexArray],
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray, IndexArray]:
    """(n,) the largest heights of the surface over parts of triangles, infinite where it may not cover them; (n,) the
    leaf they were found with; and (m,) leaves whose excess stands in the way.

    corners: (n, 3, 3); normals: (n, 3), of their triangles; pairs: which of the n, and which unit, (K,) each, in
    ascending order. goals: (n,), bounds below these are as good. margin: what rounding can hide.
    """
    count = len(corners)
    sides = SideViews.of(corners, normals, margin)
    owners, leaves = _leaves_over(pieces, sides, pairs, margin)
    plane, offsets, steepness, unevenness = plane_functionals(normals, corners, normals)
    functionals = np.concatenate([sides.inward, plane[:, None]], axis=1)
    constants = np.concatenate([sides.offsets, offsets[:, None]], axis=1)
    coefficients, excess = pieces.coefficients[leaves], pieces.excess[leaves]
    values = functionals[owners] @ coefficients + constants[owners][:, :, None]
    are_over = ~(values[:, :3].max(axis=2) + excess[:, None] + margin < 0).any(axis=1)
    owners, leaves, coefficients, excess, values = (
        array[are_over] for array in (owners, leaves, coefficients, excess, values)
    )
    axes = axes_across(normals, corners[:, 1] - corners[:, 0])
    seen_from = np.einsum("nij,nj->ni", axes, np.einsum("c,ncd->nd", PLACE_IN_TRIANGLE, corners))
    across = axes[owners] @ coefficients - seen_from[owners][:, :, None]

    covered = _units_meet(pieces, pairs, owners, leaves, values[:, :3], excess + margin, count)
    covered &= _winds_once(owners, across, excess + margin, count)
    chosen = covered[owners]
    blamed = leaves[~chosen & (excess > 0)]
    owners, leaves = owners[chosen], leaves[chosen]
    views = Views(
        inside=values[chosen, :3],
        heights=values[chosen, 3],
        inward=(sides.inward @ axes.swapaxes(1, 2))[owners],
        places=across[chosen][:, :, CORNERS],
        excess=excess[chosen],
        steepness=steepness[owners],
        unevenness=unevenness[owners],
    )
    found = views.largest_heights(goals[owners], margin)
    upper, worst = np.full(count, np.inf), np.full(count, NONE)
    upper[covered] = 0.0
    np.maximum.at(upper, owners, found)
    at_most = found == upper[owners]
    worst[owners[at_most]] = leaves[at_most]
    too_much = (views.excess > EXCESS_SHARE * goals[owners]) & (found > goals[owners])
    return upper, worst, np.unique(np.concatenate([blamed, leaves[too_much]]))


def _leaves_over(
    pieces: BezierPieces, sides: SideViews, pairs: tuple[IndexArray, IndexArray], margin: float
) -> tuple[IndexArray, IndexArray]:
    """Which leaves of these units may lie over which parts: units are the first pieces, and parents hold their
    children."""
    owners, nodes = pairs
    found = []
    lengths = np.abs(sides.inward)
    while len(owners):
        middle, half = (pieces.low[nodes] + pieces.high[nodes]) / 2, (pieces.high[nodes] - pieces.low[nodes]) / 2
        inside = sides.offsets[owners] + margin
        for axis in range(3):
            inside += sides.inward[owners, :, axis] * middle[:, None, axis]
            inside += lengths[owners, :, axis] * half[:, None, axis]
        over = (inside >= 0).all(axis=1)
        owners, nodes = owners[over], nodes[over]
        first = pieces.first_child[nodes]
        is_leaf = first == NONE
        found.append((owners[is_leaf], nodes[is_leaf]))
        owners = np.repeat(owners[~is_leaf], 4)
        nodes = (first[~is_leaf][:, None] + np.arange(4)).ravel()
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def _units_meet(
    pieces: BezierPieces,
    pairs: tuple[IndexArray, IndexArray],
    owners: IndexArray,
    leaves: IndexArray,
    inside: FloatArray,
    excess: FloatArray,
    count: int,
) -> BoolArray:
    """(count,) bool: whether both units at every edge that may lie over a part are among those looked at."""
    covered = np.ones(count, dtype=bool)
    edges = pieces.sides[leaves]
    rows, sides = np.nonzero(edges != NONE)
    along = inside[rows[:, None, None], np.arange(3)[:, None], SIDES[sides][:, None]]
    apart = (along.max(axis=2) + excess[rows][:, None] < 0).any(axis=1)
    rows, sides = rows[~apart], sides[~apart]
    units = pieces.edge_units[edges[rows, sides]]
    known = pairs[0] * pieces.unit_count + pairs[1]
    for other in units.T:
        keys = owners[rows] * pieces.unit_count + other
        places = np.minimum(np.searchsorted(known, keys), len(known) - 1)
        missing = (other == NONE) | (known[places] != keys)
        covered[owners[rows[missing]]] = False
    return covered


def _winds_once(owners: IndexArray, across: FloatArray, excess: FloatArray, count: int) -> BoolArray:
    """(count,) bool: whether the borders of an odd number of leaves wind about the origin, across (K, 2, 16).

    A border may be drawn straight from corner to corner where no side's hull contains the origin.
    """
    near = (across.min(axis=2) <= excess[:, None]).all(axis=1) & (across.max(axis=2) >= -excess[:, None]).all(axis=1)
    owners, across, excess = owners[near], across[near], excess[near]
    crossings = np.zeros(len(owners), dtype=np.intp)
    is_clear = np.ones(len(owners), dtype=bool)
    for side in SIDES:
        x, y = across[:, 0][:, side], across[:, 1][:, side]
        chord = np.stack([x[:, 3] - x[:, 0], y[:, 3] - y[:, 0]], axis=1)
        lengths = np.hypot(*chord.T)
        chord /= np.maximum(lengths, np.finfo(float).tiny)[:, None]
        along = chord[:, :1] * x + chord[:, 1:] * y
        aside = chord[:, :1] * y - chord[:, 1:] * x
        is_clear &= (
            (along.min(axis=1) > excess)
            | (along.max(axis=1) < -excess)
            | (aside.min(axis=1) > excess)
            | (aside.max(axis=1) < -excess)
        )
        starts_above, ends_above = y[:, 0] > 0, y[:, 3] > 0
        is_right = (x[:, 0] * y[:, 3] - x[:, 3] * y[:, 0] > 0) == (y[:, 3] > y[:, 0])
        crossings += (starts_above != ends_above) & is_right
    found = np.bincount(owners[crossings % 2 == 1], minlength=count) % 2 == 1
    found[owners[~is_clear]] = False
    return found


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
