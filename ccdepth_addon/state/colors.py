# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth → colour, and distance → colour.

The colours are viridis by Stéfan van der Walt and Nathaniel Smith (CC0): even steps of perceived difference, ever
lighter, and distinct with any common colour blindness. A depth has the same colour on every mesh; heat map, legend,
histogram and pictures use the same ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core import FloatArray
from ..exchange.result_attributes import rounded_up

# Evenly spaced colours of the map, in sRGB; those between are found by linear interpolation. The darkest quarter is
# left out: what is nearly black shows neither edges nor form, and in a dark theme is nearly the background.
VIRIDIS = "3b528b 33638d 2c728e 26818e 21908c 1f9f88 28ae80 3ebc74 5dc963 82d34c abdc32 d5e21a fde725"
VIRIDIS_COLORS = np.array([list(bytes.fromhex(color)) for color in VIRIDIS.split()]) / 255.0

# The depths that have the first and the last colour, unless the scene says otherwise.
FIRST_DEPTH, LAST_DEPTH = 0, 8

# Beyond the scale: no colour of it, and much darker than its last.
BEYOND = (0.85, 0.16, 0.16)


def scale_colors(fractions: FloatArray) -> FloatArray:
    """(N, 3) sRGB: the first colour for 0, the last for 1, and a colour of its own for more than that."""
    colors = _interpolated(fractions)
    colors[np.asarray(fractions) > 1.0] = BEYOND
    return colors


def _interpolated(fractions: FloatArray) -> FloatArray:
    stops = np.linspace(0.0, 1.0, len(VIRIDIS_COLORS))
    return np.stack([np.interp(fractions, stops, channel) for channel in VIRIDIS_COLORS.T], axis=1)


def depth_colors(depths: ArrayLike, first: int = FIRST_DEPTH, last: int = LAST_DEPTH) -> FloatArray:
    """(depths, 3) sRGB: the first colour up to ``first``, the last one from ``last`` on, even steps between."""
    return _interpolated((np.asarray(depths) - first) / max(1, last - first))


def face_depth_colors(depths: NDArray[np.int32], color_depths: tuple[int, int]) -> NDArray[np.float32]:
    """(F, 4) linear: the colours of these depths (F,), which are not negative."""
    return as_attribute(depth_colors(range(int(depths.max(initial=0)) + 1), *color_depths)).take(depths, axis=0)


def distance_colors(values: NDArray[np.float32], top: float) -> NDArray[np.float32]:
    """(F, 4) linear: the colours of these distances (F,), on a scale up to ``top``."""
    # The largest one, rounded up to single precision, is not beyond it.
    return as_attribute(scale_colors(values / rounded_up(top)))


def as_attribute(srgb: FloatArray) -> NDArray[np.float32]:
    """(N, 4) linear, opaque: sRGB colours as colour attributes hold them."""
    return np.concatenate([to_linear(srgb), np.ones((len(srgb), 1))], axis=1).astype(np.float32)


def to_linear(srgb: FloatArray) -> FloatArray:
    """sRGB colours as the scene-linear ones that colour attributes hold (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
