# SPDX-License-Identifier: GPL-3.0-or-later
"""The proof of one level of some base faces while their parts are evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..surface.parts import Parts
from .tolerance import ToleranceTest


@dataclass
class LevelDecision:
    """The bounds found so far for the level-k facets of B base faces. wanted: (B,) bool, faces that are not disproved.
    upper, lower: (B,) float64, bounds of the distances over the decided parts. off: (B,) float64, the distance that
    counts besides, of the facets from what is drawn for them. open_differences: S - L over undecided parts.
    """

    test: ToleranceTest
    wanted: BoolArray
    upper: FloatArray
    lower: FloatArray
    off: FloatArray
    open_differences: list[Parts] = field(default_factory=list)

    @staticmethod
    def of(test: ToleranceTest, wanted: BoolArray) -> LevelDecision:
        return LevelDecision(test, wanted.copy(), *np.zeros((3, len(wanted))))

    def update(self, bases: IndexArray, upper: FloatArray, lower: FloatArray) -> BoolArray:
        """Record the bounds of parts of base faces. Returns (parts,) bool, the parts still undecided."""
        self.disprove(bases, lower)
        upper = upper + self.off[bases]
        within = self.test.within(upper)
        np.maximum.at(self.upper, bases[within], upper[within])
        return ~within & self.wanted[bases]

    def disprove(self, bases: IndexArray, lower: FloatArray) -> None:
        """Record distances that some parts reach."""
        np.maximum.at(self.lower, bases, lower)
        self.wanted &= ~self.test.exceeds(self.lower)

    def bounds(self) -> FloatArray:
        """(B,): the proved distances of settled faces. A part with only a rough bound is within the tolerance, and
        within a distance that some other part reaches.
        """
        reached = np.maximum(self.upper, self.lower + self.off) + self.test.allowance
        return np.minimum(reached, self.test.tolerance)

    def give_up(self, bases: IndexArray) -> None:
        """Leave faces without a proof either way; they do not count as within the tolerance."""
        self.upper[bases] = np.inf
