# SPDX-License-Identifier: GPL-3.0-or-later
"""The variation of a tolerance over a control mesh.

The tolerance of a part of the surface is the least over its points, and so never too large for any of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import FloatArray
from ..mesh.polygon_mesh import PolygonMesh
from .view import View, least_around


class ToleranceError(ValueError):
    """The error of a tolerance without meaning on the mesh. The message gives the reason in a modeller's words."""


@dataclass(frozen=True)
class Variation:
    """How a tolerance varies over a control mesh of C corners.

    factors: (C,) float64, positive: the factor on the tolerance at each face corner, or None for 1. Between corners
    the logarithm of the factor is bilinear over a quad, and over the quarters of any other face (``surface_points``).
    views: with views the tolerance is a number of pixels, for each part of the surface turned into the least distance
    over all views. off_screen: the factor where a part lies outside an image and its margin, or behind the camera.
    """

    factors: FloatArray | None = None
    views: tuple[View, ...] = ()
    off_screen: float = 4.0

    @property
    def least_factor(self) -> float:
        """The least factor on the tolerance anywhere."""
        return 1.0 if self.factors is None else float(self.factors.min(initial=np.inf))

    def of_faces(self, mesh: PolygonMesh, tolerance: float) -> FloatArray:
        """(F,): the tolerances of whole faces, the least over each face."""
        factors = np.ones(mesh.face_count)
        if self.factors is not None:
            factors = np.minimum.reduceat(self.factors, mesh.face_starts[:-1])
        measures = [least_around(mesh, view.measures(mesh.positions), mesh.face_count) for view in self.views]
        return self.tolerances(tolerance * factors, measures)

    def tolerances(self, own: FloatArray, measures: list[FloatArray]) -> FloatArray:
        """(n,): the distances allowed on parts of the surface by their tolerances (n,), lengths or numbers of pixels,
        and for each view the least measures (11, n) over a hull (``View.measures``)."""
        if not self.views:
            return own
        pairs = zip(self.views, measures, strict=True)
        found: FloatArray = np.minimum.reduce([view.distances(own, least, self.off_screen) for view, least in pairs])
        return found
