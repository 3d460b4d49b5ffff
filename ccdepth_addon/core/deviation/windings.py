# SPDX-License-Identifier: GPL-3.0-or-later
"""The windings of the borders of pieces about a place, seen along a direction, and the ways that pieces face.

docs/deviation.md, Covering and Sheets.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..surface.bicubic import HALVES
from .bezier_pieces import SIDES

# Sides that may lie over the place are halved until shorter than this many times their excess.
NARROW = 16.0


def facing(across: FloatArray, excess: FloatArray, margin: float) -> IndexArray:
    """(K,): 1 for a piece that faces along the direction everywhere, -1 against the direction everywhere, 0 if unknown.
    across, excess, margin: as of ``windings``."""
    grid = across.reshape(2, 4, 4, -1)
    along_u, along_v = np.diff(grid, axis=1).reshape(2, 12, -1), np.diff(grid, axis=2).reshape(2, 12, -1)
    products = along_u[0][:, None] * along_v[1] - along_u[1][:, None] * along_v[0]
    # Differences are off by two margins each.
    lengths = np.abs(along_u).max(axis=(0, 1)) + np.abs(along_v).max(axis=(0, 1))
    rounding = 4 * margin * (lengths + 2 * margin)
    low, high = products.min(axis=(0, 1)), products.max(axis=(0, 1))
    return np.where(excess > 0, 0, np.where(low > rounding, 1, np.where(high < -rounding, -1, 0)))


def windings(owners: IndexArray, across: FloatArray, excess: FloatArray, count: int, margin: float) -> IndexArray:
    """(count,): the winding number of the borders of all pieces of an owner about the origin; 0 if unknown.

    owners: (K,) intp; across: (2, 16, K), the pieces' coefficients across the direction; excess: (K,), of the pieces;
    margin: the rounding allowance.

    A curve may be drawn straight from end to end if its hull does not contain the place; otherwise its halves are
    examined.
    """
    excess = excess + margin
    near = np.flatnonzero((across.min(axis=1) <= excess).all(axis=0) & (across.max(axis=1) >= -excess).all(axis=0))
    owners, excess = np.repeat(owners[near], 4), np.repeat(excess[near], 4)
    curves = across.take(near, axis=2)[:, SIDES.T].swapaxes(2, 3).reshape(2, 4, -1)
    wound, is_known = np.zeros(count, dtype=np.intp), np.ones(count, dtype=bool)
    while len(owners):
        is_clear = _are_clear(curves, excess)
        np.add.at(wound, owners[is_clear], _crossings(curves[:, :, is_clear]))
        # Halving makes hulls narrower, but not their excess.
        is_narrow = np.ptp(curves, axis=1).max(axis=0) <= NARROW * excess
        is_known[owners[~is_clear & is_narrow]] = False
        left = np.flatnonzero(~is_clear & ~is_narrow & is_known[owners])
        owners, excess = np.repeat(owners[left], 2), np.repeat(excess[left], 2)
        curves = np.einsum("hij,djn->dinh", HALVES, curves[:, :, left]).reshape(2, 4, -1)
    return np.where(is_known, wound, 0)


def _are_clear(curves: FloatArray, excess: FloatArray) -> BoolArray:
    """(n,) bool: whether the origin lies beside the hulls of curves (2, 4, n), in coordinates along their chords."""
    x, y = curves
    chord = curves[:, 3] - curves[:, 0]
    chord /= np.maximum(np.hypot(*chord), np.finfo(float).tiny)
    along, aside = chord[0] * x + chord[1] * y, chord[0] * y - chord[1] * x
    return (
        (along.min(axis=0) > excess)
        | (along.max(axis=0) < -excess)
        | (aside.min(axis=0) > excess)
        | (aside.max(axis=0) < -excess)
    )


def _crossings(curves: FloatArray) -> IndexArray:
    """(n,): 1 where the chord of a curve (2, 4, n) crosses the first axis beyond the origin upwards, -1 downwards."""
    x, y = curves
    upwards = (y[3] > 0).astype(np.intp) - (y[0] > 0)
    is_right = (x[0] * y[3] - x[3] * y[0] > 0) == (y[3] > y[0])
    return np.where(is_right, upwards, 0)
