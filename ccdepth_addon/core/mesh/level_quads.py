# SPDX-License-Identifier: GPL-3.0-or-later
"""The drawn diagonals of the quads of a level."""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .folded_quads import is_folded

# The two triangles of a quad, by its corners: with the diagonal from corner 0 to 2, and with that from 1 to 3.
QUAD_TRIANGLES = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])


def turned_children(is_turned: BoolArray, sizes: IndexArray) -> BoolArray:
    """Whether children are drawn with the diagonal from corner 1 to 3: diagonals are parallel to their parent's, and in
    polygons other than quads run to the middle."""
    first = np.cumsum(sizes) - sizes
    place = np.arange(sizes.sum()) - np.repeat(first, sizes)
    return np.repeat(sizes == 4, sizes) & (np.repeat(is_turned, sizes) ^ (place % 2 == 1))


def may_be_folded(points: FloatArray, is_turned: BoolArray, axes: FloatArray | None) -> BoolArray:
    """(K,) bool: whether quads (K, 4, 3) may be drawn with their other diagonal, as the triangles would face apart."""
    spaces = [np.eye(3)] if axes is None else [np.eye(3), axes]
    quads = np.where(is_turned[:, None, None], np.roll(points, -1, axis=1), points)
    return is_folded(quads.swapaxes(0, 1), *spaces)
