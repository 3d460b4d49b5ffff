# SPDX-License-Identifier: GPL-3.0-or-later
"""The proof of one level of some base faces while their parts are evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .base_patches import BasePatches
from .tolerance import ToleranceTest


@dataclass
class LevelDecision:
    """Bounds of the level-k facets of B base faces so far.

    wanted: (B,) bool, faces that are not disproved. upper, lower: (B,) float64, distances at most and at least over the
    decided parts. open_differences: S - L where it is still undecided.
    """

    test: ToleranceTest
    wanted: BoolArray
    upper: FloatArray
    lower: FloatArray
    open_differences: list[BasePatches] = field(default_factory=list)

    @staticmethod
    def of(test: ToleranceTest, wanted: BoolArray) -> LevelDecision:
        count = len(wanted)
        return LevelDecision(test, wanted.copy(), np.zeros(count), np.zeros(count))

    def update(self, bases: IndexArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
        """Record the bounds of some parts of base faces; (parts,) bool, which of them are still undecided."""
        self.disprove(bases, lower)
        within = self.test.within(upper)
        np.maximum.at(self.upper, bases[within], upper[within])
        return ~within & self.wanted[bases]

    def disprove(self, bases: IndexArray, lower: FloatArray) -> None:
        """Record distances that some parts reach."""
        np.maximum.at(self.lower, bases, lower)
        self.wanted &= ~self.test.exceeds(self.lower)

    def bounds(self) -> FloatArray:
        """(B,): the proved distances of settled faces.

        Parts with rough bounds alone are within the tolerance, and within what some other part reaches.
        """
        reached = np.maximum(self.upper, self.lower) + self.test.allowance
        return np.minimum(reached, self.test.tolerance)

    def give_up(self, bases: IndexArray) -> None:
        """Leave faces without a proof either way; they do not count as within the tolerance."""
        self.upper[bases] = np.inf
