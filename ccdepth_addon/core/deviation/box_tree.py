# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around things, in a tree along a space-filling curve, and the overlaps of two trees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import squared_norms

BRANCHES = 8

# The number of things beside a point along the curve whose middles are tried as the nearest.
TRIED = 6

# Points farther than ``FAR`` times the usual size of the first ``SEEN`` boxes are handled one by one.
FAR, SEEN = 4.0, 1 << 12

# Steps along each axis of the curve.
CURVE_BITS = 20


@dataclass(frozen=True)
class BoxTree:
    """A tree of boxes. order: (N,) intp, the things along the curve; codes: (N,) their places on the curve, ascending.
    levels: boxes (low, high), (n, 3) each, first of the things in this order, then each around ``BRANCHES`` boxes of
    the level before. origin, step: of the curve's cells."""

    order: IndexArray
    codes: NDArray[np.uint64]
    levels: list[tuple[FloatArray, FloatArray]]
    origin: FloatArray
    step: float

    @staticmethod
    def around(low: FloatArray, high: FloatArray) -> BoxTree:
        """The tree of boxes. low, high: (N, 3) float64, at least one box."""
        centres = (low + high) / 2
        origin = centres.min(axis=0)
        extent = float(np.ptp(centres, axis=0).max())
        step = (extent if extent > 0 else 1.0) / ((1 << CURVE_BITS) - 1)
        codes = curve_codes(centres, origin, step)
        order = np.argsort(codes, kind="stable")
        levels = [(low[order], high[order])]
        while len(levels[-1][0]) > BRANCHES:
            starts = np.arange(0, len(levels[-1][0]), BRANCHES)
            below = levels[-1]
            levels.append((np.minimum.reduceat(below[0], starts), np.maximum.reduceat(below[1], starts)))
        return BoxTree(order, codes[order], levels, origin, step)

    def beside(self, points: FloatArray) -> IndexArray:
        """(P,) intp: the thing next to each point (P, 3) along the curve, often the nearest thing."""
        places = np.searchsorted(self.codes, curve_codes(points, self.origin, self.step))
        low, high = self.levels[0]
        best, least = np.zeros(len(points), dtype=np.intp), np.full(len(points), np.inf)
        for step in range(-(TRIED // 2), TRIED - TRIED // 2):
            slots = np.clip(places + step, 0, len(self.order) - 1)
            between = points - (low[slots] + high[slots]) / 2
            squares = squared_norms(between)
            nearer = squares < least
            np.copyto(best, slots, where=nearer)
            np.copyto(least, squares, where=nearer)
        return self.order[best]

    def within(self, points: FloatArray, reach: FloatArray) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: points (P, 3) and all things with boxes as near to them as the nearest thing can be. reach:
        (P,), the largest distance of the nearest thing. For far points a box of that size would hold too much."""
        squares = reach * reach
        owners, nodes = (axis.ravel() for axis in np.indices((len(points), len(self.levels[-1][0]))))
        for height in range(len(self.levels) - 1, -1, -1):
            low, high = self.levels[height]
            below, above = low[nodes] - points[owners], points[owners] - high[nodes]
            least = squared_norms(np.maximum(np.maximum(below, above), 0.0))
            # Every box has something in it.
            most = squared_norms(np.maximum(np.abs(below), np.abs(above))) * (1 + 1e-12)
            np.minimum.at(squares, owners, most)
            fits = least <= squares[owners]
            owners, nodes = owners[fits], nodes[fits]
            if height:
                nodes, owners = _children(nodes, owners, len(self.levels[height - 1][0]))
        return owners, self.order[nodes]

    def near(self, points: FloatArray, reach: FloatArray) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: points (P, 3) and things, among them every possible nearest thing. reach: (P,), the largest
        distance of the nearest thing."""
        low, high = self.levels[0]
        is_far = reach > FAR * np.median(np.sqrt(squared_norms(high[:SEEN] - low[:SEEN])))
        far, close = np.flatnonzero(is_far), np.flatnonzero(~is_far)
        found = [(far[:0], far[:0])]
        if len(close):
            places, sizes = points[close], reach[close][:, None]
            owners, things = overlapping(BoxTree.around(places - sizes, places + sizes), self)
            found.append((close[owners], things))
        if len(far):
            owners, things = self.within(points[far], reach[far])
            found.append((far[owners], things))
        return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])


def overlapping(first: BoxTree, second: BoxTree) -> tuple[IndexArray, IndexArray]:
    """(K,) intp twice: the pairs of things with boxes that have a point in common."""
    heights = [len(first.levels) - 1, len(second.levels) - 1]
    counts = [len(tree.levels[height][0]) for tree, height in zip((first, second), heights, strict=True)]
    a, b = (axis.ravel() for axis in np.indices(counts))
    while True:
        (low_a, high_a), (low_b, high_b) = first.levels[heights[0]], second.levels[heights[1]]
        meet = _meet(low_a, high_a, low_b, high_b, a, b)
        a, b = a[meet], b[meet]
        if heights == [0, 0]:
            return first.order[a], second.order[b]
        if heights[0] and (heights[0] >= heights[1]):
            heights[0] -= 1
            a, b = _children(a, b, len(first.levels[heights[0]][0]))
        else:
            heights[1] -= 1
            b, a = _children(b, a, len(second.levels[heights[1]][0]))


def _meet(
    low_a: FloatArray, high_a: FloatArray, low_b: FloatArray, high_b: FloatArray, a: IndexArray, b: IndexArray
) -> IndexArray:
    """The pairs of boxes that overlap, one axis after the other."""
    left = np.arange(len(a))
    for axis in range(3):
        at_a, at_b = a[left], b[left]
        fits = low_a[:, axis][at_a] <= high_b[:, axis][at_b]
        fits &= low_b[:, axis][at_b] <= high_a[:, axis][at_a]
        left = left[fits]
    return left


def _children(parents: IndexArray, others: IndexArray, count: int) -> tuple[IndexArray, IndexArray]:
    children = (BRANCHES * parents[:, None] + np.arange(BRANCHES)).ravel()
    there = children < count
    return children[there], np.repeat(others, BRANCHES)[there]


def curve_codes(points: FloatArray, origin: FloatArray, step: float) -> NDArray[np.uint64]:
    """(P,): the places of points (P, 3) along the curve through a cube, their bits in turn (Morton, 1966)."""
    last = (1 << CURVE_BITS) - 1
    cells = (np.clip(points - origin, 0.0, last * step) / step).astype(np.uint64)
    return _spread(cells[:, 0]) | _spread(cells[:, 1]) << np.uint64(1) | _spread(cells[:, 2]) << np.uint64(2)


def _spread(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The lowest 21 bits with two zero bits between each two."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
