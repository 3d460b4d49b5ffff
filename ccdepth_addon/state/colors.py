# SPDX-License-Identifier: GPL-3.0-or-later
"""Fractions of a scale → colours of overlay, legend, histogram, pictures and baked attributes.

The colours grow lighter from violet by way of blue and green to pale yellow, and stay distinct with any common colour
blindness. Colours of neighbouring depths are clearly apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core import FloatArray

# The depth that has the last colour, as all deeper ones have; the first is for 0, on every mesh.
LAST_DEPTH = 8

# The colours of depths 0 to 8, in sRGB, with linear interpolation between them. None is nearly black: that would show
# neither edges nor form, and resemble the background of a dark theme.
RAMP = "6c2f9c 3a5fc9 1e8eb3 21a781 40be63 87cd53 bfd947 f3e446 fef3a8"
RAMP_COLORS = np.array([list(bytes.fromhex(color)) for color in RAMP.split()]) / 255.0

# The colour beyond the scale: no colour of the scale, and much darker than its last.
BEYOND = (0.85, 0.16, 0.16)


def scale_colors(fractions: ArrayLike) -> FloatArray:
    """(N, 3) sRGB: the first colour for 0, the last for 1, and a colour of its own for more than that."""
    wanted = np.asarray(fractions, dtype=np.float64)
    stops = np.linspace(0.0, 1.0, len(RAMP_COLORS))
    colors = np.stack([np.interp(wanted, stops, channel) for channel in RAMP_COLORS.T], axis=1)
    colors[wanted > 1.0] = BEYOND
    return colors


def depth_colors(depths: ArrayLike) -> FloatArray:
    """(depths, 3) sRGB: a colour for each depth, and one for all from the last on."""
    return scale_colors(np.clip(np.asarray(depths) / LAST_DEPTH, 0.0, 1.0))


def to_linear(srgb: FloatArray) -> FloatArray:
    """sRGB colours as scene-linear colours, as in colour attributes (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
