# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's cameras → views of the core."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..core import View


class CameraError(ValueError):
    """The error of a camera without an image in pixels; the message gives the reason in a modeller's words."""


def named_camera(scene: bpy.types.Scene, name: str) -> bpy.types.Object:
    """The scene's camera, or with a name another camera of the scene. Raises CameraError."""
    found = scene.objects.get(name) if name else scene.camera
    if found is None or found.type != "CAMERA":
        reason = f"The scene has no camera called “{name}”" if name else "The scene has no camera"
        raise CameraError(f"{reason}, and the tolerance is a number of its pixels")
    return found


def view_of(context: bpy.types.Context, camera: bpy.types.Object) -> View:
    """The view of the evaluated scene by a camera, with the scene's render size. Raises CameraError.

    Pixels that are not square have the shorter side along both axes: an image in these is no smaller.
    """
    data, render = camera.data, context.scene.render
    if data.type not in {"PERSP", "ORTHO"}:
        raise CameraError(
            f"“{camera.name}” is neither a perspective nor an orthographic camera: its pixels have no size"
        )
    width, height = (side * render.resolution_percentage // 100 for side in (render.resolution_x, render.resolution_y))
    if min(width, height) < 1:
        raise CameraError(f"The image of “{camera.name}” has no pixels: raise the resolution of the render")
    place = np.array(camera.matrix_world.normalized(), dtype=np.float64)
    # Blender's own, with shift, sensor fit and the aspect of pixels: image coordinates from -1 to 1.
    projection = np.array(
        camera.calc_matrix_camera(
            context.evaluated_depsgraph_get(),
            x=width,
            y=height,
            scale_x=render.pixel_aspect_x,
            scale_y=render.pixel_aspect_y,
        ),
        dtype=np.float64,
    )
    is_perspective = data.type == "PERSP"
    lengths = projection[[0, 1], [0, 1]] * (width, height) / 2
    if not (np.isfinite(place).all() and np.isfinite(lengths).all() and lengths.min() > 0):
        raise CameraError(f"“{camera.name}” shows nothing: its place, scale or lens is no finite number")
    middle = -projection[:2, 2] if is_perspective else projection[:2, 3]
    size = np.array((width, height)) * lengths.max() / lengths
    try:
        inverse = np.linalg.inv(place)
    except np.linalg.LinAlgError as fault:
        raise CameraError(f"“{camera.name}” shows nothing: its scale is zero") from fault
    return View(
        to_camera=inverse[:3] * [[1.0], [1.0], [-1.0]],
        focal=float(lengths.max()),
        center=tuple(((1 + middle) / 2 * size).tolist()),
        size=tuple(size.tolist()),
        near=float(data.clip_start),
        is_perspective=is_perspective,
    )


def of_object(view: View, blender_object: bpy.types.Object) -> View:
    """The view from the object's place: of positions with its rotation and scale applied, without its location."""
    location = np.array(blender_object.matrix_world, dtype=np.float64)[:3, 3]
    moved = view.to_camera.copy()
    moved[:, 3] += moved[:, :3] @ location
    return replace(view, to_camera=moved)
