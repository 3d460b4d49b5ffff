# SPDX-License-Identifier: GPL-3.0-or-later
"""The permission of files to run scripts, and the objects that depend on drivers without it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

# Blender's options that begin the arguments of other programs, and its options that switch scripts on and off.
ENDS = ("-c", "--command", "--")
ON, OFF = ("-y", "--enable-autoexec"), ("-Y", "--disable-autoexec")

# The kinds of data that do not shape an object.
NO_SHAPE = (bpy.types.Material, bpy.types.Scene, bpy.types.World)


def scripts_allowed() -> bool:
    """Whether Blender was started with ``-y``. The last of ``-y`` and ``-Y`` holds; without either, scripts are off."""
    allowed = False
    # Blender as a module has the arguments of another program.
    for option in sys.argv[1:] if bpy.app.binary_path else ():
        if option in ENDS:
            break
        allowed = option in ON or (allowed and option not in OFF)
    return allowed


@contextmanager
def scripts_as_started() -> Iterator[None]:
    """Run scripts of files as `scripts_allowed` says, independent of the preferences.

    Blender follows the preference again whenever it opens its startup file or appends, so the choice of a single load
    does not last.
    """
    paths = bpy.context.preferences.filepaths
    before = paths.use_scripts_auto_execute
    paths.use_scripts_auto_execute = scripts_allowed()
    try:
        yield
    finally:
        paths.use_scripts_auto_execute = before


def without_drivers(objects: Sequence[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """The objects that depend on an unevaluated driver, and the expression of one such driver each.

    An object depends on all used data: its mesh and shape keys, its parent, the data named by its modifiers,
    constraints and drivers, and the data used by these.
    """
    bpy.context.view_layer.update()
    users = bpy.data.user_map()
    causes = {each: cause for each in users if (cause := _failed_driver(each)) is not None}
    waiting = list(causes)
    while waiting:
        used = waiting.pop()
        for user in users.get(used, ()):
            if user not in causes and not isinstance(user, NO_SHAPE):
                causes[user] = causes[used]
                waiting.append(user)
    return {each: causes[each] for each in objects if each in causes}


def _failed_driver(holder: bpy.types.ID) -> str | None:
    """The expression of a driver of this data-block that did not evaluate, if there is one."""
    animation = None if isinstance(holder, bpy.types.Material) else getattr(holder, "animation_data", None)
    for curve in animation.drivers if animation else ():
        if not curve.mute and not (curve.is_valid and curve.driver.is_valid):
            return curve.driver.expression or curve.data_path
    return None
