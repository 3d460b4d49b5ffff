# SPDX-License-Identifier: GPL-3.0-or-later
"""The variation of a tolerance over a control mesh.

The tolerance of a part of the surface is the least over its points, and so never too large for any of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.touching_faces import surface_boxes
from ..surface.surface_points import SurfacePoints, interpolate_linearly
from .surface_views import Pixels

# More than the relative rounding of a factor: eight roundings of a logarithm, which is below 709, take 8·709·2⁻⁵³.
ROUNDED = 2.0**-40


class ToleranceError(ValueError):
    """The error of a tolerance without meaning on the mesh. The message gives the reason in a modeller's words."""


@dataclass(frozen=True)
class Variation:
    """How a tolerance varies over a control mesh of C corners.

    factors: (C,) float64, positive: the factor on the tolerance at each face corner. Between corners the logarithm of
    the factor is bilinear over a quad, and over the quarters of any other face (``surface_points``). pixels: factors
    by place, to be multiplied with these; or None.
    """

    factors: FloatArray
    pixels: Pixels | None = None

    @property
    def least_factor(self) -> float:
        """The least factor on the tolerance anywhere. Of pixels, the unit is the least length."""
        return float(self.factors.min(initial=np.inf))

    def of_faces(self, mesh: PolygonMesh, tolerance: float) -> FloatArray:
        """(F,): the tolerances of whole faces, the least over each face."""
        found: FloatArray = tolerance * np.minimum.reduceat(self.factors, mesh.face_starts[:-1])
        return found if self.pixels is None else found * self.pixels.extremes(*surface_boxes(mesh))[0]

    def at_points(self, mesh: PolygonMesh, points: SurfacePoints, positions: FloatArray) -> FloatArray:
        """(N,): the factors at points of the surface, and no less, rounding included. positions: (N, 3), about, in the
        space of the mesh."""
        logarithms = interpolate_linearly(mesh, np.log(self.factors)[:, None], points)[:, 0]
        found: FloatArray = (1 + ROUNDED) * np.exp(logarithms)
        return found if self.pixels is None else found * self.pixels.extremes(positions.T, positions.T)[1]

    def of_pieces(
        self, mesh: PolygonMesh, corners: SurfacePoints, coefficients: FloatArray, excess: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest factors (N,) over pieces of the surface, rounding included.

        corners: of the pieces, 4N points, four of a piece after each other: a rectangle of parameters. coefficients:
        (N, 3, 16), in the space of the mesh; excess: (N,): the surface over a piece is within the excess of the hull.
        """
        at_corners = interpolate_linearly(mesh, np.log(self.factors)[:, None], corners).reshape(-1, 4)
        least, greatest = (1 - ROUNDED) * np.exp(at_corners.min(axis=1)), (1 + ROUNDED) * np.exp(at_corners.max(axis=1))
        if self.pixels is None:
            return least, greatest
        low, high = coefficients.min(axis=2).T - excess, coefficients.max(axis=2).T + excess
        of_pixels = self.pixels.extremes(low, high)
        return least * of_pixels[0], greatest * of_pixels[1]
