# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts of triangles that the surface covers, seen along the normal. docs/deviation.md, Covering and Borders.

The surface is looked at in units, which meet in edges. Where the border of the surface lies over a part, a point of the
part that is not covered has the border nearby, in the direction in which it has to be moved to be covered.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .bezier_pieces import CORNERS, NONE, SIDES, BezierPieces
from .heights import SideViews, Views, axes_across, plane_functionals
from .triangles import dot

# Where in a triangle covering is counted: weights of corners without anything symmetric about them.
PLACE_IN_TRIANGLE = np.array([0.4137, 0.3271, 0.2592])

# An excess beyond this part of what is wanted stands in the way.
EXCESS_SHARE = 0.02

# The border has to run about one way: the sum of its parts is no shorter than this part of the sum of their lengths.
LEAST_STRAIGHTNESS = 0.8

# Regions are found not to be covered where units would have to be looked at farther than so many from the first.
MOST_UNITS_ACROSS = 8

# Parts are moved this much more than the border that was seen first demands.
MOVED_MORE = 1.02


@dataclass(frozen=True)
class Regions:
    """n parts of triangles as seen along their normals. corners: (n, 3, 3); normals: (n, 3). sides: of the regions,
    which hold the parts and these moved. axes: (n, 2, 3), across. places: (n, 3), where covering is counted. towards:
    (n, 2), the direction across in which parts are moved, and moved: (n,) how far."""

    corners: FloatArray
    normals: FloatArray
    sides: SideViews
    axes: FloatArray
    places: FloatArray
    towards: FloatArray
    moved: FloatArray

    @staticmethod
    def of(corners: FloatArray, normals: FloatArray, margin: float) -> Regions:
        """The parts alone, not moved."""
        axes = axes_across(normals, corners[:, 1] - corners[:, 0])
        places = np.einsum("c,ncd->nd", PLACE_IN_TRIANGLE, corners)
        sides = SideViews.of(corners, normals, margin)
        count = len(corners)
        return Regions(corners, normals, sides, axes, places, np.zeros((count, 2)), np.zeros(count))

    def at(self, chosen: IndexArray) -> Regions:
        """Some of them."""
        sides = SideViews(self.sides.inward[chosen], self.sides.offsets[chosen])
        rest = (column[chosen] for name, column in vars(self).items() if name != "sides")
        corners, normals, *others = rest
        return Regions(corners, normals, sides, *others)

    def move(self, towards: FloatArray, moved: FloatArray) -> Regions:
        """With the parts moved in these directions (n, 2), so far (n,)."""
        steps = np.einsum("nd,ndi->ni", towards, self.axes) * moved[:, None]
        outwards = np.maximum(-dot(self.sides.inward, steps[:, None]), 0.0)
        sides = SideViews(self.sides.inward, self.sides.offsets + outwards)
        return replace(self, sides=sides, places=self.places + steps, towards=towards, moved=moved)

    def least(self, towards: FloatArray) -> FloatArray:
        """(n,): how far in these directions (n, 2) the last of the part lies, seen from ``places``."""
        across = np.einsum("ndi,nci->ncd", self.axes, self.corners - self.places[:, None])
        return np.einsum("ncd,nd->nc", across, towards).min(axis=1)

    def outline(self) -> FloatArray:
        """(n, 6, 2): points across, seen from ``places``, whose hull is the region: the part, and this moved."""
        moved = np.einsum("ndi,nci->ncd", self.axes, self.corners - self.places[:, None])
        return np.concatenate([moved, moved + (self.towards * self.moved[:, None])[:, None]], axis=1)


@dataclass(frozen=True)
class Covering:
    """What lies over n regions: K leaves, owners and leaves: (K,) intp. inside: (K, 3, 16), heights: (K, 16), across:
    (K, 2, 16) from the place where covering is counted; excess: (K,). has_partners: (n,) bool, whether units meet
    others at all edges over the region but the border's. border: (b,) intp twice, which of the K and which of its
    sides is border over the region."""

    owners: IndexArray
    leaves: IndexArray
    inside: FloatArray
    heights: FloatArray
    across: FloatArray
    excess: FloatArray
    has_partners: BoolArray
    border: tuple[IndexArray, IndexArray]


def over_pieces(
    pieces: BezierPieces,
    corners: FloatArray,
    normals: FloatArray,
    first: IndexArray,
    goals: FloatArray,
    margin: float,
) -> tuple[FloatArray, IndexArray, IndexArray]:
    """(n,) how far parts of triangles are from the surface at most, infinite where it may not cover them; (n,) the leaf
    that was found with; and (m,) leaves whose excess stands in the way.

    corners: (n, 3, 3); normals: (n, 3), of their triangles; first: (n,) intp, a unit near each. goals: (n,), bounds
    below these are as good. margin: what rounding can hide.
    """
    regions = Regions.of(corners, normals, margin)
    covering = _covering(pieces, regions, first, margin)
    at_border = np.zeros(len(corners), dtype=bool)
    at_border[covering.owners[covering.border[0]]] = True
    covered = covering.has_partners & ~at_border & _winds_once(covering, len(corners), margin)
    upper, worst, blamed = _heights(regions, covering, covered, goals, margin)
    chosen = np.flatnonzero(covering.has_partners & at_border)
    if len(chosen):
        chosen, moved = _moved_inwards(regions, covering, chosen, goals, margin)
    if len(chosen):
        covering = _covering(pieces, moved, first[chosen], margin)
        covered = covering.has_partners & _winds_once(covering, len(chosen), margin)
        covered &= _is_beyond_border(moved, covering, margin)
        found, leaves, more = _heights(moved, covering, covered, goals[chosen], margin)
        upper[chosen], worst[chosen] = np.hypot(found, moved.moved), leaves
        blamed = np.concatenate([blamed, more])
    return upper, worst, np.unique(blamed)


def _covering(pieces: BezierPieces, regions: Regions, first: IndexArray, margin: float) -> Covering:
    """What lies over the regions of the units (n,) where looking begins, of those that meet them there, and so on."""
    sides, count = regions.sides, len(regions.corners)
    plane, offsets, _, _ = plane_functionals(regions.normals, regions.corners, regions.normals)
    functionals = np.concatenate([sides.inward, plane[:, None], regions.axes], axis=1)
    constants = np.concatenate(
        [sides.offsets, offsets[:, None], -np.einsum("nij,nj->ni", regions.axes, regions.places)], axis=1
    )
    outline = regions.outline()
    known = np.arange(count) * pieces.unit_count + first
    new, found, borders, alone, at = known, [], [], [], 0
    for _ in range(MOST_UNITS_ACROSS):
        owners, leaves = _leaves_over(pieces, sides, (new // pieces.unit_count, new % pieces.unit_count), margin)
        coefficients, excess = pieces.coefficients[leaves], pieces.excess[leaves]
        values = functionals[owners] @ coefficients + constants[owners][:, :, None]
        are_over = ~(values[:, :3].max(axis=2) + excess[:, None] + margin < 0).any(axis=1)
        owners, leaves, excess, values = (array[are_over] for array in (owners, leaves, excess, values))
        corners = values[:, 4:][:, :, CORNERS]
        middles = (corners + np.roll(corners, -1, axis=2)) / 2
        for side in range(2):
            chords = middles[:, :, side] - middles[:, :, side + 2]
            are_over = ~_are_aside(values[:, 4:], chords, outline[owners], excess + margin)
            owners, leaves, excess, values = (array[are_over] for array in (owners, leaves, excess, values))
            middles = middles[are_over]
        rows, which = _unit_sides_over(pieces, (owners, leaves, excess, values), outline, margin)
        edges = pieces.sides[leaves[rows], which]
        is_border = pieces.unit_mesh.edge_face_counts[edges] == 1
        found.append((owners, leaves, values, excess))
        borders.append((rows[is_border] + at, which[is_border]))
        at += len(owners)
        units = np.where(is_border[:, None], pieces.units[leaves[rows]][:, None], pieces.edge_units[edges])
        wanted = owners[rows][:, None] * pieces.unit_count + units
        new = np.setdiff1d(wanted[units != NONE], known)
        known = np.union1d(known, new)
        alone.append(owners[rows[(units == NONE).any(axis=1)]])
        if not len(new):
            break
    has_partners = np.ones(count, dtype=bool)
    has_partners[np.concatenate([*alone, new // pieces.unit_count])] = False
    owners, leaves, values, excess = (np.concatenate(column) for column in zip(*found, strict=True))
    border = tuple(np.concatenate(column) for column in zip(*borders, strict=True))
    return Covering(owners, leaves, values[:, :3], values[:, 3], values[:, 4:], excess, has_partners, border)


def _unit_sides_over(
    pieces: BezierPieces,
    leaves_over: tuple[IndexArray, IndexArray, FloatArray, FloatArray],
    outline: FloatArray,
    margin: float,
) -> tuple[IndexArray, IndexArray]:
    """Which of these leaves, and which of their sides, may be part of a unit's edge over the region."""
    owners, leaves, excess, values = leaves_over
    rows, which = np.nonzero(pieces.sides[leaves] != NONE)
    along = values[rows[:, None, None], np.arange(3)[:, None], SIDES[which][:, None]]
    apart = (along.max(axis=2) + (excess[rows] + margin)[:, None] < 0).any(axis=1)
    rows, which = rows[~apart], which[~apart]
    points = values[rows[:, None, None], np.arange(4, 6)[:, None], SIDES[which][:, None]]
    chords = points[:, :, 3] - points[:, :, 0]
    aside = _are_aside(points, chords, outline[owners[rows]], excess[rows] + margin)
    return rows[~aside], which[~aside]


def _are_aside(points: FloatArray, chords: FloatArray, outline: FloatArray, excess: FloatArray) -> BoolArray:
    """(K,) bool: whether points (K, 2, m) lie on one side of outlines (K, 6, 2), seen along the chords (K, 2)."""
    normals = np.stack([-chords[:, 1], chords[:, 0]], axis=1)
    lengths = np.hypot(*chords.T)
    normals /= np.maximum(lengths, np.finfo(float).tiny)[:, None]
    there = normals[:, :1] * points[:, 0] + normals[:, 1:] * points[:, 1]
    here = (outline * normals[:, None]).sum(axis=2)
    return (there.min(axis=1) - excess > here.max(axis=1)) | (there.max(axis=1) + excess < here.min(axis=1))


def _heights(
    regions: Regions, covering: Covering, covered: BoolArray, goals: FloatArray, margin: float
) -> tuple[FloatArray, IndexArray, IndexArray]:
    """(n,), (n,) and (m,): the largest heights over what is covered, and leaves, as in ``over_pieces``."""
    owners, leaves = covering.owners, covering.leaves
    _, _, steepness, unevenness = plane_functionals(regions.normals, regions.corners, regions.normals)
    chosen = np.flatnonzero(covered[owners])
    blamed = leaves[~covered[owners] & (covering.excess > 0)]
    owners, leaves = owners[chosen], leaves[chosen]
    views = Views(
        inside=covering.inside[chosen],
        heights=covering.heights[chosen],
        inward=(regions.sides.inward @ regions.axes.swapaxes(1, 2))[owners],
        places=covering.across[chosen][:, :, CORNERS],
        excess=covering.excess[chosen],
        steepness=steepness[owners],
        unevenness=unevenness[owners],
    )
    found = views.largest_heights(goals[owners], margin)
    upper, worst = np.full(len(goals), np.inf), np.full(len(goals), NONE)
    upper[covered] = 0.0
    np.maximum.at(upper, owners, found)
    at_most = found == upper[owners]
    worst[owners[at_most]] = leaves[at_most]
    too_much = (views.excess > EXCESS_SHARE * goals[owners]) & (found > goals[owners])
    return upper, worst, np.concatenate([blamed, leaves[too_much]])


def _moved_inwards(
    regions: Regions, covering: Covering, chosen: IndexArray, goals: FloatArray, margin: float
) -> tuple[IndexArray, Regions]:
    """Which of the chosen regions need to be moved by less than the goals to lie inside the border, and these moved."""
    rows, sides = covering.border
    owners, count = covering.owners[rows], len(goals)
    points = covering.across[rows[:, None, None], np.arange(2)[:, None], SIDES[sides][:, None]]
    chords = points[:, :, 3] - points[:, :, 0]
    inward = np.stack([-chords[:, 1], chords[:, 0]], axis=1)
    middles = covering.across[rows][:, :, CORNERS].mean(axis=2) - points[:, :, 0]
    inward *= np.sign((inward * middles).sum(axis=1))[:, None]
    lengths = np.bincount(owners, np.hypot(*chords.T), count)
    total = np.stack([np.bincount(owners, inward[:, axis], count) for axis in range(2)], axis=1)
    straight = np.hypot(*total.T)
    towards = total / np.maximum(straight, np.finfo(float).tiny)[:, None]
    beyond = (points * towards[owners][:, :, None]).sum(axis=1).max(axis=1) + covering.excess[rows]
    farthest = np.full(count, -np.inf)
    np.maximum.at(farthest, owners, beyond)
    moved = np.maximum(MOVED_MORE * (farthest - regions.least(towards)), 0.0) + 4 * margin
    chosen = chosen[(moved[chosen] < goals[chosen]) & (straight[chosen] > LEAST_STRAIGHTNESS * lengths[chosen])]
    return chosen, regions.at(chosen).move(towards[chosen], moved[chosen])


def _is_beyond_border(regions: Regions, covering: Covering, margin: float) -> BoolArray:
    """(n,) bool: whether the parts, moved, lie inside all of the border over their regions."""
    rows, sides = covering.border
    owners = covering.owners[rows]
    points = covering.across[rows[:, None, None], np.arange(2)[:, None], SIDES[sides][:, None]]
    along = (points * regions.towards[owners][:, :, None]).sum(axis=1).max(axis=1)
    farthest = np.full(len(regions.moved), -np.inf)
    np.maximum.at(farthest, owners, along + covering.excess[rows])
    # Places have been moved with the parts, so that corners seen from them lie so much further back.
    return farthest + margin < regions.least(regions.towards) + regions.moved


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


def _winds_once(covering: Covering, count: int, margin: float) -> BoolArray:
    """(count,) bool: whether the borders of an odd number of leaves wind about the place where covering is counted.

    A border may be drawn straight from corner to corner where no side's hull contains the origin.
    """
    owners, across, excess = covering.owners, covering.across, covering.excess + margin
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
