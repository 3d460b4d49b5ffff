# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface that the mesh covers, seen along a direction.

If an odd number of triangles lies over one point of a convex region, and no border of the triangles over the region, an
odd number lies over every point. Then every point of the region has a triangle over it, and heights bound distances
both ways. docs/deviation.md, Covering.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import applied, columns
from ..surface.bicubic import CORNERS
from .bezier_pieces import BezierPieces
from .heights import SideViews, Views, axes_across, largest_of_each, plane_functionals
from .spread import NONE, Spread
from .triangles import Triangles

# The place in a region where covering is counted: asymmetric weights of the corners.
PLACE_IN_QUAD = np.array([0.313, 0.221, 0.187, 0.279])

# Pieces count as uncovered if triangles farther than this many from the first would be needed.
MOST_TRIANGLES_ACROSS = 12


@dataclass(frozen=True)
class Seen:
    """n pieces as seen along directions. coefficients: (3, 16, n); directions: (3, n); axes: (2, 3, n), across; across:
    (2, 16, n), the coefficients there; low, high: (2, n), bounds of the pieces there; excess, factors: (n,), of the
    pieces, and the least factors on the tolerance."""

    coefficients: FloatArray
    directions: FloatArray
    axes: FloatArray
    across: FloatArray
    low: FloatArray
    high: FloatArray
    excess: FloatArray
    factors: FloatArray

    @staticmethod
    def of(pieces: BezierPieces, block: IndexArray, directions: FloatArray, margin: float) -> Seen:
        """Pieces (n,) as seen along directions (n, 3)."""
        coefficients, along = columns(pieces.coefficients[block]), columns(directions)
        axes = axes_across(along, coefficients[:, CORNERS[1]] - coefficients[:, CORNERS[0]])
        across = applied(axes, coefficients)
        excess = pieces.excess[block]
        low, high = across.min(axis=1) - (excess + margin), across.max(axis=1) + (excess + margin)
        return Seen(coefficients, along, axes, across, low, high, excess, pieces.least[block])


@dataclass(frozen=True)
class Under(Table, axis=-1):
    """K triangles under pieces. owners, which: (K,) intp, the pieces and the triangles; meets: (3, K) bool, the sides
    that may lie under the piece; views: of the pieces over the triangles."""

    owners: IndexArray
    which: IndexArray
    meets: BoolArray
    views: Views


def over_triangles(
    pieces: BezierPieces,
    block: IndexArray,
    directions: FloatArray,
    mesh: Triangles,
    first: IndexArray,
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray]:
    """The largest reduced heights of pieces over triangles (n,), infinite where triangles may not cover a piece, and
    the triangles (n,) of these heights.

    block: (n,) intp, the pieces; directions: (n, 3), unit vectors; first: (n,) intp, a triangle near each, to begin
    with. goals: (n,), reduced bounds below the goals are as good. margin: the rounding allowance.
    """
    if not len(block):
        return np.zeros(0), np.zeros(0, dtype=np.intp)
    seen = Seen.of(pieces, block, directions, margin)
    found, covered = _triangles_under(seen, mesh, first, margin)
    owners = np.concatenate([under.owners for under in found])
    inside = [np.einsum("c,scn->sn", PLACE_IN_QUAD, under.views.inside[:, CORNERS]) for under in found]
    covered &= _are_odd(owners, np.concatenate(inside, axis=1), len(block), margin)
    upper, worst = np.where(covered, 0.0, np.inf), first
    for under in found:
        heights, which = largest_of_each(under.views, under.owners, under.which, covered, goals, margin)
        worst = np.where(heights > upper, which, worst)
        upper = np.maximum(upper, heights)
    return upper, worst


def _triangles_under(seen: Seen, mesh: Triangles, first: IndexArray, margin: float) -> tuple[list[Under], BoolArray]:
    """The triangles under pieces: the first triangles (n,) and all triangles connected to them by sides that may lie
    under the pieces; (n,) bool, whether every such side has exactly one triangle beyond."""
    spread, found = Spread(np.arange(len(first)), first, mesh.count), []
    covered = np.ones(len(first), dtype=bool)
    for _ in range(MOST_TRIANGLES_ACROSS):
        part = _under(seen, mesh, spread.owners, spread.things, margin)
        found.append(part)
        sides, rows = np.nonzero(part.meets)
        owners, beyond = part.owners[rows], mesh.beyond[sides, part.which[rows]]
        covered[owners[beyond == NONE]] = False
        # Uncovered pieces need nothing more.
        going = covered[owners]
        spread.go_on(owners[going], beyond[going])
        if not len(spread.owners):
            break
    covered[spread.owners] = False
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
    excess = seen.excess[owners] + margin
    meets = (values[:3].min(axis=1) <= excess) & ~beside
    is_apart = (below.all(axis=1) | above.all(axis=1)).any(axis=0) | (values[:3].max(axis=1) < -excess).any(axis=0)
    # Points over a triangle thinner than the margin are within few margins of others.
    thin = np.flatnonzero((mesh.thickness[which] > 0) & (mesh.thickness[which] <= margin))
    values[3][:, thin] = steepness[thin] = 0.0
    views = Views(
        inside=values[:3],
        heights=values[3],
        inward=applied(axes, sides.inward.swapaxes(0, 1)).swapaxes(0, 1),
        places=seen.across[:, CORNERS].take(owners, axis=2),
        excess=seen.excess[owners],
        steepness=steepness,
        unevenness=unevenness,
        factors=seen.factors[owners],
    )
    under = Under(owners, which, meets, views)
    return under.at(~is_apart)


def _are_odd(owners: IndexArray, inside: FloatArray, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether an odd number of triangles lies over a place. The place is at the distances (3, K) inside
    the sides of the triangles."""
    is_inside, is_outside = (inside > margin).all(axis=0), (inside < -margin).any(axis=0)
    found = np.bincount(owners[is_inside], minlength=count) % 2 == 1
    found[owners[~is_inside & ~is_outside]] = False
    return found
