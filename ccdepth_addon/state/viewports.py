# SPDX-License-Identifier: GPL-3.0-or-later
"""Viewports, redrawn."""

import bpy


def redraw(context: bpy.types.Context) -> None:
    """Redraw every 3D View, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
