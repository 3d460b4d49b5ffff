# SPDX-License-Identifier: GPL-3.0-or-later
"""The question put to every face, and its answers: the one place where the tolerance is compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True)
class Question:
    """Which faces lie within a tolerance? The allowance is what rounding can hide; both in the positions' unit."""

    tolerance: float
    allowance: float

    def within(self, upper: FloatArray) -> BoolArray:
        """Whether distances of at most ``upper`` are proved to be within the tolerance."""
        return upper + self.allowance <= self.tolerance

    def exceeds(self, lower: FloatArray) -> BoolArray:
        """Whether distances of at least ``lower`` are proved to exceed the tolerance."""
        return lower - self.allowance > self.tolerance


@dataclass(frozen=True)
class FaceBlock:
    """Some faces of the mesh and what was found: (P,) each.

    depths: int32, -1 while undecided. bounds: the proved distance at that depth. distances: a distance that is really
    reached there. exact: whether every lesser depth is disproved.
    """

    faces: IndexArray
    depths: NDArray[np.int32]
    bounds: FloatArray
    distances: FloatArray
    exact: BoolArray

    @staticmethod
    def undecided(faces: IndexArray) -> FaceBlock:
        """A block with everything to find out."""
        count = len(faces)
        zeros = np.zeros(count)
        return FaceBlock(faces, np.full(count, -1, dtype=np.int32), zeros, zeros.copy(), np.ones(count, dtype=bool))

    @staticmethod
    def empty() -> FaceBlock:
        """A block of no faces."""
        return FaceBlock.undecided(np.zeros(0, dtype=np.intp))

    def settle(self, chosen: BoolArray, depth: int, bounds: FloatArray, distances: FloatArray | None = None) -> None:
        """Give the chosen faces their depth: (P,) arrays of which only their entries count.

        Without distances nothing is known from below, and no depth is known to be the least.
        """
        self.depths[chosen] = depth
        self.bounds[chosen] = bounds[chosen]
        if distances is None:
            self.exact[chosen] = False
        else:
            self.distances[chosen] = distances[chosen]

    def take(self, block: FaceBlock) -> None:
        """Copy in what was found of some of these faces; this block's faces are 0, 1, 2, …"""
        self.depths[block.faces] = block.depths
        self.bounds[block.faces] = block.bounds
        self.distances[block.faces] = block.distances
        self.exact[block.faces] = block.exact


@dataclass(frozen=True)
class LevelBlock:
    """Some faces of the mesh at one level: (P,) each. bounds: the proved distances, inf where none is proved to be
    within the tolerance."""

    faces: IndexArray
    bounds: FloatArray

    @staticmethod
    def empty() -> LevelBlock:
        """A block of no faces."""
        return LevelBlock(np.zeros(0, dtype=np.intp), np.zeros(0))

    @property
    def all_within(self) -> bool:
        """Whether all of its faces are proved to be within the tolerance."""
        return bool(np.all(np.isfinite(self.bounds)))
