# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake the heat map into a .blend file, as a colour attribute of each mesh that has a result.

python scripts/bake_colors.py FILE       with the bpy wheel
"""

import os
import sys
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy

import ccdepth_addon


def bake(path: str) -> None:
    bpy.ops.wm.open_mainfile(filepath=path)
    for each in bpy.context.view_layer.objects:
        each.select_set(each.type == "MESH")
    bpy.ops.ccdepth.bake_colors()
    # The file without colours is no version to keep.
    bpy.context.preferences.filepaths.save_version = 0
    bpy.ops.wm.save_mainfile()


ccdepth_addon.register()
status = 1
try:
    bake(sys.argv[1])
    status = 0
except Exception:
    traceback.print_exc()
# Not sys.exit: after an error the bpy module can crash or hang while the interpreter winds up.
os._exit(status)
