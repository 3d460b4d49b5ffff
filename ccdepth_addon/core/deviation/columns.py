# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables of things, pairs that spread to neighbours, and functionals of many points at once, one column each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray

# Stands where there is no such thing.
NONE = -1


@dataclass(frozen=True)
class Table:
    """N things with arrays of their properties, or tables in turn. AXIS: of the things in all arrays."""

    AXIS: ClassVar[int] = 0

    def at(self, chosen: NDArray[Any]) -> Self:
        """Chosen things, by index or (N,) bool."""
        chosen = np.flatnonzero(chosen) if chosen.dtype == bool else chosen
        return replace(
            self,
            **{
                name: each.at(chosen) if isinstance(each, Table) else each.take(chosen, axis=self.AXIS)
                for name, each in vars(self).items()
            },
        )

    def joined(self, others: list[Self]) -> Self:
        """These things and then those of others."""
        columns = {name: [vars(each)[name] for each in [self, *others]] for name in vars(self)}
        return replace(
            self,
            **{
                name: parts[0].joined(parts[1:]) if isinstance(parts[0], Table) else np.concatenate(parts, self.AXIS)
                for name, parts in columns.items()
            },
        )


@dataclass(frozen=True)
class ColumnTable(Table):
    """N things, the last axis of all arrays."""

    AXIS = -1


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
