# SPDX-License-Identifier: GPL-3.0-or-later
"""Boxes around things, in a tree along a space-filling curve, and the overlaps of two trees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import index_chunks
from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import columns, lengths, products, squared_norms

# Of points (n, 3) and things (n,), the largest distances (n,) that the things can have.
Bounds = Callable[[FloatArray, IndexArray], FloatArray]

BRANCHES = 8

# The number of things beside a point along the curve whose middles are tried as the nearest.
TRIED = 6

# Points are far beyond this many times the usual size of boxes, which the first ``SEEN`` tell.
FAR, SEEN = 4.0, 1 << 12

# The number of points that go down the tree together: with their boxes they stay in the processor's caches.
POINTS_AT_ONCE = 1 << 9

# One of this many far points along the curve is the leader of the others.
FOLLOWERS = 8

# The relative rounding of coordinates: more than the error of a box and a distance.
ROUNDINGS = 2.0**-48

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
        origin, step = cells_around(centres)
        codes = curve_codes(centres, origin, step)
        order = np.argsort(codes, kind="stable")
        levels = [(low[order], high[order])]
        while len(levels[-1][0]) > BRANCHES:
            starts = np.arange(0, len(levels[-1][0]), BRANCHES)
            below = levels[-1]
            levels.append((np.minimum.reduceat(below[0], starts), np.maximum.reduceat(below[1], starts)))
        return BoxTree(order, codes[order], levels, origin, step)

    @cached_property
    def size(self) -> float:
        """The usual size of a box."""
        low, high = self.levels[0]
        return float(np.median(lengths(high[:SEEN] - low[:SEEN])))

    @cached_property
    def _blocks(self) -> list[FloatArray]:
        """Of each level (6, BRANCHES, n): the corners low and high of each node's boxes, infinitely far if missing."""
        found = []
        for low, high in self.levels:
            boxes = np.full((-len(low) % BRANCHES + len(low), 6), np.inf)
            boxes[: len(low)] = np.concatenate([low, high], axis=1)
            found.append(np.ascontiguousarray(boxes.reshape(-1, BRANCHES, 6).T))
        return found

    def near(self, points: FloatArray, bounds: Bounds) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: points (P, 3), ascending, and things, among them every possible nearest thing."""
        return self.within(points, self._reach(points, bounds))

    def within(self, points: FloatArray, reach: FloatArray) -> tuple[IndexArray, IndexArray]:
        """(K,) intp twice: points (P, 3), ascending, and all things with boxes in reach (P,) of these."""
        found = [(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp))]
        for some in index_chunks(np.arange(len(points)), POINTS_AT_ONCE):
            owners, nodes, places, squares = some, np.zeros_like(some), columns(points[some]), reach[some] ** 2
            for blocks in reversed(self._blocks):
                boxes, at = blocks.take(nodes, axis=2), places.take(owners - some[0], axis=1)[:, None]
                apart = np.maximum(boxes[:3] - at, at - boxes[3:])
                apart = np.maximum(apart, 0.0, out=apart).swapaxes(0, 1)
                rows, child = np.nonzero((products(apart, apart) <= squares[owners - some[0]]).T)
                owners, nodes = owners[rows], BRANCHES * nodes[rows] + child
            found.append((owners, self.order[nodes]))
        return np.concatenate([part[0] for part in found]), np.concatenate([part[1] for part in found])

    def _reach(self, points: FloatArray, bounds: Bounds) -> FloatArray:
        """(P,): how far the nearest thing of each point (P, 3) can be: at most as far as a thing beside the point along
        the curve, and for far points, where any but the nearest leaves many others, as the one nearest to a leader."""
        found = bounds(points, self._beside(points))
        far = np.flatnonzero(found > FAR * self.size)
        if len(far) > FOLLOWERS:
            far = far[np.argsort(curve_codes(points[far], *cells_around(points[far])), kind="stable")]
            leaders = points[far[::FOLLOWERS]]
            owners, things = self.near(leaders, bounds)
            nearest = things[first_of_each(owners, bounds(leaders[owners], things), len(leaders))]
            found[far] = np.minimum(found[far], bounds(points[far], np.repeat(nearest, FOLLOWERS)[: len(far)]))
        # The nearest thing has to be in reach, whatever the rounding of boxes and distances.
        return found * (1 + 1e-12) + ROUNDINGS * np.abs(points).max(initial=0.0) + np.finfo(float).tiny

    def _beside(self, points: FloatArray) -> IndexArray:
        """(P,) intp: the thing next to each point (P, 3) along the curve, often the nearest thing."""
        places = np.searchsorted(self.codes, curve_codes(points, self.origin, self.step))
        slots = np.clip(places[:, None] + np.arange(-(TRIED // 2), TRIED - TRIED // 2), 0, len(self.order) - 1)
        low, high = self.levels[0]
        squares = squared_norms(points[:, None] - (low[slots] + high[slots]) / 2)
        return self.order[slots[np.arange(len(points)), squares.argmin(axis=1)]]


def first_of_each(owners: IndexArray, values: FloatArray, count: int) -> IndexArray:
    """(count,) intp: the index of the least value of each owner; every owner has one."""
    least = np.full(count, np.inf)
    np.minimum.at(least, owners, values)
    found, which = np.empty(count, dtype=np.intp), np.flatnonzero(values == least[owners])
    # The first of several equal values comes last here.
    found[owners[which[::-1]]] = which[::-1]
    return found


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


def cells_around(points: FloatArray) -> tuple[FloatArray, float]:
    """The origin (3,) and the step of cells of the curve around points (P, 3)."""
    extent = float(np.ptp(points, axis=0).max())
    return points.min(axis=0), (extent if extent > 0 else 1.0) / ((1 << CURVE_BITS) - 1)


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
