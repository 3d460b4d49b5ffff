# SPDX-License-Identifier: GPL-3.0-or-later
"""The progress of a long run in the status bar: a bar if the end is known, otherwise a turning ring, and the effect of
Esc."""

from __future__ import annotations

from time import perf_counter

import bpy

# The width of the bar, in units of the interface, and the time of a turn of the ring, in seconds.
BAR_WIDTH = 18
SECONDS_A_TURN = 1.5


def show(context: bpy.types.Context, text: str, fraction: float | None) -> None:
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


def hide(context: bpy.types.Context) -> None:
    """Give the status bar back to Blender."""
    context.workspace.status_text_set(None)
