# SPDX-License-Identifier: GPL-3.0-or-later
"""Sides of two drawn leaves over which the surface may be mapped to either leaf. docs/distance.md, Lemma 12."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import dot_products, lengths
from .bezier_pieces import BezierPieces
from .charts import Charts, Flaps, outwards, turn_left
from .spread import NONE

# Places in a leaf are counted along both of its sides in steps of this part; the corner where each side begins, so
# counted, and the axis along it.
PLACES = 1 << 22
FIRST, AXES = np.array([0, 1, 3, 0]), np.array([0, 1, 0, 1])

# The corner opposite each side in its triangle, with the diagonal from corner 0 to 2; the one off the diagonal there.
OPPOSITE, ASIDE = np.array([2, 0, 0, 2]), np.array([1, 1, 3, 3])

# A flap takes this part of the turn of its chart's border at both ends of its side, between these angles; and its tip
# is at most this many times as far from the diagonal as the leaf's own corner.
SHARE_OF_TURN, FLATTEST, STEEPEST, FARTHEST_TIP = 0.45, 2.0**-20, np.pi / 4, 2.0

# Places nearer to a side than this part of a chart's size may be beyond it.
MARGIN = 2.0**-40


@dataclass(frozen=True)
class OpenSides:
    """J open sides of K leaves with charts. beside: (K, 4) intp, the leaf across each side of the charts, or NONE where
    the side is not open. of_edges: (E,) intp, the open side at each edge of the units, or NONE. leaves: (J, 2) intp,
    both leaves at each. kites: charts of both flaps at each, the diagonal along the side. origins, along, aside:
    (J, 2, 2), the start of the side in the charts of both leaves, and the axes of the kite there. axes: (J, 2) intp,
    the axis of both leaves along the side; is_backward: (J, 2) bool, whether the side goes against it."""

    beside: IndexArray
    of_edges: IndexArray
    leaves: IndexArray
    kites: Charts
    origins: FloatArray
    along: FloatArray
    aside: FloatArray
    axes: IndexArray
    is_backward: BoolArray

    @staticmethod
    def none(charts: Charts, pieces: BezierPieces) -> OpenSides:
        """None of the sides of leaves."""
        count, pairs = len(charts.corners), np.empty((0, 2), dtype=np.intp)
        beside, of_edges = np.full((count, 4), NONE), np.full(pieces.unit_mesh.edge_count, NONE)
        places, kites = np.empty((0, 2, 2)), charts.at(pairs[:, 0])
        return OpenSides(beside, of_edges, pairs, kites, places, places, places, pairs, pairs == NONE)

    @staticmethod
    def of(charts: Charts, pieces: BezierPieces, is_turned: BoolArray, may_open: BoolArray) -> tuple[OpenSides, Charts]:
        """The open sides of leaves, and the charts with flaps there. may_open: (K,) bool, leaves whose sides may be.
        pieces, is_turned: as of ``mapped_bounds``."""
        mesh = pieces.unit_mesh
        own_sides = (np.arange(4) + is_turned[:, None]) % 4
        edges, vertices = (
            np.take_along_axis(each.reshape(-1, 4), own_sides, axis=1)
            for each in (mesh.corner_edges, mesh.corner_vertices)
        )
        both = pieces.edge_units
        is_open = (both != NONE).all(axis=1) & (both[:, 0] != both[:, 1])
        own = np.flatnonzero(is_open & (may_open & charts.is_unfolded)[both].all(axis=1))
        leaves = both[own]
        sides = (edges[leaves] == own[:, None, None]).argmax(axis=2)
        tips, places = _tips(charts, leaves, sides)
        is_open, kites = _are_convex(charts, leaves, sides, tips, places)
        own, leaves, sides = own[is_open], leaves[is_open], sides[is_open]
        charts = replace(charts, flaps=_flaps(charts, leaves, sides, tips[is_open], places[is_open]))
        beside, of_edges = np.full((len(edges), 4), NONE), np.full(mesh.edge_count, NONE)
        beside[leaves, sides], of_edges[own] = leaves[:, ::-1], np.arange(len(own))
        start = vertices[leaves[:, :1], sides[:, :1]]
        is_forward = vertices[leaves, sides] == start
        towards = _directions(charts)[leaves, sides]
        first = mesh.corner_vertices.reshape(-1, 4)[leaves, FIRST[own_sides[leaves, sides]]]
        opened = OpenSides(
            beside,
            of_edges,
            leaves,
            kites.at(np.flatnonzero(is_open)),
            charts.places[leaves, np.where(is_forward, sides, (sides + 1) % 4)],
            np.where(is_forward[..., None], towards, -towards),
            outwards(towards) * np.array([[1.0], [-1.0]]),
            AXES[own_sides[leaves, sides]],
            first != start,
        )
        return opened, charts

    def reached(self, charts: Charts, leaves: IndexArray, images: FloatArray, edges: IndexArray) -> IndexArray:
        """(N, 8) intp, or (N, 0) without open sides: the leaves across these that images (N, 4, 2) of cells in leaves
        (N,) may lie over, or that the cells lie beside, and NONE. edges: (N, 4) intp, of the units below the cells'
        sides, or NONE."""
        if not len(self.leaves):
            return np.empty((len(leaves), 0), dtype=np.intp)
        found = np.full((len(leaves), 8), NONE)
        margin = MARGIN * np.abs(charts.places).max(axis=(1, 2))[leaves]
        for own, flaps in enumerate(charts.flaps):
            over = np.flatnonzero(flaps.heights(images, leaves).max(axis=1) >= -margin)
            found[over, own] = self.beside[leaves[over], own]
        which = np.where(edges == NONE, NONE, self.of_edges[edges])
        cell, side = np.nonzero(which != NONE)
        both = self.leaves[which[cell, side]]
        found[cell, 4 + side] = both[np.arange(len(cell)), (both[:, 0] == leaves[cell]).astype(np.intp)]
        return found

    def steps(self, which: IndexArray, way: IndexArray, places: IndexArray) -> IndexArray:
        """(n,): how far along open sides (n,) places (n,) in one of their leaves are. way: (n,) intp, in which."""
        steps = np.stack(np.divmod(places, PLACES))[self.axes[which, way], np.arange(len(which))]
        return np.where(self.is_backward[which, way], PLACES // 2 - steps, steps)

    def images(self, which: IndexArray, way: IndexArray, places: FloatArray) -> FloatArray:
        """(n, 2): the places in charts of leaves for places (n, 2) in the kites. which, way: as of ``steps``."""
        found: FloatArray = self.origins[which, way] + places[:, :1] * self.along[which, way]
        return found + places[:, 1:] * self.aside[which, way]


def _directions(charts: Charts) -> FloatArray:
    """(K, 4, 2): of the charts' sides."""
    found = np.roll(charts.places, -1, axis=1) - charts.places
    return found / np.hypot(found[..., :1], found[..., 1:])


def _tips(charts: Charts, leaves: IndexArray, sides: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(J, 2, 3): the tips of the flaps beyond sides (J, 2) of charts of leaves (J, 2); and (J, 2, 2), their places."""
    towards = _directions(charts)
    before = np.roll(towards, 1, axis=1)
    turns = np.arctan2((outwards(towards) * before).sum(axis=2), (towards * before).sum(axis=2))
    slopes = np.tan(np.clip(SHARE_OF_TURN * turns, FLATTEST, STEEPEST))
    start, end = (charts.corners[leaves, each] for each in (sides, (sides + 1) % 4))
    length = lengths(end - start)[..., None]
    along = (end - start) / length
    off = charts.corners[leaves[:, ::-1], OPPOSITE[sides[:, ::-1]]] - start
    share = dot_products(off, along)[..., None]
    height = lengths(off - share * along)[..., None]
    # Neither angle of a flap is larger than the triangle's.
    at_start = np.maximum(1 / slopes[leaves, sides][..., None], share / height)
    at_end = np.maximum(1 / slopes[leaves, (sides + 1) % 4][..., None], (length - share) / height)
    beyond = length / (at_start + at_end)
    tips = start + beyond * at_start * along + beyond / height * (off - share * along)
    towards = towards[leaves, sides]
    return tips, charts.places[leaves, sides] + beyond * at_start * towards + beyond * outwards(towards)


def _are_convex(
    charts: Charts, leaves: IndexArray, sides: IndexArray, tips: FloatArray, places: FloatArray
) -> tuple[BoolArray, Charts]:
    """(J,) bool: whether the charts of both leaves are convex with all of their flaps, and so is the kite of both flaps
    at each side; and the charts of kites. tips, places: as of ``_tips``."""
    corners = charts.places
    around = np.stack([corners, (corners + np.roll(corners, -1, axis=1)) / 2], axis=2)
    around[leaves, sides, 1] = places
    turns = np.roll(turn_left(around.reshape(-1, 8, 2)), 1, axis=1).reshape(-1, 4, 2)
    has_flap = np.zeros((len(corners), 4), dtype=bool)
    has_flap[leaves, sides] = True
    fits = turns[..., 0].all(axis=1) & (turns[..., 1] | ~has_flap).all(axis=1)
    is_near = np.abs(places[..., 1]) <= FARTHEST_TIP * np.abs(corners[leaves, ASIDE[sides], 1])
    first, last = (charts.corners[leaves[:, 0], each] for each in (sides[:, 0], (sides[:, 0] + 1) % 4))
    kites = Charts.over(np.stack([first, tips[:, 1], last, tips[:, 0]], axis=1), np.zeros(len(leaves), dtype=bool))
    return fits[leaves].all(axis=1) & is_near.all(axis=1) & kites.is_unfolded, kites


def _flaps(
    charts: Charts, leaves: IndexArray, sides: IndexArray, tips: FloatArray, places: FloatArray
) -> tuple[Flaps, ...]:
    """The flaps beyond each of the four sides of charts. tips, places: as of ``_tips``."""
    towards, found = _directions(charts), []
    for side in range(4):
        here = sides == side
        own = leaves[here]
        is_there = np.zeros(len(towards), dtype=bool)
        is_there[own] = True
        corners, folds = np.zeros((len(towards), 3, 3)), np.zeros((len(towards), 3))
        corners[:, :2], corners[own, 2] = charts.corners[:, [side, (side + 1) % 4]], tips[here]
        flaps = Flaps(is_there, charts.places[:, side], towards[:, side], corners, folds)
        at = places[here][:, None]
        folds[own] = (tips[here] - charts.points(at, own)[:, 0]) / flaps.heights(at, own)
        found.append(flaps)
    return tuple(found)
