# SPDX-License-Identifier: GPL-3.0-or-later
"""The variation of a tolerance over a control mesh.

The tolerance of a part of the surface is the least over its points, and so never too large for any of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray
from ..mesh.polygon_mesh import PolygonMesh


class ToleranceError(ValueError):
    """The error of a tolerance without meaning on the mesh. The message gives the reason in a modeller's words."""


@dataclass(frozen=True)
class Variation:
    """How a tolerance varies over a control mesh of C corners.

    factors: (C,) float64, positive: the factor on the tolerance at each face corner. Between corners the logarithm of
    the factor is bilinear over a quad, and over the quarters of any other face (``surface_points``).
    """

    factors: FloatArray

    @property
    def least_factor(self) -> float:
        """The least factor on the tolerance anywhere."""
        return float(self.factors.min(initial=np.inf))

    def of_faces(self, mesh: PolygonMesh, tolerance: float) -> FloatArray:
        """(F,): the tolerances of whole faces, the least over each face."""
        found: FloatArray = tolerance * np.minimum.reduceat(self.factors, mesh.face_starts[:-1])
        return found
