# SPDX-License-Identifier: GPL-3.0-or-later
"""The values that the heat map shows, and their colours."""

from __future__ import annotations

from enum import Enum

import bpy
import numpy as np
from numpy.typing import NDArray

from ..exchange.blender_arrays import face_sizes
from ..exchange.face_values import (
    ANGLE_KIND,
    BOUND_KIND,
    COLOR,
    COLOR_KIND,
    DEPTH_KIND,
    DEVIATION_KIND,
    AttributeKind,
    read_face_values,
    rounded_up,
    write_face_values,
)
from ..registration import redraw
from . import mesh_values
from .colors import LAST_DEPTH, scale_colors, to_linear

Values = NDArray[np.int32] | NDArray[np.float32]


class Shown(Enum):
    """The kinds of values in the heat map, by name in the scene's setting: with a title for legends, and the attribute
    that has the values."""

    DEPTH = "Levels Needed", DEPTH_KIND
    DISTANCE = "Proved Distance", BOUND_KIND
    DEVIATION = "Deviation", DEVIATION_KIND
    ANGLE = "Proved Angle", ANGLE_KIND

    def __init__(self, title: str, values: AttributeKind) -> None:
        self.title, self.values = title, values


def shown(settings: bpy.types.PropertyGroup) -> Shown | None:
    """The kind of values that the scene's heat map shows; None without a heat map."""
    return Shown.__members__.get(settings.heat_map)


def show(context: bpy.types.Context, kind: Shown) -> None:
    """Switch the scene's heat map to a kind of values that was just made, unless the map is off."""
    settings = context.scene.ccdepth
    # A setting that is written, even unchanged, ends the caches of simulations in the scene.
    if shown(settings) not in (None, kind):
        settings.heat_map = kind.name
    redraw(context)


def last_kind(mesh: bpy.types.Mesh) -> Shown | None:
    """The kind of the mesh's last values; of an adaptive mesh the distances, as no face needs more levels."""
    if mesh_values.is_deviation_last(mesh):
        return Shown.DEVIATION
    if not mesh_values.has_depths(mesh):
        return None
    return Shown.DISTANCE if mesh.ccdepth.subdivision else Shown.DEPTH


def has_shown(mesh: bpy.types.Mesh, kind: Shown) -> bool:
    """Whether the mesh has values of a kind to show, with their record."""
    if kind is Shown.ANGLE:
        return mesh_values.has_angles(mesh)
    if kind is Shown.DEVIATION:
        return mesh_values.has_deviation(mesh)
    return mesh_values.has_depths(mesh) and not is_left_out(mesh, kind)


def is_left_out(mesh: bpy.types.Mesh, kind: Shown) -> bool:
    """Whether values of a kind are not shown although the mesh may have them: no depths of an adaptive mesh, so that
    the mesh itself is seen first."""
    return kind is Shown.DEPTH and bool(mesh.ccdepth.subdivision)


def tolerance_of(mesh: bpy.types.Mesh, kind: Shown) -> float:
    """The tolerance of values, as a length in the scene, or of angles in radians; 0 without a record."""
    record = mesh.ccdepth
    if kind is Shown.ANGLE:
        return float(max(record.shading_angle, record.facet_angle))
    return float((record.measurement if kind is Shown.DEVIATION else record).world_tolerance)


def top(kind: Shown, tolerance: float, settings: bpy.types.PropertyGroup) -> float:
    """The value that has the last colour, in single precision; never 0."""
    if kind is Shown.DEPTH:
        return float(LAST_DEPTH)
    is_fixed = settings.distance_range == "FIXED" and kind is not Shown.ANGLE
    # The largest value of an attribute, rounded up to single precision, is not beyond it.
    return float(rounded_up(settings.distance_top if is_fixed else tolerance)) or 1.0


def on_scale(kind: Shown, values: Values) -> NDArray[np.float32]:
    """Values of an attribute on the scale: deeper depths become the last depth."""
    return (values.clip(0, LAST_DEPTH) if kind is Shown.DEPTH else values).astype(np.float32)


def write_colors(mesh: bpy.types.Mesh, kind: Shown, tolerance: float, settings: bpy.types.PropertyGroup) -> None:
    """Write and display the colours of the values as a colour attribute, linear and opaque, in Object Mode. Raises
    WriteError, with nothing changed."""
    values = on_scale(kind, read_face_values(mesh, kind.values))
    linear = to_linear(scale_colors(values / np.float32(top(kind, tolerance, settings))))
    colors = np.concatenate([linear, np.ones((len(linear), 1))], axis=1).astype(np.float32)
    write_face_values(mesh, {COLOR_KIND: np.repeat(colors, face_sizes(mesh), axis=0)})
    mesh.attributes.active_color_name = COLOR
