# SPDX-License-Identifier: GPL-3.0-or-later
"""Common parts of the panels in the sidebar's CC Depth tab, and the progress of a long run: in place of its button and
in the status bar of every window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import bpy

CATEGORY = "CC Depth"


class SidebarPanel:
    """A panel in the tab."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = CATEGORY


# The part of a row that names take, as in Blender's own columns of settings.
NAME_PART = 0.4


def settings_column(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """A column of settings with names at the left, like Blender's own, and without dots for keyframes."""
    column = layout.column()
    column.enabled = _run is None
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def closed_panel(layout: bpy.types.UILayout, name: str, label: str) -> bpy.types.UILayout | None:
    """The body of a panel within a panel, closed at first; None while it is closed."""
    header, body = layout.panel(name, default_closed=True)
    header.label(text=label)
    return body


def draw_alert(layout: bpy.types.UILayout, text: str) -> None:
    """A line in red."""
    row = layout.row()
    row.alert = True
    row.label(text=text, icon="ERROR")


# The width of the bar, in units of the interface, and the time of a turn of the ring, in seconds.
BAR_WIDTH = 18
SECONDS_A_TURN = 1.5


@dataclass
class Run:
    """A long run: the name of its operator, empty if no button started it, its label, the stage as text, and the
    fraction done if it is known. is_cancelled: whether Cancel was pressed."""

    operator: str
    label: str
    text: str = ""
    fraction: float | None = None
    is_cancelled: bool = False

    def draw(self, layout: bpy.types.UILayout) -> None:
        """Add the stage as a bar, or with a ring."""
        turn = perf_counter() / SECONDS_A_TURN % 1.0
        factor, shape = (turn, "RING") if self.fraction is None else (self.fraction, "BAR")
        layout.progress(text=self.text, factor=factor, type=shape)


# The run that a button started.
_run: Run | None = None


def running() -> Run | None:
    """The run that a button started, if it goes on."""
    return _run


def draw_button(layout: bpy.types.UILayout, operator: str, icon: str) -> None:
    """The button of a long operator; during its run, the progress and Cancel."""
    column = layout.column(align=True)
    if _run is None or _run.operator != operator:
        # After a run Blender 4 draws the first text below the mouse's bar as a bar; here is an empty one for that.
        column.separator(factor=0.0)
        column.operator(operator, icon=icon)
        return
    row = column.row(align=True)
    _run.draw(row)
    row.operator("ccdepth.cancel", text="", icon="X")


def show_progress(context: bpy.types.Context, run: Run) -> None:
    """Show a run in the status bars, and in the tab if a button started it."""
    global _run
    _run = run if run.operator else _run

    def draw(header: bpy.types.Header, _context: bpy.types.Context) -> None:
        row = header.layout.row()
        bar = row.row()
        bar.ui_units_x = BAR_WIDTH
        run.draw(bar)
        row.separator(factor=2.0)
        row.label(text="", icon="EVENT_ESC")
        row.label(text="Cancel, and Change Nothing")

    context.workspace.status_text_set(draw)
    for _, region in _tabs(context):
        region.tag_redraw()


def hide_progress(context: bpy.types.Context, run: Run) -> None:
    """Give buttons and status bars back."""
    global _run
    _run = None if _run is run else _run
    # A window that is closed has no workspace any more.
    (context.workspace or bpy.data.workspaces[0]).status_text_set(None)
    for _, region in _tabs(context):
        region.tag_redraw()


def is_over_tab(context: bpy.types.Context, event: bpy.types.Event) -> bool:
    """Whether the mouse is over the tab, in the window of the context."""
    return any(
        window == context.window
        and 0 <= event.mouse_x - region.x < region.width
        and 0 <= event.mouse_y - region.y < region.height
        for window, region in _tabs(context)
    )


def _tabs(context: bpy.types.Context) -> Iterator[tuple[bpy.types.Window, bpy.types.Region]]:
    """The sidebars of 3D Views that show the tab, with their windows."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            for region in area.regions if area.type == "VIEW_3D" else ():
                if region.type == "UI" and region.width > 1 and region.active_panel_category == CATEGORY:
                    yield window, region
