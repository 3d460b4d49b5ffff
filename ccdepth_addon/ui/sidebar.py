# SPDX-License-Identifier: GPL-3.0-or-later
"""Common parts of the panels in the sidebar's CC Depth tab, and the progress of a long run in the status bar."""

from __future__ import annotations

from time import perf_counter

import bpy


class SidebarPanel:
    """A panel in the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"


# The part of a row that names take, as in Blender's own columns of settings.
NAME_PART = 0.4


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


# The width of the bar, in units of the interface, and the time of a turn of the ring, in seconds.
BAR_WIDTH = 18
SECONDS_A_TURN = 1.5


def show_progress(context: bpy.types.Context, text: str, fraction: float | None) -> None:
    """Show the stage of a run, and the fraction done if it is known."""

    def draw(header: bpy.types.Header, _context: bpy.types.Context) -> None:
        row = header.layout.row()
        if fraction is None:
            row.progress(text="", factor=perf_counter() / SECONDS_A_TURN % 1.0, type="RING")
            row.label(text=text)
        else:
            bar = row.row()
            bar.ui_units_x = BAR_WIDTH
            bar.progress(text=text, factor=fraction, type="BAR")
        row.separator(factor=2.0)
        row.label(text="", icon="EVENT_ESC")
        row.label(text="Cancel, and Change Nothing")

    context.workspace.status_text_set(draw)


def hide_progress(context: bpy.types.Context) -> None:
    """Give the status bar back to Blender."""
    context.workspace.status_text_set(None)
