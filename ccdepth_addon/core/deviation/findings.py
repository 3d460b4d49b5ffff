# SPDX-License-Identifier: GPL-3.0-or-later
"""The findings of a measurement so far, and the test of when they are enough."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np

from ..arrays.types import FloatArray, IndexArray

# Per-face distances are found to this part of the largest one.
SHARE_OF_LARGEST = 0.2

# After so many rounds only what decides on the largest distance is split.
ROUNDS_FOR_FACES = 4

# As near as this part of it the limit is decided.
DECIDING = 1e-6

# The part of itself by which a distance can be too long. docs/deviation.md, Rounding.
TOO_LONG = 2.0**-37


@dataclass
class Findings:
    """reached: the longest distance that is known to be there, less the allowance; the pair it lies between, where, and
    which way. margin: what rounding can hide of a coordinate. floor: distances are not told apart more closely. enough:
    what is proved need not be less. accuracy: how near to what is reached it shall be. limit: a distance of which it is
    to be told whether all is within."""

    accuracy: float
    limit: float
    floor: float
    enough: float
    allowance: float
    margin: float
    max_pieces: int
    began: float
    time_limit: float
    report: Callable[[float], None]
    reached: float = 0.0
    point: FloatArray = field(default_factory=lambda: np.zeros(3))
    nearest: FloatArray = field(default_factory=lambda: np.zeros(3))
    face: int = 0
    triangle: int = 0
    surface_to_mesh: bool = True
    is_placed: bool = False
    told: float = 0.0
    # (F,) what is reached in each control face, or nearly.
    in_faces: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def target(self) -> float:
        """Bounds up to this one are good enough."""
        if self.reached > self.limit:
            return self.accurate
        return min(self.accurate, max(self.limit, (1 + DECIDING) * self.reached, self.floor, self.enough))

    @property
    def accurate(self) -> float:
        """Bounds up to this one have the accuracy, or are enough."""
        return max((1 + self.accuracy) * self.reached, self.floor, self.enough)

    def note(
        self,
        distances: FloatArray,
        points: FloatArray,
        nearest: FloatArray,
        faces: IndexArray,
        triangles: IndexArray,
        *,
        surface_to_mesh: bool,
    ) -> None:
        """(N,) distances that are there but for TOO_LONG and the allowance, from points to nearest ones, (N, 3)."""
        if not len(distances):
            return
        best = int(distances.argmax())
        reached = float(distances[best]) * (1 - TOO_LONG) - self.allowance
        if reached > self.reached or not self.is_placed:
            self.reached, self.is_placed = max(reached, 0.0), True
            self.point, self.nearest = points[best].copy(), nearest[best].copy()
            self.face, self.triangle, self.surface_to_mesh = int(faces[best]), int(triangles[best]), surface_to_mesh

    def goals(self, faces: IndexArray, rounds: int) -> FloatArray:
        """(N,): bounds up to these are near enough to what is reached, in all and in each of these faces (N,), after so
        many rounds."""
        if rounds >= ROUNDS_FOR_FACES:
            return np.full(len(faces), self.target)
        in_faces = self.in_faces[faces] + SHARE_OF_LARGEST * self.reached
        return np.maximum(np.minimum(self.target, in_faces), max(self.floor, self.enough))

    def report_round(self, half: int, number: int, share: float) -> None:
        """Progress, of which nobody knows how much is left: every round takes half of what was left of its half."""
        self.told = (half + 1 - 0.5 ** (number + share)) / 2
        self.tick()

    def tick(self) -> None:
        """No further, but still there: whoever listens may want to stop."""
        self.report(self.told)

    def is_exhausted(self, pieces: int, share: float = 1.0) -> bool:
        """Whether so many pieces, or the time since the beginning, use up this share of what is allowed."""
        return pieces >= share * self.max_pieces or self.is_late(share)

    def is_late(self, share: float = 1.0) -> bool:
        """Whether this share of the time is used up."""
        return perf_counter() - self.began > share * self.time_limit
