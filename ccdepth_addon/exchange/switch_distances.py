# SPDX-License-Identifier: GPL-3.0-or-later
"""Switches to levels of detail, as custom properties, which exporters write."""

from __future__ import annotations

from typing import NamedTuple, Self

import bpy

PREFIX = "ccdepth_"


class Switch(NamedTuple):
    """A level of detail, and when to show it. error: the proved distance from the limit surface. distance: from the
    nearest point, where the error in the middle of the view is a pixel; both are lengths in the scene. screen_size: of
    the sphere around the bounding box, in heights of the view, as it is then, or smaller."""

    level: int
    error: float
    distance: float
    screen_size: float

    @classmethod
    def read(cls, holder: bpy.types.Object) -> Self | None:
        """The switch as written; None on objects that are no levels of detail, and where a user removed it."""
        values = [holder.get(PREFIX + name) for name in cls._fields]
        return None if None in values else cls(*values)

    def in_units(self, scale: float) -> Self:
        """The same with lengths times a factor."""
        return self._replace(error=self.error * scale, distance=self.distance * scale)

    def write(self, holder: bpy.types.Object) -> None:
        """Write custom properties."""
        for name, value in self._asdict().items():
            holder[PREFIX + name] = value


def remove(holder: bpy.types.Object) -> None:
    """Remove the custom properties."""
    for name in Switch._fields:
        holder.pop(PREFIX + name, None)
