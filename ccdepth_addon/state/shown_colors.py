# SPDX-License-Identifier: GPL-3.0-or-later
"""The colours of a result already on a mesh: which ones the scene's settings ask for, and writing them."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..exchange.result_attributes import (
    BOUND_KIND,
    COLOR_KIND,
    DEPTH_KIND,
    DEVIATION_KIND,
    AttributeKind,
    has_values,
    read_face_values,
    write_face_values,
)
from .colors import distance_colors, face_depth_colors
from .results import Shown, shown


def color_depths(settings: bpy.types.PropertyGroup) -> tuple[int, int]:
    """The depths that have the first and the last colour."""
    return settings.first_color_depth, settings.last_color_depth


def distance_top(settings: bpy.types.PropertyGroup, tolerance: float, largest: float) -> float:
    """The distance that has the last colour by the scene's settings; never 0."""
    tops = {"TOLERANCE": tolerance, "LARGEST": largest, "FIXED": settings.distance_top}
    return tops[settings.distance_range] or 1.0


def wanted_range(mesh: bpy.types.Mesh, kind: Shown, settings: bpy.types.PropertyGroup) -> tuple[float, float]:
    """What the first and the last colour are to stand for on the mesh."""
    record = mesh.ccdepth
    if kind is Shown.DEPTH:
        return color_depths(settings)
    if kind is Shown.BOUND:
        return 0.0, distance_top(settings, record.world_tolerance, record.largest_bound)
    found = record.measurement
    return 0.0, distance_top(settings, found.world_tolerance, found.largest_shown)


def is_current(mesh: bpy.types.Mesh, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the mesh has the colours that the settings ask for, or nothing to colour.

    Colours that the user has taken away are not to come back.
    """
    kind, record = shown(mesh), mesh.ccdepth
    if kind is None or not has_values(mesh, _values_of(kind)):
        return True
    if record.color_kind != kind.name:
        return False
    wanted = np.array(wanted_range(mesh, kind, settings), dtype=np.float32)
    return not has_values(mesh, COLOR_KIND) or np.array_equal(np.array(record.color_range, dtype=np.float32), wanted)


def write_colors(mesh: bpy.types.Mesh, settings: bpy.types.PropertyGroup) -> None:
    """Write the colours of the result on the mesh by the settings. Raises WriteError, with nothing changed."""
    kind = shown(mesh)
    if kind is None:
        return
    colors_range = wanted_range(mesh, kind, settings)
    write_face_values(mesh, {COLOR_KIND: face_colors(mesh, kind, colors_range)})
    mesh.ccdepth.color_kind, mesh.ccdepth.color_range = kind.name, colors_range


def face_colors(mesh: bpy.types.Mesh, kind: Shown, colors_range: tuple[float, float]) -> NDArray[np.float32]:
    """(F, 4) linear: the colours of the values on the mesh."""
    values = read_face_values(mesh, _values_of(kind))
    first, last = colors_range
    if kind is Shown.DEPTH:
        # A script may have written anything.
        return face_depth_colors(values.clip(0, int(last)), (int(first), int(last)))
    return distance_colors(values, last)


def _values_of(kind: Shown) -> AttributeKind:
    return {Shown.DEPTH: DEPTH_KIND, Shown.BOUND: BOUND_KIND, Shown.DEVIATION: DEVIATION_KIND}[kind]
