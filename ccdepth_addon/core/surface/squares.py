# SPDX-License-Identifier: GPL-3.0-or-later
"""Square parts of the parameters of quads, one or many."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray

# The corners of a quad's parameters.
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

# The turns of row vectors by 0 to 3 quarters, counter-clockwise.
TURNS = np.stack([np.linalg.matrix_power(np.array([[0.0, 1.0], [-1.0, 0.0]]), turn) for turn in range(4)])


@dataclass(frozen=True)
class Square:
    """A square part of a quad's parameters: its corner 0, and its sides from there as rows (2, 2)."""

    origin: FloatArray
    axes: FloatArray

    def from_parent(self, points: FloatArray) -> FloatArray:
        """(N, 2) parameters of the quad as parameters of the square."""
        return (points - self.origin) @ self.axes.T / (self.axes[0] @ self.axes[0])

    def corners(self) -> FloatArray:
        return self.origin + SQUARE @ self.axes


WHOLE_QUAD = Square(np.zeros(2), np.eye(2))


@dataclass(frozen=True)
class Squares(Table):
    """N square parts of the parameters of quads.

    bases: (N,) intp, the quad of each; origins: (N, 2), their corners 0; axes: (N, 2, 2), the sides from there to
    corners 1 and 3.
    """

    bases: IndexArray
    origins: FloatArray
    axes: FloatArray

    @staticmethod
    def whole(count: int) -> Squares:
        """The whole squares of quads."""
        axes = np.broadcast_to(np.eye(2), (count, 2, 2))
        return Squares(np.arange(count), np.zeros((count, 2)), axes)

    def children(self) -> Squares:
        """The four children of each, from corner 0 on; corner 0 of a child is a corner of the square."""
        origins = self.origins[:, None] + np.einsum("ci,nij->ncj", SQUARE, self.axes)
        axes = np.einsum("cij,njk->ncik", TURNS / 2, self.axes)
        return Squares(np.repeat(self.bases, 4), origins.reshape(-1, 2), axes.reshape(-1, 2, 2))

    def corners(self) -> FloatArray:
        """(4, N, 2)."""
        return self.origins + np.einsum("ci,nij->cnj", SQUARE, self.axes)

    def sizes(self) -> FloatArray:
        """(N,): their sides."""
        found: FloatArray = np.abs(self.axes[:, 0]).max(axis=1)
        return found
