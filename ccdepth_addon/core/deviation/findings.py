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

# After this many rounds only pieces and parts that decide the largest distance are split.
ROUNDS_FOR_FACES = 4

# The limit is decided up to this part of it.
DECIDING = 1e-6

# The part of itself by which a distance can be too long. docs/deviation.md, Rounding.
TOO_LONG = 2.0**-37


@dataclass
class Findings:
    """The distances found so far, and the demands on them, all reduced but for the margin. reached: the longest
    distance really there, less the allowance, with its pair of points, their places, and the way. margin: the rounding
    of a coordinate. floor: the smallest distance told from zero. enough: a proved distance need not be smaller.
    accuracy: the largest relative difference between proved and reached. limit: the distance to decide whether all is
    within."""

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
    # The number of rounds done of the present way.
    rounds: int = 0
    # (F,) the distance reached in each control face, or nearly.
    in_faces: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def target(self) -> float:
        """The largest bound that is good enough."""
        if self.reached > self.limit:
            return self.accurate
        return min(self.accurate, max(self.limit, (1 + DECIDING) * self.reached, self.floor, self.enough))

    @property
    def accurate(self) -> float:
        """The largest bound with the accuracy, or enough."""
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
        """Record reduced distances (N,) really there, but for TOO_LONG and the allowance, from points to nearest
        points, (N, 3)."""
        if not len(distances):
            return
        best = int(distances.argmax())
        reached = float(distances[best]) * (1 - TOO_LONG) - self.allowance
        if reached > self.reached or not self.is_placed:
            self.reached, self.is_placed = max(reached, 0.0), True
            self.point, self.nearest = points[best].copy(), nearest[best].copy()
            self.face, self.triangle, self.surface_to_mesh = int(faces[best]), int(triangles[best]), surface_to_mesh

    def goals(self, faces: IndexArray) -> FloatArray:
        """(N,): the largest bounds near enough to the distances reached, in all and in each of the faces (N,)."""
        if self.rounds >= ROUNDS_FOR_FACES:
            return np.full(len(faces), self.target)
        in_faces = self.in_faces[faces] + SHARE_OF_LARGEST * self.reached
        return np.maximum(np.minimum(self.target, in_faces), max(self.floor, self.enough))

    def report_round(self, half: int, share: float) -> None:
        """Report progress, with the rest unknown: every round takes half of the rest of its half."""
        self.told = (half + 1 - 0.5 ** (self.rounds + share)) / 2
        self.tick()

    def tick(self) -> None:
        """Report no further progress; the caller may raise to stop."""
        self.report(self.told)

    def must_end(self, pieces: int, share: float = 1.0) -> bool:
        """Whether the search has to end, as of ``is_exhausted``; everything is examined once if there is the time."""
        return self.is_exhausted(pieces, share) if self.rounds else self.is_late(share)

    def is_exhausted(self, pieces: int, share: float = 1.0) -> bool:
        """Whether a number of pieces, or the time since the beginning, uses up this share of the allowed one."""
        return pieces >= share * self.max_pieces or self.is_late(share)

    def is_late(self, share: float = 1.0) -> bool:
        """Whether this share of the time is used up."""
        return perf_counter() - self.began > share * self.time_limit
