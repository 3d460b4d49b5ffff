# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a Bézier piece stands off the plane of a triangle, where it lies over that triangle along a direction.

Heights over a plane, and how far a point lies inside each of a triangle's sides, are linear functionals of the surface,
so their Bernstein coefficients bound them. Where a piece reaches beyond a side, what it does there does not count: for
every weight that is not negative the height is at most its sum with the weighted distance inside, which is bounded in
place of it. docs/deviation.md, Heights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray
from ..bounds.norms import squared_norms
from .bezier_pieces import CORNERS
from .triangles import dot

# A side of a triangle has no side to speak of when it is seen at less than this sine.
STEEP = 1e-3

# A triangle that leans more than this cosine tells is no base for heights.
LEANING = 0.1

# Weights beyond this one only magnify rounding.
LARGEST_WEIGHT = 4.0

PAIRS_OF_SIDES = ((0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class SideViews:
    """N triangles seen along directions. inward: (N, 3, 3), unit vectors across the direction, from each side inwards;
    zero where a side is seen end on, or the third corner lies too near its line. offsets: (N, 3), so that
    ``inward · x + offsets`` is how far x lies inside."""

    inward: FloatArray
    offsets: FloatArray

    @staticmethod
    def of(corners: FloatArray, directions: FloatArray, margin: float) -> SideViews:
        """corners: (N, 3, 3); directions: (N, 3) unit vectors; margin: what rounding can hide."""
        along = corners[:, [1, 2, 0]] - corners
        across = np.cross(directions[:, None], along)
        lengths = np.sqrt(squared_norms(across))
        seen = lengths > STEEP * np.sqrt(squared_norms(along))
        inward = np.divide(across, lengths[..., None], out=np.zeros_like(across), where=seen[..., None])
        offsets = -dot(inward, corners)
        third = dot(inward, corners[:, [2, 0, 1]]) + offsets
        signs = np.where(np.abs(third) > 2 * margin, np.sign(third), 0.0)
        return SideViews(inward * signs[..., None], offsets * signs)


@dataclass(frozen=True)
class Views:
    """N pairs of a Bézier piece and a triangle, seen along a direction, in coefficients (Bernstein).

    inside: (N, 3, 16), how far inside each side. heights: (N, 16), over the triangle's plane along the direction.
    inward: (N, 3, 2), the directions inwards; places: (N, 2, 4), the piece's corners, in coordinates across.
    excess: (N,), how far the surface may be off the piece. steepness: (N,), how much longer a height is than the
    distance to the plane. unevenness: (N,), how far the triangle's corners are off the plane.
    """

    inside: FloatArray
    heights: FloatArray
    inward: FloatArray
    places: FloatArray
    excess: FloatArray
    steepness: FloatArray
    unevenness: FloatArray

    def at(self, chosen: NDArray) -> Views:
        """Some of them."""
        return Views(*(column[chosen] for column in vars(self).values()))

    def largest_heights(self, goals: FloatArray, margin: float) -> FloatArray:
        """(N,): no point of the piece over the triangle is farther off along the direction. Where that is more than the
        goals (N,) what lies beside the triangle is taken away."""
        bounds = np.abs(self.heights).max(axis=1)
        beside = (self.inside < 0).any(axis=(1, 2)) & (bounds + self._allowed() > goals)
        chosen = np.flatnonzero(beside)
        if len(chosen):
            bounds[chosen] = np.minimum(bounds[chosen], self.at(chosen)._clipped(margin))
        bounds += self._allowed()
        return np.where(np.isfinite(self.steepness), bounds, np.inf)

    def _allowed(self) -> FloatArray:
        return (self.excess + self.unevenness) * np.where(np.isfinite(self.steepness), self.steepness, 0.0)

    def _clipped(self, margin: float) -> FloatArray:
        slopes = self._slopes()
        bounds = np.full(len(self.heights), -np.inf)
        for sign in (1.0, -1.0):
            heights = sign * self.heights
            best = heights.max(axis=1)
            falls = -sign * np.einsum("nkd,nd->nk", self.inward, slopes)
            for side in range(3):
                best = np.minimum(best, self._weighted(heights, [(side, falls[:, side])], margin))
            for one, other in PAIRS_OF_SIDES:
                first, second = self.inward[:, one], self.inward[:, other]
                turn = _cross(first, second)
                with np.errstate(divide="ignore", invalid="ignore"):
                    weights = -sign * _cross(slopes, second) / turn, -sign * _cross(first, slopes) / turn
                used = (weights[0] > 0) & (weights[1] > 0)
                pair = [(side, np.where(used, weight, 0.0)) for side, weight in zip((one, other), weights, strict=True)]
                best = np.minimum(best, self._weighted(heights, pair, margin))
            bounds = np.maximum(bounds, best)
        return np.maximum(bounds, 0.0)

    def _weighted(self, heights: FloatArray, weights: list[tuple[int, FloatArray]], margin: float) -> FloatArray:
        total, added = heights, np.zeros(len(heights))
        for side, weight in weights:
            clipped = np.clip(weight, 0.0, LARGEST_WEIGHT)
            total = total + clipped[:, None] * self.inside[:, side]
            added = added + clipped * (self.excess + margin)
        return total.max(axis=1) + added

    def _slopes(self) -> FloatArray:
        """(N, 2): how the heights change across, about, from their values at the corners."""
        heights = self.heights[:, CORNERS]
        (along, across), (rise_along, rise_across) = _differences(self.places), _differences(heights)
        turn = _cross(along, across)
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.stack(
                [
                    (rise_along * across[:, 1] - rise_across * along[:, 1]) / turn,
                    (rise_across * along[:, 0] - rise_along * across[:, 0]) / turn,
                ],
                axis=1,
            )
        return np.where(np.isfinite(slopes), slopes, 0.0)


def _differences(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """From one side to the other, of (…, 4) values at the corners."""
    a, b, c, d = np.moveaxis(values, -1, 0)
    return (b + c - a - d) / 2, (c + d - a - b) / 2


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


def axes_across(directions: FloatArray, hints: FloatArray) -> FloatArray:
    """(N, 2, 3): unit vectors across directions (N, 3), the first of them as near to the hints (N, 3) as can be."""
    first = hints - dot(hints, directions)[:, None] * directions
    lengths = np.sqrt(squared_norms(first))
    useless = lengths <= STEEP * np.sqrt(squared_norms(hints))
    if useless.any():
        others = np.eye(3)[np.abs(directions[useless]).argmin(axis=1)]
        first[useless] = np.cross(directions[useless], others)
        lengths[useless] = np.sqrt(squared_norms(first[useless]))
    first /= np.maximum(lengths, np.finfo(float).tiny)[:, None]
    return np.stack([first, np.cross(directions, first)], axis=1)


def plane_functionals(
    normals: FloatArray, corners: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of planes through the first corners (N, 3, 3): the functionals (N, 3) and offsets (N,) of heights along the
    directions, the steepness and the unevenness (N,) of ``Views``."""
    facing = dot(normals, directions)
    with np.errstate(divide="ignore"):
        steepness = np.where(np.abs(facing) > LEANING, 1 / np.abs(facing), np.inf)
    scaled = normals / np.where(np.abs(facing) > LEANING, facing, 1.0)[:, None]
    offsets = -dot(normals[:, None], corners)
    unevenness = np.abs(offsets - offsets[:, :1]).max(axis=1)
    return scaled, -dot(scaled, corners[:, 0]), steepness, unevenness
