# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs that spread to neighbours, and functionals of many points at once, one column each."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray

# Stands where there is no such thing.
NONE = -1


class Spread:
    """Pairs of owners and things that spread from things to their neighbours. owners, things: (K,) intp, the latest
    pairs, each new, ascending."""

    def __init__(self, owners: IndexArray, things: IndexArray, count: int) -> None:
        """count: of all things."""
        self._count, self._known = count, np.array([NONE])
        self.go_on(owners, things)

    def go_on(self, owners: IndexArray, things: IndexArray) -> None:
        """Go on to those of the pairs (K,) that are new."""
        wanted = np.unique(owners * self._count + things)
        places = np.minimum(np.searchsorted(self._known, wanted), len(self._known) - 1)
        new = wanted[self._known[places] != wanted]
        # A stable sort merges two ascending runs.
        self._known = np.sort(np.concatenate([self._known, new]), kind="stable")
        self.owners, self.things = np.divmod(new, self._count)


def columns(rows: FloatArray) -> FloatArray:
    """(N, …) → (…, N), each value of all things next to each other, so that sums and maxima run along them."""
    return np.ascontiguousarray(np.moveaxis(rows, 0, -1))


def applied(functionals: FloatArray, points: FloatArray) -> FloatArray:
    """(k, 3, N) linear functionals of (3, m, N) points: (k, m, N)."""
    values = np.empty((len(functionals), *points.shape[1:]))
    product = np.empty(points.shape[1:])
    for functional, value in zip(functionals, values, strict=True):
        np.multiply(functional[0], points[0], out=value)
        for axis in (1, 2):
            value += np.multiply(functional[axis], points[axis], out=product)
    return values


def products(one: FloatArray, other: FloatArray) -> FloatArray:
    """(…, 3, N) twice → (…, N): scalar products."""
    total = one[..., 0, :] * other[..., 0, :]
    total += one[..., 1, :] * other[..., 1, :]
    total += one[..., 2, :] * other[..., 2, :]
    return total


def crosses(one: FloatArray, other: FloatArray) -> FloatArray:
    """(…, 3, N) twice → (…, 3, N): vector products."""
    product = np.empty(np.broadcast_shapes(one.shape, other.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(one[..., j, :], other[..., k, :], out=product[..., i, :])
        product[..., i, :] -= one[..., k, :] * other[..., j, :]
    return product
