# SPDX-License-Identifier: GPL-3.0-or-later
"""The request for an adaptive mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ..arrays.types import FloatArray
from .templates import Transitions


class Mode(StrEnum):
    """The way in which faces of the control mesh are divided."""

    ADAPTIVE = "ADAPTIVE"
    PER_FACE = "PER_FACE"


@dataclass(frozen=True)
class AdaptiveRequest:
    """The way to subdivide a control mesh. limit: the largest distance, in the unit of its positions, rounding
    subtracted.

    most_faces: a larger result is refused. axes: (3, 3) float64, its columns the axes of the space where Blender
    triangulates the result, in coordinates of the positions. largest_coordinate: of the control mesh in that space.
    are_squares: whether quads are quartered alone, never halved, for what merges their triangles afterwards.
    """

    limit: float
    mode: Mode
    transitions: Transitions
    most_faces: int
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    largest_coordinate: float = 0.0
    are_squares: bool = False

    @property
    def may_halve(self) -> bool:
        """Whether quads may be halved along one parameter."""
        return self.mode is Mode.ADAPTIVE and not self.are_squares
