# SPDX-License-Identifier: GPL-3.0-or-later
"""The heights of a Bézier piece over the plane of a triangle, along a direction, where the piece lies over the
triangle.

Heights over a plane, and distances inside each of a triangle's sides, are linear functionals of the surface, so their
Bernstein coefficients bound them. The part of a piece beyond a side does not count: over the triangle, for every weight
that is not negative, the height is at most its sum with the weighted distance inside, and this sum is bounded instead.
docs/deviation.md, Heights. All arrays have their N things last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import crosses, products
from ..surface.bicubic import CORNERS
from .spread import NONE

# A side of a triangle has no side to speak of when it is seen at less than this sine.
STEEP = 1e-3

# The least cosine of a triangle's lean for heights over it.
LEANING = 0.1

# Weights beyond this one only magnify rounding.
LARGEST_WEIGHT = 4.0

PAIRS_OF_SIDES = ((0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class SideViews(Table, axis=-1):
    """N triangles seen along directions. inward: (3, 3, N), for each side a unit vector across the direction, inwards;
    zero where a side is seen end on, or the third corner lies too near its line. offsets: (3, N); ``inward · x +
    offsets`` is the distance of x inside."""

    inward: FloatArray
    offsets: FloatArray

    @staticmethod
    def of(corners: FloatArray, directions: FloatArray, margin: float) -> SideViews:
        """Triangles seen along directions. corners: (3, 3, N), each with its coordinates; directions: (3, N) unit
        vectors; margin: the rounding allowance."""
        along = corners[[1, 2, 0]] - corners
        across = crosses(directions, along)
        squares = products(across, across)
        seen = squares > STEEP**2 * products(along, along)
        scales = np.divide(1.0, np.sqrt(squares), out=np.zeros_like(squares), where=seen)
        # The signed distance of the third corner from each side.
        third = products(across, along[[1, 2, 0]]) * scales
        scales = np.where(np.abs(third) > 8 * margin, np.copysign(scales, third), 0.0)
        inward = across * scales[:, None]
        return SideViews(inward, -products(inward, corners))


@dataclass(frozen=True)
class Views(Table, axis=-1):
    """N pairs of a Bézier piece and a triangle, seen along a direction, in coefficients (Bernstein).

    inside: (3, 16, N), distances inside each side. heights: (16, N), over the triangle's plane along the direction.
    inward: (3, 2, N), the directions inwards; places: (2, 4, N), the piece's corners, in coordinates across. excess:
    (N,), of the piece. steepness: (N,), the ratio of a height to the distance from the plane. unevenness: (N,), the
    largest distance of the triangle's corners from the plane. factors: (N,), the least factor on the tolerance over the
    piece.
    """

    inside: FloatArray
    heights: FloatArray
    inward: FloatArray
    places: FloatArray
    excess: FloatArray
    steepness: FloatArray
    unevenness: FloatArray
    factors: FloatArray

    def largest_heights(self, goals: FloatArray, margin: float) -> FloatArray:
        """(N,): bounds of the heights, along the direction, of the piece over the triangle; for bounds beyond the goals
        (N,), without the parts beside the triangle."""
        is_steep = np.isinf(self.steepness)
        allowed = (self.excess + self.unevenness) * np.where(is_steep, 0.0, self.steepness)
        limits = np.maximum(goals - allowed, 0.0)
        may_clip = (self.inside.min(axis=1).min(axis=0) < 0) & ~is_steep
        bounds = np.zeros(len(allowed))
        for sign, largest in ((1.0, self.heights.max(axis=0)), (-1.0, -self.heights.min(axis=0))):
            chosen = np.flatnonzero(may_clip & (largest > limits))
            if len(chosen):
                largest[chosen] = self.at(chosen)._clipped(sign, limits[chosen], margin)
            np.maximum(bounds, largest, out=bounds)
        bounds += allowed
        bounds[is_steep] = np.inf
        return bounds

    def _clipped(self, sign: float, limits: FloatArray, margin: float) -> FloatArray:
        """(N,): bounds of heights upwards, or downwards, with other weights where the first do not reach the limits."""
        rises = sign * self._slopes()
        heights = sign * self.heights
        bounds = np.minimum(heights.max(axis=0), self._weighted(heights, self._level_across_two(rises), margin))
        left = np.flatnonzero(bounds > limits)
        if len(left):
            rest, heights, rises = self.at(left), heights.take(left, axis=1), rises.take(left, axis=1)
            bounds[left] = np.minimum(bounds[left], rest._level_across_one(heights, rises, margin))
        return bounds

    def _level_across_two(self, rises: FloatArray) -> FloatArray:
        """(3, N): weights of two sides that make the sum level; every direction lies between those of two sides."""
        weights = np.zeros((3, len(self.excess)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for one, other in PAIRS_OF_SIDES:
                first, second = self.inward[one], self.inward[other]
                turn = -_cross(first, second)
                of_one, of_other = _cross(rises, second) / turn, _cross(first, rises) / turn
                used = (of_one > 0) & (of_other > 0)
                np.copyto(weights[one], of_one, where=used)
                np.copyto(weights[other], of_other, where=used)
        return np.minimum(weights, LARGEST_WEIGHT)

    def _level_across_one(self, heights: FloatArray, rises: FloatArray, margin: float) -> FloatArray:
        bounds = np.full(len(self.excess), np.inf)
        for side in range(3):
            fall = -(self.inward[side] * rises).sum(axis=0)
            weight = np.clip(fall, 0.0, LARGEST_WEIGHT)
            found = (heights + weight * self.inside[side]).max(axis=0) + weight * (self.excess + margin)
            np.minimum(bounds, found, out=bounds)
        return bounds

    def _weighted(self, heights: FloatArray, weights: FloatArray, margin: float) -> FloatArray:
        total = weights[0] * self.inside[0]
        total += heights
        for side in (1, 2):
            total += weights[side] * self.inside[side]
        return total.max(axis=0) + weights.sum(axis=0) * (self.excess + margin)

    def _slopes(self) -> FloatArray:
        """(2, N): the approximate slopes of the heights across, from their values at the corners."""
        heights = self.heights[CORNERS]
        (along, across), (rise_along, rise_across) = _differences(self.places), _differences(heights)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slopes = np.stack(
                [
                    rise_along * across[1] - rise_across * along[1],
                    rise_across * along[0] - rise_along * across[0],
                ]
            ) / _cross(along, across)
        return np.where(np.isfinite(slopes), slopes, 0.0)


def largest_of_each(
    views: Views, owners: IndexArray, which: IndexArray, covered: BoolArray, goals: FloatArray, margin: float
) -> tuple[FloatArray, IndexArray]:
    """The largest reduced heights (n,) in views of pairs of owners and things (K,), infinite where the things do not
    cover an owner; and the things (n,) of these heights, or NONE. covered, goals: (n,), of the owners; goals are
    reduced as well."""
    # Uncovered owners need no clipping.
    limits = np.where(covered, goals, np.inf)[owners] * views.factors
    heights = views.largest_heights(limits, margin) / views.factors
    upper, worst = np.where(covered, 0.0, np.inf), np.full(len(goals), NONE)
    np.maximum.at(upper, owners, heights)
    at_most = covered[owners] & (heights == upper[owners])
    worst[owners[at_most]] = which[at_most]
    return upper, worst


def _differences(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The differences from one side to the other, of (…, 4, N) values at the corners."""
    a, b, c, d = np.moveaxis(values, -2, 0)
    return (b + c - a - d) / 2, (c + d - a - b) / 2


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """(N,): the cross products of vectors (2, N)."""
    return one[0] * other[1] - one[1] * other[0]


def axes_across(directions: FloatArray, hints: FloatArray) -> FloatArray:
    """(2, 3, N): unit vectors across directions (3, N), the first as near to the hints (3, N) as possible."""
    first = hints - products(hints, directions) * directions
    lengths = np.sqrt(products(first, first))
    useless = np.flatnonzero(lengths <= STEEP * np.sqrt(products(hints, hints)))
    if len(useless):
        others = np.eye(3)[:, np.abs(directions[:, useless]).argmin(axis=0)]
        first[:, useless] = crosses(directions[:, useless], others)
        lengths[useless] = np.sqrt(products(first[:, useless], first[:, useless]))
    first /= np.maximum(lengths, np.finfo(float).tiny)
    return np.stack([first, crosses(directions, first)])


def plane_functionals(
    normals: FloatArray, corners: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The functionals (3, N) and offsets (N,) of heights along directions, with the steepness and unevenness (N,) of
    ``Views``, for planes across normals (3, N) through the first corners (3, 3, N)."""
    facing = products(normals, directions)
    is_base = np.abs(facing) > LEANING
    scales = np.divide(1.0, facing, out=np.ones_like(facing), where=is_base)
    offsets = products(normals, corners)
    unevenness = np.abs(offsets[1:] - offsets[0]).max(axis=0)
    steepness = np.where(is_base, np.abs(scales), np.inf)
    scaled = normals * scales
    return scaled, -products(scaled, corners[0]), steepness, unevenness
