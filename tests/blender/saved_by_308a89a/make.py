# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes depths.blend beside it, with the add-on as it was at commit 308a89a. In a checkout of that commit:

    python path/to/make.py

with bpy 4.2, the oldest Blender there is an add-on for. A scene for each method and kind of vertices has its name from
these, both settings, and a cube with the depths; "Untouched" has what was the default, so that Blender stored neither.
"""

import sys
from itertools import product
from pathlib import Path

sys.path.insert(0, ".")

import bpy

import ccdepth_addon

METHODS = ("CERTIFIED", "SHARP", "SECOND_ORDER", "FIRST_ORDER")

bpy.ops.wm.read_factory_settings(use_empty=True)
ccdepth_addon.register()
[untouched] = bpy.data.scenes
untouched.name = "Untouched"
bpy.data.batch_remove([each for each in bpy.data.workspaces if each != bpy.context.workspace])
chosen = {f"{method} {vertices}": (method, vertices) for method, vertices in product(METHODS, ("CONTROL", "LIMIT"))}
for name in ("Untouched", *chosen):
    bpy.context.window.scene = bpy.data.scenes.get(name) or bpy.data.scenes.new(name)
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = bpy.context.object.data.name = name
    if name in chosen:
        settings = bpy.context.scene.ccdepth
        settings.method, settings.vertices = chosen[name]
    bpy.ops.ccdepth.compute()
bpy.ops.wm.save_as_mainfile(filepath=str(Path(__file__).with_name("depths.blend")), compress=True)
