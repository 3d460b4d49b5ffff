# SPDX-License-Identifier: GPL-3.0-or-later
"""Registering handlers and timers with Blender, the same way everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

# Seconds without a change before what has changed is examined.
PATIENCE = 0.3

# The name of a list in ``bpy.app.handlers``, and what is called from there.
Handlers = tuple[tuple[str, Callable[..., Any]], ...]


def add_handlers(handlers: Handlers) -> None:
    """Have Blender call these functions."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).append(handler)


def remove_handlers(handlers: Handlers) -> None:
    """Have Blender call them no more."""
    for name, handler in handlers:
        getattr(bpy.app.handlers, name).remove(handler)


def call_soon(function: Callable[[], None]) -> None:
    """Have Blender call the function when it has not been asked to for a while."""
    do_not_call(function)
    bpy.app.timers.register(function, first_interval=PATIENCE)


def do_not_call(function: Callable[[], None]) -> None:
    """Have Blender call the function no more, if it was going to."""
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)
