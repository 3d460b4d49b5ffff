# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of objects by the camera of a tolerance in pixels, now or over the scene's frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np

from ..core import FloatArray, Pixels, Variation, View, most_pixels, surface_boxes
from ..exchange.cameras import CameraError, named_camera, of_object, view_of
from ..exchange.control_mesh import ControlMesh, ControlMeshError
from ..exchange.data_blocks import Identity
from .frames import chosen_frames, frame_restored, typed_frames
from .surfaces import ComputeError, Surface, SurfaceSettings, relative_matrix


@dataclass(frozen=True)
class Views:
    """By the session identifiers of objects, on each frame the view from the object's place, and the linear part of its
    matrix there, (3, 3). off_screen: the factor for what is off screen."""

    of_objects: dict[int, list[tuple[View, FloatArray]]]
    off_screen: float

    def pixels(self, uid: int, control: ControlMesh) -> Pixels:
        """The lengths of a pixel on an object with this control mesh, with the least as the unit. Raises
        ControlMeshError."""
        views = tuple(view.moved(relative_matrix(world, control.world)) for view, world in self.of_objects[uid])
        found = Pixels(1.0, (views,), self.off_screen)
        # Positions that are not finite are found and refused later.
        with np.errstate(all="ignore"):
            return replace(found, unit=float(found.extremes(*surface_boxes(control.in_world))[0].min()))


def surface_of(
    blender_object: bpy.types.Object,
    control: ControlMesh,
    settings: SurfaceSettings,
    views: Views,
    painted: Variation | None = None,
) -> Surface:
    """The surface of an object, with the tolerance as a length. painted: as of ``Surface``. Raises ControlMeshError for
    a tolerance of more pixels than can be proved."""
    holder = Identity.of(blender_object)
    if settings.tolerance_mode == "PIXELS":
        pixels, factors = views.pixels(holder.uid, control), np.ones(1) if painted is None else painted.factors
        largest, most = settings.tolerance * factors.max(), min(map(most_pixels, pixels.views[0]))
        if largest > most:
            raise ControlMeshError(f"its tolerance is up to {largest:.3g} pixels, and at most {most:.3g} can be proved")
        return Surface(holder, control, settings.tolerance * pixels.unit, painted, pixels)
    unit = control.diagonal() if settings.tolerance_mode == "RELATIVE" else 1.0
    return Surface(holder, control, settings.tolerance * unit, painted)


def read_views(context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: SurfaceSettings) -> Views:
    """The views of objects by the settings' camera on their frames; none for other tolerances than pixels. Raises
    ComputeError without a camera of finite pixels."""
    views = Views({each.session_uid: [] for each in objects}, settings.off_screen_scale)
    if settings.tolerance_mode != "PIXELS":
        return views
    if not settings.off_screen_scale >= 1:
        raise ComputeError("The Off-Screen Scale must be 1 or more")
    frames = chosen_frames(context.scene, settings.camera_frames, "")
    context.view_layer.update()
    if not frames:
        _add_views(context, objects, settings, views)
        return views
    with frame_restored(context.scene):
        for frame in typed_frames(frames):
            context.scene.frame_set(frame)
            _add_views(context, objects, settings, views)
    return views


def _add_views(
    context: bpy.types.Context, objects: Sequence[bpy.types.Object], settings: SurfaceSettings, views: Views
) -> None:
    """Add the views of the present frame."""
    try:
        camera = named_camera(context.scene, settings.camera)
        view = view_of(context, camera)
    except CameraError as fault:
        raise ComputeError(str(fault)) from fault
    for each in objects:
        world = np.array(each.matrix_world, dtype=np.float64)[:3, :3]
        views.of_objects[each.session_uid].append((of_object(view, each), world))


def camera_name(scene: bpy.types.Scene, settings: Any) -> str:
    """The name of the camera of a tolerance in pixels; empty without one."""
    return settings.camera or (scene.camera.name if scene.camera else "")


def seen_from(scene: bpy.types.Scene, settings: SurfaceSettings, frames: str = "") -> str:
    """The camera and the frames of a tolerance in pixels, in words; empty for other tolerances. frames: of depths, if
    these have their own."""
    if settings.tolerance_mode != "PIXELS":
        return ""
    frames = frames or chosen_frames(scene, settings.camera_frames, "")
    name = camera_name(scene, settings)
    return f"{name}, frames {frames}" if frames else f"{name}, frame {scene.frame_current}"
