# SPDX-License-Identifier: GPL-3.0-or-later
"""Bicubic parts of the surface over faces, halved both ways while bounds of them are too large."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray


@dataclass(frozen=True)
class Parts(Table, values=2):
    """P parts of faces. faces: (P,) intp, the face of each; values: (4, 4, P, 3) or (16, 3, P), the net of each, or the
    Bernstein coefficients of the surface or of a difference from it."""

    faces: IndexArray
    values: FloatArray

    def quarters(self, halves: tuple[FloatArray, FloatArray]) -> Parts:
        """The parts halved both ways, one quarter of all of them after the other. halves: (4, 4) each, from the
        coefficients, or points of a net, along one parameter to those of either half."""
        rows = self.values.reshape(16, -1)
        found = [matrix_product(np.kron(a, b), rows).reshape(self.values.shape) for a in halves for b in halves]
        return Parts(np.tile(self.faces, 4), np.concatenate(found, axis=2))
