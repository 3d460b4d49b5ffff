# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface that the mesh covers, seen along a direction.

If an odd number of triangles lies over one point of a convex region, and no border of the triangles over the region, an
odd number lies over every point. Then every point of the region has a triangle over it, and heights bound distances
both ways. docs/deviation.md, Covering.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces
from .columns import NONE, applied, columns, unknown
from .heights import SideViews, Views, axes_across, plane_functionals
from .triangles import Triangles

# The place in a region where covering is counted: asymmetric weights of the corners.
PLACE_IN_QUAD = np.array([0.313, 0.221, 0.187, 0.279])

# Pieces count as uncovered if triangles farther than this many from the first would be needed.
MOST_TRIANGLES_ACROSS = 12


@dataclass(frozen=True)
class Seen:
    """n pieces as seen along directions. coefficients: (3, 16, n); directions: (3, n); axes: (2, 3, n), across; across:
    (2, 16, n), the coefficients there; low, high: (2, n), their bounds; excess: (n,), rounding included."""

    coefficients: FloatArray
    directions: FloatArray
    axes: FloatArray
    across: FloatArray
    low: FloatArray
    high: FloatArray
    excess: FloatArray

    @staticmethod
    def of(pieces: BezierPieces, block: IndexArray, directions: FloatArray, margin: float) -> Seen:
        """Pieces (n,) as seen along directions (n, 3)."""
        coefficients, along = columns(pieces.coefficients[block]), columns(directions)
        axes = axes_across(along, coefficients[:, CORNERS[1]] - coefficients[:, CORNERS[0]])
        across = applied(axes, coefficients)
        excess = pieces.excess[block] + margin
        low, high = across.min(axis=1) - excess, across.max(axis=1) + excess
        return Seen(coefficients, along, axes, across, low, high, excess)


@dataclass(frozen=True)
class Under:
    """K triangles under pieces. owners, which: (K,) intp; meets: (3, K) bool, the sides that may lie under the piece;
    values: (4, 16, K), the distances inside each side, and the heights; inward: (3, 2, K), the sides' directions
    across; steepness, unevenness: (K,)."""

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
    """The largest heights of pieces over triangles (n,), infinite where triangles may not cover a piece, and the
    triangles (n,) of these heights.

    block: (n,) intp, the pieces; directions: (n, 3), unit vectors; first: (n,) intp, a triangle near each, to begin
    with. goals: (n,), bounds below the goals are as good. margin: the rounding allowance.
    """
    count = len(block)
    upper, worst = np.full(count, np.inf), np.zeros(count, dtype=np.intp)
    if not count:
        return upper, worst
    seen = Seen.of(pieces, block, directions, margin)
    found, covered = _triangles_under(seen, mesh, first, margin)
    owners = np.concatenate([part.owners for part in found])
    inside = np.concatenate([np.einsum("c,scn->sn", PLACE_IN_QUAD, part.values[:3, CORNERS]) for part in found], axis=1)
    covered &= _are_odd(owners, inside, count, margin)
    upper[covered] = 0.0
    # Uncovered pieces need no clipping.
    goals = np.where(covered, goals, np.inf)
    corners, excess = seen.across[:, CORNERS], pieces.excess[block]
    for part in found:
        owners, which = part.owners, part.which
        views = Views(
            inside=part.values[:3],
            heights=part.values[3],
            inward=part.inward,
            places=corners.take(owners, axis=2),
            excess=excess[owners],
            steepness=part.steepness,
            unevenness=part.unevenness,
        )
        heights = views.largest_heights(goals[owners], margin)
        heights[(mesh.thickness[which] > 0) & (mesh.thickness[which] <= margin)] = 0.0
        before = upper.copy()
        np.maximum.at(upper, owners, heights)
        at_most = (heights == upper[owners]) & (heights > before[owners])
        worst[owners[at_most]] = which[at_most]
    return upper, worst


def _triangles_under(seen: Seen, mesh: Triangles, first: IndexArray, margin: float) -> tuple[list[Under], BoolArray]:
    """The triangles under pieces: the first triangles (n,) and all triangles connected to them by sides that may lie
    under the pieces; (n,) bool, whether every such side has exactly one triangle beyond."""
    keys = np.arange(len(first)) * mesh.count + first
    known, found = keys, []
    covered = np.ones(len(first), dtype=bool)
    for _ in range(MOST_TRIANGLES_ACROSS):
        part = _under(seen, mesh, keys // mesh.count, keys % mesh.count, margin)
        found.append(part)
        sides, rows = np.nonzero(part.meets)
        which, owners = part.which[rows], part.owners[rows]
        beyond = mesh.beyond[sides, which]
        covered[owners[beyond == NONE]] = False
        # Uncovered pieces need nothing more.
        going = covered[owners]
        keys, known = unknown((owners * mesh.count + beyond)[going], known)
        if not len(keys):
            break
    covered[keys // mesh.count] = False
    return found, covered


def _under(seen: Seen, mesh: Triangles, owners: IndexArray, which: IndexArray, margin: float) -> Under:
    """The triangles that may lie under their pieces."""
    points, directions = mesh.corners(which), seen.directions.take(owners, axis=1)
    axes = seen.axes.take(owners, axis=2)
    places = applied(axes, points.swapaxes(0, 1))
    below = places < seen.low.take(owners, axis=1)[:, None]
    above = places > seen.high.take(owners, axis=1)[:, None]
    beside = ((below & below[:, [1, 2, 0]]) | (above & above[:, [1, 2, 0]])).any(axis=0)
    sides = SideViews.of(points, directions, margin)
    plane, offsets, steepness, unevenness = plane_functionals(columns(mesh.normals[which]), points, directions)
    values = applied(np.concatenate([sides.inward, plane[None]]), seen.coefficients.take(owners, axis=2))
    values[:3] += sides.offsets[:, None]
    values[3] += offsets
    excess = seen.excess[owners]
    meets = (values[:3].min(axis=1) <= excess) & ~beside
    is_apart = (below.all(axis=1) | above.all(axis=1)).any(axis=0) | (values[:3].max(axis=1) < -excess).any(axis=0)
    inward = applied(axes, sides.inward.swapaxes(0, 1)).swapaxes(0, 1)
    under = Under(owners, which, meets, values, inward, steepness, unevenness)
    if not is_apart.any():
        return under
    over = np.flatnonzero(~is_apart)
    return Under(*(column.take(over, axis=-1) for column in vars(under).values()))


def _are_odd(owners: IndexArray, inside: FloatArray, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether an odd number of triangles lies over a place. The place is at the distances (3, K) inside
    the sides of the triangles."""
    is_inside, is_outside = (inside > margin).all(axis=0), (inside < -margin).any(axis=0)
    found = np.bincount(owners[is_inside], minlength=count) % 2 == 1
    found[owners[~is_inside & ~is_outside]] = False
    return found
