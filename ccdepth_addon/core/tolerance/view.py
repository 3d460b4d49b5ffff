# SPDX-License-Identifier: GPL-3.0-or-later
"""Views of cameras, in pixels."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays.types import FloatArray


@dataclass(frozen=True)
class View:
    """One camera at one frame.

    to_camera: (3, 4) float64, from the space of the positions to the camera's, with lengths kept: x and y along the
    image's width and height, and the depth in front of the camera. focal: in pixels; of an orthographic camera in
    pixels per unit of length. center: the pixel on the camera's axis; size: the width and height of the image, in
    pixels. near: the depth from which the camera sees.
    """

    to_camera: FloatArray
    focal: float
    center: tuple[float, float]
    size: tuple[float, float]
    near: float
    is_perspective: bool
