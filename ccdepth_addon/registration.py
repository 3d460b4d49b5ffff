# SPDX-License-Identifier: GPL-3.0-or-later
"""Handlers, timers and redraws of Blender, the same everywhere."""

from __future__ import annotations

from collections.abc import Callable
from threading import current_thread, main_thread
from typing import Any

import bpy

# Seconds without a change before what has changed is examined.
PATIENCE = 0.3

# The name of a list in ``bpy.app.handlers``, and the function to call from there.
Handlers = tuple[tuple[str, Callable[..., Any]], ...]


def add_handlers(handlers: Handlers) -> None:
    """Let Blender call functions."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).append(handler)


def remove_handlers(handlers: Handlers) -> None:
    """Let Blender no longer call functions."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).remove(handler)


def is_of_window(depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether an update is of a window: renders and exporters evaluate in threads and dependency graphs of their own,
    which must not touch timers and data of the graphics card."""
    return depsgraph.mode == "VIEWPORT" and current_thread() is main_thread()


def call_soon(function: Callable[[], None]) -> None:
    """Let Blender call the function once it has not been asked to for a while."""
    do_not_call(function)
    bpy.app.timers.register(function, first_interval=PATIENCE)


def do_not_call(function: Callable[[], None]) -> None:
    """Cancel a requested call of the function."""
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)


def redraw(context: bpy.types.Context) -> None:
    """Redraw every 3D View, with its sidebar."""
    manager = context.window_manager
    for window in manager.windows if manager else ():
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()
