# SPDX-License-Identifier: GPL-3.0-or-later
"""The request for an adaptive mesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ..arrays.types import BoolArray, FloatArray
from ..tolerance.variation import Variation


class Mode(StrEnum):
    """The way in which faces of the control mesh are divided."""

    ADAPTIVE = "ADAPTIVE"
    PER_FACE = "PER_FACE"


@dataclass(frozen=True)
class AdaptiveRequest:
    """The way to subdivide a control mesh. limit: the largest distance allowed, in the unit of the positions; rounding:
    the part of it that rounding may take. variation: how the limit varies; None for the same everywhere.

    most_faces: the number of faces above which a result is refused. axes: (3, 3) float64, in columns the axes of the
    space where Blender triangulates the result, in coordinates of the positions. largest_coordinate: the largest
    absolute coordinate of the control mesh in that space. are_squares: whether quads are only quartered, never halved,
    as for a later reduction. shading, facets: the largest angles allowed between the surface's normals and the stored
    normals, interpolated, or the triangles' own, in radians below a right angle; 0 for none. is_smooth: (F,) bool,
    whether control faces are shaded smooth; without it all are. stored: how far storing a vertex can move it.
    longest_edge: the greatest length of an edge of a face, in the unit of the positions; 0 for any.
    """

    limit: float
    mode: Mode
    most_faces: int
    axes: FloatArray = field(default_factory=lambda: np.eye(3))
    largest_coordinate: float = 0.0
    are_squares: bool = False
    shading: float = 0.0
    facets: float = 0.0
    is_smooth: BoolArray | None = None
    stored: float = 0.0
    longest_edge: float = 0.0
    rounding: float = 0.0
    variation: Variation | None = None

    @property
    def has_angles(self) -> bool:
        """Whether an angle is limited."""
        return self.shading > 0 or self.facets > 0

    @property
    def may_halve(self) -> bool:
        """Whether quads may be halved along one parameter."""
        return self.mode is Mode.ADAPTIVE and not self.are_squares
