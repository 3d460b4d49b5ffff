# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance and what it depends on, in the sidebar."""

from __future__ import annotations

import bpy

from ..state.properties import tolerance_name

FIELDS = {"RELATIVE": "Fraction", "ABSOLUTE": "Distance", "PIXELS": "Pixels"}


def draw_tolerance(column: bpy.types.UILayout, scene: bpy.types.Scene) -> None:
    """The tolerance in its mode; with pixels, their camera and its frames."""
    settings = scene.ccdepth
    mode = settings.tolerance_mode
    column.prop(settings, tolerance_name(mode), text=FIELDS[mode])
    if mode == "PIXELS":
        column.prop_search(settings, "camera", scene, "objects", icon="CAMERA_DATA")
        column.prop(settings, "camera_frames", text="Frames")
        column.prop(settings, "off_screen_scale")
