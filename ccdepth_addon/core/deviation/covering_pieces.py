# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of triangles that the surface covers, seen along a direction. docs/deviation.md, Covering and Borders.

The surface consists of units that meet in edges. Where the border of the surface lies over a part, uncovered points
near the border are moved inwards until covered.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import applied, columns, products
from ..surface.bicubic import CORNERS
from .bezier_pieces import SIDES, BezierPieces
from .heights import SideViews, Views, axes_across, largest_of_each, plane_functionals
from .spread import NONE, Spread
from .windings import facing, windings

# The place in a triangle where covering is counted: asymmetric weights of the corners.
PLACE_IN_TRIANGLE = np.array([0.4137, 0.3271, 0.2592])

# An excess beyond this part of the goal may prevent a bound.
EXCESS_SHARE = 0.02

# The border has to run about one way: the sum of its parts is no shorter than this part of the sum of their lengths.
LEAST_STRAIGHTNESS = 0.8

# Regions count as uncovered if units farther than this many from the first would be needed.
MOST_UNITS_ACROSS = 8

# Units that meet at a vertex over a region are examined together; with more than this number of them the region counts
# as uncovered.
MOST_UNITS_AROUND = 1 << 6

# The largest number of leaves over several regions that are examined together.
LEAVES_OVER_AT_ONCE = 1 << 16

# Parts are moved this much more than the border that was seen first demands.
MOVED_MORE = 1.02


@dataclass(frozen=True)
class Regions(Table, axis=-1):
    """n parts of triangles as seen along directions. corners: (3, 3, n), each with its coordinates; normals: (3, n), of
    their triangles. directions: (3, n). sides: of the regions, which contain the parts before and after moving. axes:
    (2, 3, n), across. places: (3, n), where covering is counted. towards: (2, n), the direction across in which parts
    are moved; moved: (n,), by what distance."""

    corners: FloatArray
    normals: FloatArray
    directions: FloatArray
    sides: SideViews
    axes: FloatArray
    places: FloatArray
    towards: FloatArray
    moved: FloatArray

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray, directions: FloatArray, margin: float) -> Regions:
        """The regions of parts that are not moved."""
        axes = axes_across(directions, corners[1] - corners[0])
        places = np.einsum("c,cdn->dn", PLACE_IN_TRIANGLE, corners)
        sides = SideViews.of(corners, directions, margin)
        count = corners.shape[2]
        return Regions(corners, normals, directions, sides, axes, places, np.zeros((2, count)), np.zeros(count))

    @property
    def count(self) -> int:
        return len(self.moved)

    def move(self, towards: FloatArray, moved: FloatArray) -> Regions:
        """The regions with their parts moved along directions (2, n) by distances (n,)."""
        steps = (towards[:, None] * self.axes).sum(axis=0) * moved
        outwards = np.maximum(-products(self.sides.inward, steps), 0.0)
        sides = SideViews(self.sides.inward, self.sides.offsets + outwards)
        return replace(self, sides=sides, places=self.places + steps, towards=towards, moved=moved)

    def rises(self) -> FloatArray:
        """(n,): by how much the planes of the triangles rise or fall, along the directions, over the way moved."""
        plane, _, _, _ = plane_functionals(self.normals, self.corners, self.directions)
        return np.abs(products(plane, (self.towards[:, None] * self.axes).sum(axis=0))) * self.moved

    def least(self, towards: FloatArray) -> FloatArray:
        """(n,): the least coordinates of the parts along directions (2, n), seen from ``places``."""
        return (self._across() * towards[:, None]).sum(axis=0).min(axis=0)

    def outline(self) -> FloatArray:
        """(2, 6, n): points across, seen from ``places``, with the region as their hull: the part before and after
        moving."""
        across = self._across()
        return np.concatenate([across, across + (self.towards * self.moved)[:, None]], axis=1)

    def _across(self) -> FloatArray:
        """(2, 3, n): the corners across, seen from ``places``."""
        return applied(self.axes, (self.corners - self.places).swapaxes(0, 1))


@dataclass(frozen=True)
class Over(Table, axis=-1):
    """K leaves over parts. owners, leaves: (K,) intp. inside: (3, 16, K), distances inside the sides; heights: (16, K);
    across: (2, 16, K), from the place where covering is counted; excess: (K,); factors: (K,), the least factors on the
    tolerance."""

    owners: IndexArray
    leaves: IndexArray
    inside: FloatArray
    heights: FloatArray
    across: FloatArray
    excess: FloatArray
    factors: FloatArray


@dataclass(frozen=True)
class Covering:
    """The leaves over n regions. has_partners: (n,) bool, whether units meet others at all edges over the region but
    the border's. border: (b,) intp twice, leaves and their sides on the border over the region."""

    over: Over
    has_partners: BoolArray
    border: tuple[IndexArray, IndexArray]


def over_pieces(
    pieces: BezierPieces,
    corners: FloatArray,
    normals: FloatArray,
    directions: FloatArray,
    first: IndexArray,
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray, IndexArray, IndexArray] | None:
    """Bounds of the reduced distance from parts of triangles to the surface (n,), infinite where the surface may not
    cover a part; the leaf of each bound (n,); and pairs (m,) of parts with bounds beyond the goals and leaves over them
    with too large an excess. None if several parts have too many leaves over them, ``LEAVES_OVER_AT_ONCE``.

    corners: (n, 3, 3); normals: (n, 3), of their triangles; directions: (n, 3), unit vectors to look along; first: (n,)
    intp, a unit near each. goals: (n,), reduced bounds below the goals are as good. margin: the rounding allowance.
    """
    regions = Regions.of(columns(corners), columns(normals), columns(directions), margin)
    near = goals * pieces.least[first]
    covering = _covering(pieces, regions, first, near, margin)
    if covering is None:
        return None
    at_border = np.zeros(len(corners), dtype=bool)
    at_border[covering.over.owners[covering.border[0]]] = True
    inside = covering.has_partners & ~at_border
    covered = inside & _winds_once(covering.over, len(corners), margin)
    upper, worst = _heights(regions, covering.over, covered, goals, margin)
    for sheet, covered in _sheets(pieces, covering.over, inside & (upper > goals), margin):
        found, leaves = _heights(regions, sheet, covered, goals, margin)
        worst = np.where(found < upper, leaves, worst)
        upper = np.minimum(found, upper)
    chosen = np.flatnonzero(covering.has_partners & at_border)
    if len(chosen):
        chosen, moved = _moved_inwards(regions, covering, chosen, near, margin)
    if len(chosen):
        there = _covering(pieces, moved, first[chosen], near[chosen], margin)
        if there is None:
            return None
        covered = there.has_partners & _winds_once(there.over, len(chosen), margin)
        covered &= _is_beyond_border(moved, there, margin)
        found, leaves = _heights(moved, there.over, covered, goals[chosen], margin)
        least = np.full(len(chosen), np.inf)
        np.minimum.at(least, there.over.owners, there.over.factors)
        upper[chosen], worst[chosen] = np.hypot(found + moved.rises() / least, moved.moved / least), leaves
    over, most = covering.over, np.where(upper > goals, EXCESS_SHARE * np.maximum(goals, 0.0), np.inf)
    too_much = over.excess > most[over.owners] * over.factors
    return upper, worst, over.owners[too_much], over.leaves[too_much]


def _covering(
    pieces: BezierPieces, regions: Regions, first: IndexArray, goals: FloatArray, margin: float
) -> Covering | None:
    """The leaves over regions, of the first units and of all units connected to them over the regions. first, goals,
    and None: as in ``over_pieces``."""
    plane, offsets, _, _ = plane_functionals(regions.normals, regions.corners, regions.directions)
    functionals = np.concatenate([regions.sides.inward, plane[None], regions.axes])
    constants = np.concatenate([regions.sides.offsets, offsets[None], -products(regions.axes, regions.places)])
    outline = regions.outline()
    owners, units = _first_units(pieces, regions.sides, first, goals, margin)
    has_partners = np.zeros(regions.count, dtype=bool)
    has_partners[owners] = True
    spread, found, borders, count = Spread(owners, units, pieces.unit_count), [], [], 0
    for _ in range(MOST_UNITS_ACROSS):
        owners, leaves = _leaves_over(pieces, regions.sides, spread.owners, spread.things, margin)
        if regions.count > 1 and count + len(owners) > LEAVES_OVER_AT_ONCE:
            return None
        over = _seen(pieces, owners, leaves, functionals, constants, margin)
        over = over.at(_may_overlap(over, outline, margin))
        rows, which = _unit_sides_over(pieces, over, outline, margin)
        owners, leaves = over.owners[rows], over.leaves[rows]
        edges = pieces.sides[leaves, which]
        units_there = pieces.unit_mesh.edge_face_counts[edges]
        is_border, is_paired = units_there == 1, units_there == 2
        found.append(over)
        borders.append(np.stack([rows[is_border] + count, which[is_border]]))
        count += len(over.owners)
        has_partners[owners[~is_border & ~is_paired]] = False
        beyond = pieces.edge_units[edges].sum(axis=1) - pieces.units[leaves]
        spread.go_on(owners[is_paired], beyond[is_paired])
        if not len(spread.owners):
            break
    has_partners[spread.owners] = False
    rows, which = np.concatenate(borders, axis=1)
    return Covering(found[0].joined(found[1:]), has_partners, (rows, which))


def _first_units(
    pieces: BezierPieces, sides: SideViews, first: IndexArray, goals: FloatArray, margin: float
) -> tuple[IndexArray, IndexArray]:
    """Pairs of regions and units to begin with: a unit near each region (n,), and all units around a vertex of it that
    lies over the region, or nearer than the goals (n,), if these are many. No unit where too many would be needed."""
    mesh = pieces.unit_mesh
    vertices = mesh.corner_vertices.reshape(-1, 4)[first]
    counts = mesh.vertex_face_counts[vertices]
    corners, most = counts.argmax(axis=1), counts.max(axis=1)
    # Corners of pieces with nets are counted from the extraordinary one on.
    places = pieces.coefficients[first, :, CORNERS[np.where(pieces.has_net(first), 0, corners)]]
    inside = (sides.offsets + products(sides.inward, columns(places))).min(axis=0)
    regions = np.flatnonzero((inside < -margin) | (most <= MOST_UNITS_AROUND))
    around = np.flatnonzero((inside >= -goals) & (most > MOST_UNITS_ACROSS) & (most <= MOST_UNITS_AROUND))
    owners, units = pieces.units_at(vertices[around, corners[around]])
    return np.concatenate([regions, around[owners]]), np.concatenate([first[regions], units])


def _seen(
    pieces: BezierPieces,
    owners: IndexArray,
    leaves: IndexArray,
    functionals: FloatArray,
    constants: FloatArray,
    margin: float,
) -> Over:
    """Leaves (K,) that may lie over parts (K,), by functionals (6, 3, n) and constants (6, n) of the parts."""
    coefficients, excess = columns(pieces.coefficients[leaves]), pieces.excess[leaves]
    inside = applied(functionals[:3].take(owners, axis=2), coefficients)
    inside += constants[:3].take(owners, axis=1)[:, None]
    is_apart = (inside.max(axis=1) < -(excess + margin)).any(axis=0)
    if is_apart.any():
        left = np.flatnonzero(~is_apart)
        owners, leaves, excess = owners[left], leaves[left], excess[left]
        coefficients, inside = coefficients.take(left, axis=2), inside.take(left, axis=2)
    rest = applied(functionals[3:].take(owners, axis=2), coefficients)
    rest += constants[3:].take(owners, axis=1)[:, None]
    return Over(owners, leaves, inside, rest[0], rest[1:], excess, pieces.least[leaves])


def _may_overlap(over: Over, outline: FloatArray, margin: float) -> BoolArray:
    """(K,) bool: whether leaves may overlap regions: no line along the leaves' own sides separates them."""
    corners = over.across[:, CORNERS]
    middles = (corners + np.roll(corners, -1, axis=1)) / 2
    outline = outline.take(over.owners, axis=2)
    excess = over.excess + margin
    aside = _are_aside(over.across, middles[:, 0] - middles[:, 2], outline, excess)
    return ~(aside | _are_aside(over.across, middles[:, 1] - middles[:, 3], outline, excess))


def _unit_sides_over(
    pieces: BezierPieces, over: Over, outline: FloatArray, margin: float
) -> tuple[IndexArray, IndexArray]:
    """The leaves and their sides that may be part of a unit's edge over the region."""
    rows, which = np.nonzero(pieces.sides[over.leaves] != NONE)
    excess = over.excess[rows] + margin
    along = over.inside[:, SIDES[which].T, rows]
    left = np.flatnonzero(~(along.max(axis=1) < -excess).any(axis=0))
    rows, which, excess = rows[left], which[left], excess[left]
    points = over.across[:, SIDES[which].T, rows]
    aside = _are_aside(points, points[:, 3] - points[:, 0], outline.take(over.owners[rows], axis=2), excess)
    return rows[~aside], which[~aside]


def _are_aside(points: FloatArray, chords: FloatArray, outline: FloatArray, excess: FloatArray) -> BoolArray:
    """(K,) bool: whether points (2, m, K) lie on one side of outlines (2, 6, K), seen along the chords (2, K)."""
    lengths = np.maximum(np.hypot(*chords), np.finfo(float).tiny)
    x, y = -chords[1] / lengths, chords[0] / lengths
    there = x * points[0] + y * points[1]
    here = x * outline[0] + y * outline[1]
    return (there.min(axis=0) - excess > here.max(axis=0)) | (there.max(axis=0) + excess < here.min(axis=0))


def _heights(
    regions: Regions, over: Over, covered: BoolArray, goals: FloatArray, margin: float
) -> tuple[FloatArray, IndexArray]:
    """(n,) twice: the largest heights over covered parts, and their leaves, as in ``over_pieces``."""
    _, _, steepness, unevenness = plane_functionals(regions.normals, regions.corners, regions.directions)
    owners = over.owners
    inward = applied(regions.axes, regions.sides.inward.swapaxes(0, 1)).swapaxes(0, 1)
    views = Views(
        inside=over.inside,
        heights=over.heights,
        inward=inward.take(owners, axis=2),
        places=over.across[:, CORNERS],
        excess=over.excess,
        steepness=steepness[owners],
        unevenness=unevenness[owners],
        factors=over.factors,
    )
    return largest_of_each(views, owners, over.leaves, covered, goals, margin)


def _moved_inwards(
    regions: Regions, covering: Covering, chosen: IndexArray, goals: FloatArray, margin: float
) -> tuple[IndexArray, Regions]:
    """The chosen regions that lie inside the border when moved by less than the goals, and the moved regions."""
    over, (rows, sides) = covering.over, covering.border
    owners, count = over.owners[rows], len(goals)
    points = over.across[:, SIDES[sides].T, rows]
    chords = points[:, 3] - points[:, 0]
    inward = np.stack([-chords[1], chords[0]])
    middles = over.across[:, CORNERS][:, :, rows].mean(axis=1) - points[:, 0]
    inward *= np.sign((inward * middles).sum(axis=0))
    lengths = np.bincount(owners, np.hypot(*chords), count)
    total = np.stack([np.bincount(owners, part, count) for part in inward])
    straight = np.hypot(*total)
    towards = total / np.maximum(straight, np.finfo(float).tiny)
    beyond = (points * towards[:, None, owners]).sum(axis=0).max(axis=0) + over.excess[rows]
    farthest = np.full(count, -np.inf)
    np.maximum.at(farthest, owners, beyond)
    moved = np.maximum(MOVED_MORE * (farthest - regions.least(towards)), 0.0) + 4 * margin
    chosen = chosen[(moved[chosen] < goals[chosen]) & (straight[chosen] > LEAST_STRAIGHTNESS * lengths[chosen])]
    return chosen, regions.at(chosen).move(towards[:, chosen], moved[chosen])


def _is_beyond_border(regions: Regions, covering: Covering, margin: float) -> BoolArray:
    """(n,) bool: whether the parts, moved, lie inside all of the border over their regions."""
    over, (rows, sides) = covering.over, covering.border
    owners = over.owners[rows]
    points = over.across[:, SIDES[sides].T, rows]
    along = (points * regions.towards[:, None, owners]).sum(axis=0).max(axis=0)
    farthest = np.full(regions.count, -np.inf)
    np.maximum.at(farthest, owners, along + over.excess[rows])
    # Places have moved with the parts, so corners seen from them lie further back by the same distance.
    return farthest + margin < regions.least(regions.towards) + regions.moved


def _leaves_over(
    pieces: BezierPieces, sides: SideViews, owners: IndexArray, nodes: IndexArray, margin: float
) -> tuple[IndexArray, IndexArray]:
    """The leaves of units that may lie over parts, and the parts: units are the first pieces, and parents contain their
    children."""
    found = [(owners[:0], nodes[:0])]
    while len(owners):
        low, high = columns(pieces.low[nodes]), columns(pieces.high[nodes])
        middle, half = (low + high) / 2, (high - low) / 2
        over = sides.at(owners)
        inside = over.offsets + products(over.inward, middle) + products(np.abs(over.inward), half)
        is_over = (inside >= -margin).all(axis=0)
        owners, nodes = owners[is_over], nodes[is_over]
        is_leaf = pieces.first_child[nodes] == NONE
        found.append((owners[is_leaf], nodes[is_leaf]))
        owners, nodes = np.repeat(owners[~is_leaf], 4), pieces.children(nodes[~is_leaf]).ravel()
    return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def _winds_once(over: Over, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether the borders of an odd number of leaves wind about the place where covering is counted."""
    return windings(over.owners, over.across, over.excess, count, margin) % 2 == 1


def _sheets(pieces: BezierPieces, over: Over, wanted: BoolArray, margin: float) -> Iterator[tuple[Over, BoolArray]]:
    """The leaves that face along the direction, and then those against it, over wanted (n,) regions without other
    leaves; each with (n,) bool, whether the leaves cover the region. docs/deviation.md, Sheets."""
    over = over.at(wanted[over.owners])
    faces = facing(over.across, over.excess, margin)
    sides = pieces.sides[over.leaves]
    joins = ((sides == NONE) | pieces.is_smooth_edge[sides]).all(axis=1)
    is_known = wanted.copy()
    is_known[over.owners[(faces == 0) | ~joins]] = False
    for way in (1, -1):
        sheet = over.at((faces == way) & is_known[over.owners])
        wound = windings(sheet.owners, sheet.across, sheet.excess, len(wanted), margin)
        yield sheet, is_known & (wound != 0)
