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
        column.prop(settings, "off_screen_scale", text="Off-Screen")


def draw_variation(column: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What the tolerance of depths and results varies by, for the active object."""
    settings, active = context.scene.ccdepth, context.active_object
    column.prop(settings, "tolerance_by")
    if settings.tolerance_by == "VERTEX_GROUP":
        if active is not None and active.type == "MESH":
            column.prop_search(settings, "vertex_group", active, "vertex_groups")
        else:
            column.prop(settings, "vertex_group")
        column.prop(settings, "coarsest")
    elif settings.tolerance_by == "MATERIAL" and active is not None and active.active_material is not None:
        column.prop(active.active_material.ccdepth, "tolerance_factor", text=active.active_material.name)
