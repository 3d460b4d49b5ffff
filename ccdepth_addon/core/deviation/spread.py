# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs that spread to neighbours."""

from __future__ import annotations

import numpy as np

from ..arrays.types import IndexArray

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
