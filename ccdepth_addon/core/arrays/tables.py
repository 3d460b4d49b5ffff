# SPDX-License-Identifier: GPL-3.0-or-later
"""Tables: many things, with an array for each of their properties."""

from __future__ import annotations

from dataclasses import Field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from .types import IndexArray
from .vectors import joined_vectors, selected_vectors


class Table:
    """A base of data classes for N things. Fields are arrays, tables in turn, or tuples of these; anything else counts
    for all things.

    A class names the ``axis`` of the things in its arrays, by default the first, and other axes by the names of fields:
    ``class Pieces(Table, hulls=-2)``. Axis -2 is that of component-major vectors (…, N, 3).
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    _axis: ClassVar[int]
    _axes: ClassVar[dict[str, int]]

    def __init_subclass__(cls, axis: int = 0, **axes: int) -> None:
        cls._axis, cls._axes = axis, axes

    def at(self, chosen: NDArray[Any]) -> Self:
        """Chosen things, by index or (N,) bool; the table itself if all are true."""
        if chosen.dtype == bool and chosen.all():
            return self
        indices = np.flatnonzero(chosen) if chosen.dtype == bool else chosen
        return replace(self, **{name: _selected(getattr(self, name), indices, axis) for name, axis in self._columns()})

    def joined(self, others: list[Self]) -> Self:
        """These things and then those of others; the table itself without others."""
        if not others:
            return self
        parts = {name: [getattr(each, name) for each in (self, *others)] for name, _ in self._columns()}
        return replace(self, **{name: _joined(parts[name], axis) for name, axis in self._columns()})

    def _columns(self) -> list[tuple[str, int]]:
        """The names of the fields, with their axes."""
        return [(field.name, self._axes.get(field.name, self._axis)) for field in fields(self)]


def _selected(column: Any, chosen: IndexArray, axis: int) -> Any:
    if isinstance(column, Table):
        return column.at(chosen)
    if isinstance(column, tuple):
        return tuple(_selected(each, chosen, axis) for each in column)
    if not isinstance(column, np.ndarray):
        return column
    return selected_vectors(column, chosen) if axis == -2 else column.take(chosen, axis=axis)


def _joined(parts: list[Any], axis: int) -> Any:
    if isinstance(parts[0], Table):
        return parts[0].joined(parts[1:])
    if isinstance(parts[0], tuple):
        return tuple(_joined(list(each), axis) for each in zip(*parts, strict=True))
    if not isinstance(parts[0], np.ndarray):
        return parts[0]
    return joined_vectors(parts) if axis == -2 else np.concatenate(parts, axis)
