# SPDX-License-Identifier: GPL-3.0-or-later
"""The distances from which levels of detail are under a pixel, in the view of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, tan
from typing import NamedTuple, Self

import bpy
from mathutils import Vector

from ..exchange.switch_distances import Switch, remove
from . import result_record

# The vertical field of view without a perspective camera, that of three.js's camera.
DEFAULT_VIEW_ANGLE = radians(50)


class View(NamedTuple):
    """A perspective view. tangent: of half the vertical field of view; height: in pixels."""

    tangent: float
    height: float

    @classmethod
    def of(cls, scene: bpy.types.Scene) -> Self:
        """The view of the scene's settings, and for what they leave open that of its camera and its render."""
        settings, render, camera = scene.ccdepth, scene.render, scene.camera
        height = settings.view_height or render.resolution_y * render.resolution_percentage / 100
        if not settings.view_angle and camera is not None and camera.type == "CAMERA" and camera.data.type == "PERSP":
            corners = camera.data.view_frame(scene=scene)
            rows = [corner.y for corner in corners]
            return cls((max(rows) - min(rows)) / 2 / -corners[0].z, height)
        return cls(tan((settings.view_angle or DEFAULT_VIEW_ANGLE) / 2), height)


def switch_to(result: bpy.types.Object, view: View) -> Switch:
    """The switch to a level of detail with the facts of its making."""
    error = result.data.ccdepth.largest_bound
    distance = error * view.height / (2 * view.tangent)
    corners = [result.matrix_world @ Vector(corner) for corner in result.bound_box]
    radius = max((corner - other).length for corner in corners for other in corners) / 2
    # The middle of the sphere is at most its radius behind the nearest point.
    return Switch(result.ccdepth.level, error, distance, radius / max(distance + radius, radius) / view.tangent)


def write(scene: bpy.types.Scene, placed: Sequence[bpy.types.Object]) -> None:
    """Write the switches of new levels of detail among these results, as custom properties. A level that was cleared
    has no facts, and loses them."""
    view = View.of(scene)
    for each in placed:
        if result_record.is_level(each) and each.data.ccdepth.has_result:
            switch_to(each, view).write(each)
        elif result_record.is_level(each):
            remove(each)
