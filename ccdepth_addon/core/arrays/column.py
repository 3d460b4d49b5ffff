# SPDX-License-Identifier: GPL-3.0-or-later
"""An array that grows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# The least factor by which a column grows.
SLACK = 1.5


class Column:
    """An array that grows at its end: read and write ``values``; growth replaces these."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._room = values.copy()
        self._count = len(values)

    @property
    def values(self) -> NDArray[Any]:
        return self._room[: self._count]

    def append(self, more: NDArray[Any]) -> None:
        self.extend(len(more), more)

    def extend(self, count: int, more: Any) -> None:
        """Append a number of entries: one value for all, or one for each."""
        if self._count + count > len(self._room):
            room = max(self._count + count, int(SLACK * len(self._room)))
            grown = np.empty((room, *self._room.shape[1:]), self._room.dtype)
            grown[: self._count] = self.values
            self._room = grown
        self._room[self._count : self._count + count] = more
        self._count += count
