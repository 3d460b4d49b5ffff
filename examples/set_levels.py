# SPDX-License-Identifier: GPL-3.0-or-later
"""Set the Subdivision Surface levels of all visible meshes of a file, and save it under another name.

    blender -b FILE --python-exit-code 1 --python examples/set_levels.py -- 0.002 OUT.blend

The number is the tolerance, a distance in the scene. Needs the CC Depth extension installed.
"""

import sys

import bpy


def main(tolerance: float, output: str) -> None:
    objects = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]
    with bpy.context.temp_override(selected_objects=objects, active_object=objects[0]):
        bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="ABSOLUTE")
        bpy.ops.ccdepth.set_levels()
    bpy.ops.wm.save_as_mainfile(filepath=output, copy=True)


arguments = sys.argv[sys.argv.index("--") + 1 :]
main(float(arguments[0]), arguments[1])
