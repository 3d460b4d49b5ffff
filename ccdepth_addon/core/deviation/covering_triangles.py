# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface that the mesh covers, seen along a direction.

What lies over every point of a convex region is odd in number when that is so at one point, and no border of what is
counted lies over the region. Then every point of the region has something over it, and heights bound distances both
ways. docs/deviation.md, Covering.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .bezier_pieces import CORNERS, NONE, BezierPieces
from .heights import SideViews, Views, axes_across, plane_functionals
from .triangles import Triangles

# Where in a region covering is counted: weights of corners without anything symmetric about them.
PLACE_IN_QUAD = np.array([0.313, 0.221, 0.187, 0.279])

# Pieces are found not to be covered where triangles would have to be looked at farther than so many from the first.
MOST_TRIANGLES_ACROSS = 12


@dataclass(frozen=True)
class Seen:
    """n pieces as seen along directions. coefficients: (n, 3, 16); directions: (n, 3); axes: (n, 2, 3), across; across:
    (n, 2, 16), the coefficients there; low, high: (n, 2), what holds them; excess: (n,), rounding included."""

    coefficients: FloatArray
    directions: FloatArray
    axes: FloatArray
    across: FloatArray
    low: FloatArray
    high: FloatArray
    excess: FloatArray

    @staticmethod
    def of(pieces: BezierPieces, block: IndexArray, directions: FloatArray, margin: float) -> Seen:
        """The pieces (n,)."""
        coefficients = pieces.coefficients[block]
        axes = axes_across(directions, coefficients[:, :, CORNERS[1]] - coefficients[:, :, CORNERS[0]])
        across = axes @ coefficients
        excess = pieces.excess[block] + margin
        low, high = across.min(axis=2) - excess[:, None], across.max(axis=2) + excess[:, None]
        return Seen(coefficients, directions, axes, across, low, high, excess)


@dataclass(frozen=True)
class Under:
    """K triangles under pieces. owners, which: (K,) intp; meets: (K, 3) bool, the sides that may lie under the piece;
    values: (K, 4, 16), how far inside each side, and the heights; inward: (K, 3, 3); steepness, unevenness: (K,)."""

    owners: IndexArray
    which: IndexArray
    meets: BoolArray
    values: FloatArray
    inward: FloatArray
    steepness: FloatArray
    unevenness: FloatArray


def over_triangles(
    pieces: BezierPieces,
    block: IndexArray,
    directions: FloatArray,
    mesh: Triangles,
    first: IndexArray,
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray]:
    """(n,) the largest heights of pieces over triangles, infinite where these may not cover them; (n,) over which one.

    block: (n,) intp, the pieces; directions: (n, 3), unit vectors; first: (n,) intp, a triangle near each, from which
    on others are looked at. goals: (n,), bounds below these are as good. margin: what rounding can hide.
    """
    count = len(block)
    seen = Seen.of(pieces, block, directions, margin)
    found, covered = _triangles_under(seen, mesh, first, margin)
    owners = np.concatenate([part.owners for part in found])
    inside = np.concatenate([part.values[:, :3][:, :, CORNERS] @ PLACE_IN_QUAD for part in found])
    covered &= _are_odd(owners, inside, count, margin)
    upper, worst = np.full(count, np.inf), np.zeros(count, dtype=np.intp)
    upper[covered] = 0.0
    for part in found:
        chosen = np.flatnonzero(covered[part.owners])
        owners, which = part.owners[chosen], part.which[chosen]
        views = Views(
            inside=part.values[chosen, :3],
            heights=part.values[chosen, 3],
            inward=part.inward[chosen] @ seen.axes[owners].swapaxes(1, 2),
            places=seen.across[owners][:, :, CORNERS],
            excess=pieces.excess[block[owners]],
            steepness=part.steepness[chosen],
            unevenness=part.unevenness[chosen],
        )
        heights = views.largest_heights(goals[owners], margin)
        heights[(mesh.thickness[which] > 0) & (mesh.thickness[which] <= margin)] = 0.0
        before = upper.copy()
        np.maximum.at(upper, owners, heights)
        at_most = (heights == upper[owners]) & (heights > before[owners])
        worst[owners[at_most]] = which[at_most]
    return upper, worst


def _triangles_under(seen: Seen, mesh: Triangles, first: IndexArray, margin: float) -> tuple[list[Under], BoolArray]:
    """What lies under the pieces of the triangles (n,) where looking begins, and of those beyond sides that may lie
    under them too, and so on; (n,) bool, whether there is always one triangle beyond."""
    keys = np.arange(len(first)) * mesh.count + first
    known, found = keys, []
    covered = np.ones(len(first), dtype=bool)
    for _ in range(MOST_TRIANGLES_ACROSS):
        part = _under(seen, mesh, keys // mesh.count, keys % mesh.count, margin)
        found.append(part)
        rows, sides = np.nonzero(part.meets)
        beyond = mesh.edge_triangles[mesh.edges[sides, part.which[rows]]]
        covered[part.owners[rows[(beyond == NONE).any(axis=1)]]] = False
        # What is not covered needs no more looking at.
        going = covered[part.owners[rows]]
        wanted = (part.owners[rows][:, None] * mesh.count + beyond)[going]
        keys = np.setdiff1d(wanted, known)
        known = np.union1d(known, keys)
        if not len(keys):
            break
    covered[keys // mesh.count] = False
    return found, covered


def _under(seen: Seen, mesh: Triangles, owners: IndexArray, which: IndexArray, margin: float) -> Under:
    """Those of the triangles that may lie under their pieces."""
    points = mesh.points[:, which].swapaxes(0, 1)
    places = points @ seen.axes[owners].swapaxes(1, 2)
    below, above = places < seen.low[owners][:, None], places > seen.high[owners][:, None]
    over = np.flatnonzero(~(below.all(axis=1) | above.all(axis=1)).any(axis=1))
    owners, which = owners[over], which[over]
    points, below, above = points[over], below[over], above[over]
    beside = ((below & below[:, [1, 2, 0]]) | (above & above[:, [1, 2, 0]])).any(axis=2)
    sides = SideViews.of(points, seen.directions[owners], margin)
    plane, offsets, steepness, unevenness = plane_functionals(mesh.normals[which], points, seen.directions[owners])
    values = np.concatenate([sides.inward, plane[:, None]], axis=1) @ seen.coefficients[owners]
    values += np.concatenate([sides.offsets, offsets[:, None]], axis=1)[:, :, None]
    excess = seen.excess[owners][:, None]
    least, most = values[:, :3].min(axis=2) - excess, values[:, :3].max(axis=2) + excess
    over = np.flatnonzero(~(most < 0).any(axis=1))
    meets = (least <= 0) & ~beside
    return Under(
        owners=owners[over],
        which=which[over],
        meets=meets[over],
        values=values[over],
        inward=sides.inward[over],
        steepness=steepness[over],
        unevenness=unevenness[over],
    )


def _are_odd(owners: IndexArray, inside: FloatArray, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether an odd number of triangles lies over a place that is so far inside (K, 3) their sides."""
    is_inside, is_outside = (inside > margin).all(axis=1), (inside < -margin).any(axis=1)
    found = np.bincount(owners[is_inside], minlength=count) % 2 == 1
    found[owners[~is_inside & ~is_outside]] = False
    return found
