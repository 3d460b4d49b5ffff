# SPDX-License-Identifier: GPL-3.0-or-later
"""Three levels of detail of every visible mesh of a file, each a tenth as near to the limit surface as the one before.

    blender -b FILE --python-exit-code 1 --python examples/lod_chain.py -- 0.0002 OUT.glb

The number is the finest tolerance, as a part of each object's size. Needs the CC Depth extension installed. The numbers
of each level are extras in the file; three_lod.js reads them. `--lods 3 --lod-step 10` does the same without a script.
"""

import sys

import bpy

finest, output = sys.argv[sys.argv.index("--") + 1 :]
meshes = [each for each in bpy.context.view_layer.objects if each.type == "MESH" and each.visible_get()]
with bpy.context.temp_override(selected_objects=meshes, active_object=meshes[0]):
    bpy.ops.ccdepth.lods(count=3, step=10, tolerance=float(finest), tolerance_mode="RELATIVE")
for each in list(bpy.context.view_layer.objects):
    if each.ccdepth.level >= 0:
        each.hide_set(False)
    each.select_set(each.ccdepth.level >= 0)
# Heat maps are for modellers.
bpy.ops.ccdepth.clear()
bpy.ops.export_scene.gltf(filepath=output, use_selection=True, export_extras=True, check_existing=False)
