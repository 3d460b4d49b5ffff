# SPDX-License-Identifier: GPL-3.0-or-later
"""Key poses: those of which all faces are evaluated, and what follows for the poses between two of them.

The distance of a facet from its patch is linear in the control points. A pose between two others is a mean of these and
a small rest, so its distances are at most the mean of theirs and the norm's bound of the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray
from ..surface.patches import PatchKind
from .poses import PreparedMesh, ScaledPose, at_each_level

# One of at most so many poses is a key pose.
POSES_BY_A_KEY = 12


@dataclass(frozen=True)
class KeyPose:
    """A pose that others are compared with, (F,) each, in units of the tolerance.

    near: the distances proved at the depths so far; inf where there is none. norms: the values of the bounds by norms.
    """

    scaled: ScaledPose
    near: FloatArray
    norms: FloatArray


@dataclass(frozen=True)
class Way:
    """The way from one key pose to the next: its vectors (V, 3), and the sum of their squared lengths."""

    before: KeyPose
    after: KeyPose
    vectors: FloatArray
    square: float

    @staticmethod
    def between(before: KeyPose, after: KeyPose) -> Way:
        """From one key pose to the next."""
        vectors = after.scaled.mesh.positions - before.scaled.mesh.positions
        return Way(before, after, vectors, _dot_product(vectors, vectors))

    def _rest(self, positions: FloatArray) -> tuple[float, FloatArray]:
        """The share of the way, from 0 to 1, after which it comes nearest to other positions; and what is left to them
        (V, 3), 0 for vertices that do not move."""
        rest = positions - self.before.scaled.mesh.positions
        share = min(max(_dot_product(rest, self.vectors) / self.square, 0.0), 1.0) if self.square else 0.0
        rest -= share * self.vectors
        return share, rest

    def bounds_between(
        self, prepared: PreparedMesh, scaled: ScaledPose, depths: NDArray[np.int32]
    ) -> tuple[FloatArray, FloatArray]:
        """(F,) each: bounds of a pose between the two, at the depths (F,) at which those of the key poses were proved,
        and the values of its bounds by norms, in units of the tolerance; inf where there are none."""
        before, after = self.before, self.after
        share, rest = self._rest(scaled.mesh.positions)
        # Sums of finite and of infinite bounds, times a share that may be 0.
        with np.errstate(invalid="ignore"):
            near = (1 - share) * before.near + share * after.near
            norms = (1 - share) * before.norms + share * after.norms
        near[~(np.isfinite(before.near) & np.isfinite(after.near))] = np.inf
        norms[~np.isfinite(before.norms)] = np.inf
        others = prepared.others.near(rest)
        near[others[prepared.kinds.kinds[others] == PatchKind.IRREGULAR]] = np.inf
        for faces, rests in prepared.all_norms(scaled.mesh.changed(positions=rest), others):
            near[faces] += at_each_level(rests, depths[faces])
            norms[faces] += rests.value
        # Of the rest, a sum of three rounded ones.
        near += 4 * max(before.scaled.allowance, scaled.allowance, after.scaled.allowance)
        return near, norms


def _dot_product(a: FloatArray, b: FloatArray) -> float:
    """Of two arrays of the same shape, on the calling thread (``matrix_products``)."""
    return float(np.einsum("ij,ij->", a, b))


def key_places(count: int) -> list[int]:
    """Which of so many poses after the first are key poses, as far apart as each other; the last one is."""
    keys = -(-count // POSES_BY_A_KEY)
    return [round(number * count / keys) for number in range(1, keys + 1)]
