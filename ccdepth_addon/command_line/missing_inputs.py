# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects of a file that depend on something missing: a driver that did not run, data of another file, or a file.
Blender evaluates such objects without it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from .scripted_drivers import scripts_allowed

# The kinds of data that do not shape an object.
NO_SHAPE = (bpy.types.Material, bpy.types.Scene, bpy.types.World)

# The kinds of data that are read from files of their own.
READ = (bpy.types.CacheFile, bpy.types.Image, bpy.types.VectorFont, bpy.types.Volume)


def missing_inputs(objects: Sequence[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """The objects that depend on something missing, and one such cause each.

    An object depends on all used data: its mesh and shape keys, its parent, the data named by its modifiers,
    constraints and drivers, and the data used by these.
    """
    bpy.context.view_layer.update()
    users = bpy.data.user_map()
    causes = {each: cause for each in users if not isinstance(each, NO_SHAPE) and (cause := _missing_for(each))}
    waiting = list(causes)
    while waiting:
        used = waiting.pop()
        for user in users.get(used, ()):
            if user not in causes and _is_shaped_by(user, used):
                causes[user] = causes[used]
                waiting.append(user)
    return {each: causes[each] for each in objects if each in causes}


def _is_shaped_by(user: bpy.types.ID, used: bpy.types.ID) -> bool:
    # Empties show images for reference alone.
    is_reference = isinstance(used, bpy.types.Image) and getattr(user, "type", "") == "EMPTY"
    return not (is_reference or isinstance(user, NO_SHAPE))


def _missing_for(block: bpy.types.ID) -> str | None:
    """The cause why a data-block itself is not what it should be, or None."""
    if block.is_missing and block.library is not None:
        return f"“{block.name}”, which is missing: it is linked from {bpy.path.abspath(block.library.filepath)}"
    path = _missing_file(block)
    return f"the file {path}, which is missing" if path else _failed_driver(block)


def _missing_file(block: bpy.types.ID) -> str | None:
    """The missing file among the files that the data-block is read from, or None."""
    paths: list[str] = []
    if isinstance(block, bpy.types.Object):
        paths = [each.filepath for each in block.modifiers if each.type == "MESH_CACHE" and each.show_viewport]
    elif isinstance(block, READ) and getattr(block, "source", "FILE") == "FILE" and block.filepath != "<builtin>":
        paths = [] if getattr(block, "packed_file", None) else [block.filepath]
    found = (bpy.path.abspath(path, library=block.library) for path in paths)
    return next((path for path in found if not Path(path).is_file()), None)


def _failed_driver(holder: bpy.types.ID) -> str | None:
    """A driver of this data-block that did not evaluate, if there is one."""
    animation = getattr(holder, "animation_data", None)
    for curve in animation.drivers if animation else ():
        if not curve.mute and not (curve.is_valid and curve.driver.is_valid):
            hint = "" if scripts_allowed() else "; blender -y runs the scripts of files"
            return f"a driver that did not run, “{curve.driver.expression or curve.data_path}”{hint}"
    return None
