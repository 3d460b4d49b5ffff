# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on's command line without Blender's own program: ``python scripts/heat_map.py [MESH] [OPTION…]``."""

import os
import sys
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy  # noqa: F401  Everything else needs it to have been imported first.

import ccdepth_addon
from ccdepth_addon.command_line.command import run

ccdepth_addon.register()
status = 1
try:
    status = run(sys.argv[1:], program="heat_map.py", process=[sys.executable, __file__])
except Exception:
    traceback.print_exc()
# Not sys.exit: after an error the bpy module can crash or hang while the interpreter winds up.
os._exit(status)
