# SPDX-License-Identifier: GPL-3.0-or-later
"""Common parts of the panels in the sidebar's CC Depth tab."""

from __future__ import annotations

import bpy


class SidebarPanel:
    """A panel in the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"


def settings_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column of settings with names at the left, like Blender's own, and without dots for keyframes."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def draw_alert(layout: bpy.types.UILayout, text: str) -> None:
    """A line in red."""
    row = layout.row()
    row.alert = True
    row.label(text=text, icon="ERROR")
