# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth → colour, and deviation → colour.

The colours are viridis by Stéfan van der Walt and Nathaniel Smith (CC0): even steps of perceived difference, ever
lighter, and distinct with any common colour blindness. Legend and histogram use the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core import FloatArray

# Evenly spaced colours of the map, in sRGB; those between are found by linear interpolation. The darkest eighth is left
# out: in the shadows of Solid shading it is black, and the form of the mesh is lost.
VIRIDIS = "472d7b 424086 3b528b 33638d 2c728e 26818e 21908c 1f9f88 28ae80 3ebc74 5dc963 82d34c abdc32 d5e21a fde725"
VIRIDIS_COLORS = np.array([list(bytes.fromhex(color)) for color in VIRIDIS.split()]) / 255.0


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


def depth_colors(depths: Sequence[int], least: int, deepest: int) -> FloatArray:
    """(depths, 3) sRGB: the first colour for ``least``, the last for ``deepest``, even steps between."""
    return _interpolated((np.asarray(depths) - least) / max(1, deepest - least))


def to_linear(srgb: FloatArray) -> FloatArray:
    """sRGB colours as the scene-linear ones that colour attributes hold (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def palette(least: int, deepest: int) -> tuple[tuple[float, float, float], ...]:
    """The sRGB colours of the depths from ``least`` to ``deepest``, for drawing."""
    return tuple(map(tuple, depth_colors(range(least, deepest + 1), least, deepest).tolist()))
