# SPDX-License-Identifier: GPL-3.0-or-later
"""The grid for timing depths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


def hills(side: int, insets: int) -> tuple[FloatArray, IntArray]:
    """Positions (V, 3) and quads (F, 4) of a hilly grid; some quads, no two of them near, have a quad inset.

    Each inset makes eight extraordinary vertices, four of valence 3 and four of valence 5.
    """
    x, y = np.meshgrid(np.linspace(0.0, 10.0, side + 1), np.linspace(0.0, 10.0, side + 1))
    positions = np.stack([x, y, np.sin(3 * x) * np.cos(2 * y)], axis=2).reshape(-1, 3)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    quads = first[:, None] + np.array([0, 1, side + 2, side + 1])
    apart = np.arange(2, side - 2, 4)
    chosen = np.random.default_rng(1).permutation(np.add.outer(apart * side, apart).ravel())[:insets]
    outer = quads[chosen]
    corners = positions[outer]
    inner = len(positions) + np.arange(4 * len(chosen)).reshape(-1, 4)
    around = np.stack([outer, np.roll(outer, -1, axis=1), np.roll(inner, -1, axis=1), inner], axis=2)
    middles = (corners + corners.mean(axis=1, keepdims=True)) / 2
    return (
        np.concatenate([positions, middles.reshape(-1, 3)]),
        np.concatenate([np.delete(quads, chosen, axis=0), inner, around.reshape(-1, 4)]),
    )
