# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels of the sidebar's CC Depth tab share."""

from __future__ import annotations

import bpy


class SidebarPanel:
    """A panel in the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"


def settings_column(layout: bpy.types.UILayout, heading: str = "") -> bpy.types.UILayout:
    """A column of settings with their names at the left, like Blender's own, and nothing to key them with."""
    column = layout.column(heading=heading)
    column.use_property_split = True
    column.use_property_decorate = False
    return column
