# SPDX-License-Identifier: GPL-3.0-or-later
"""The permission of files to run scripts, drivers among them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import bpy

# Blender's options before the arguments of other programs, and its options that switch scripts on and off.
ENDS = ("-c", "--command", "--")
ON, OFF = ("-y", "--enable-autoexec"), ("-Y", "--disable-autoexec")


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
