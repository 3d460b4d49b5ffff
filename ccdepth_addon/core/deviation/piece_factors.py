# SPDX-License-Identifier: GPL-3.0-or-later
"""The factors on a tolerance that varies over the pieces of a surface. docs/deviation.md, A tolerance that varies."""

from __future__ import annotations

import numpy as np

from ..arrays.column import Column
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.surface_points import SurfacePoints
from ..tolerance.variation import Variation

# The parameters of a square's corners.
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def _weights(places: FloatArray) -> FloatArray:
    """(…, 4): the bilinear weights of a square's corners at places (…, 2)."""
    return np.prod(np.where(SQUARE == 1, places[..., None, :], 1 - places[..., None, :]), axis=-1)


# (4, 4, 4): the corners of a piece's children, as sums of its own, for quarters in rows, and counted from the corners.
IN_ROWS = _weights((SQUARE[[0, 1, 3, 2], None] + SQUARE) / 2)
FROM_CORNERS = np.stack([np.roll(each, -corner, axis=0) for corner, each in enumerate(IN_ROWS[[0, 1, 3, 2]])])


class PieceFactors:
    """The places of all pieces on the control mesh, in its quarters, and their factors.

    control: the control mesh, whose units have ``origin`` taken from their positions; allowance: the rounding of the
    pieces' points.
    """

    def __init__(self, variation: Variation, control: PolygonMesh, origin: FloatArray, allowance: float) -> None:
        self._variation, self._control, self._origin, self._allowance = variation, control, origin, allowance
        self._corners, self._parameters = Column(np.zeros(0, dtype=np.intp)), Column(np.zeros((0, 4, 2)))

    def add_units(self, count: int, turned: IndexArray) -> None:
        """Add the quads of some level; turned (N,) intp, as of ``add_children``."""
        corner_count = self._control.corner_count
        parameters = SQUARE[None]
        while len(parameters) < count // corner_count:
            parameters = (FROM_CORNERS @ parameters[:, None]).reshape(-1, 4, 2)
        corners = np.repeat(np.arange(corner_count), count // corner_count)
        self._add(corners, np.tile(parameters, (corner_count, 1, 1)), turned)

    def add_children(self, parents: IndexArray, are_in_rows: BoolArray, turned: IndexArray) -> None:
        """Add four children of each of the parents (n,). turned: (4n,) intp, the corner from which the corners of each
        are counted."""
        weights = np.where(are_in_rows[:, None, None, None], IN_ROWS, FROM_CORNERS)
        parameters = weights @ self._parameters.values[parents][:, None]
        self._add(np.repeat(self._corners.values[parents], 4), parameters.reshape(-1, 4, 2), turned)

    def _add(self, corners: IndexArray, parameters: FloatArray, turned: IndexArray) -> None:
        order = (turned[:, None] + np.arange(4)) % 4
        self._corners.append(corners)
        self._parameters.append(np.take_along_axis(parameters, order[:, :, None], axis=1))

    def places(self, pieces: IndexArray, weights: FloatArray) -> SurfacePoints:
        """(n·k): the places in pieces (n,) with the weights (k, 4) of the corners."""
        parameters = weights @ self._parameters.values[pieces]
        return SurfacePoints(np.repeat(self._corners.values[pieces], len(weights)), parameters.reshape(-1, 2))

    def over(self, pieces: IndexArray, coefficients: FloatArray, excess: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The least and the greatest factors (n,) over pieces (n,)."""
        hulls = coefficients + self._origin[:, None]
        corners = self.places(pieces, np.eye(4))
        return self._variation.of_pieces(self._control, corners, hulls, excess + self._allowance)

    def at(self, places: SurfacePoints, points: FloatArray) -> FloatArray:
        """(N,): the factors at points (N, 3) of the surface, and no less."""
        return self._variation.at_points(self._control, places, points + self._origin)
