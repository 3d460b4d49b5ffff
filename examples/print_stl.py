# SPDX-License-Identifier: GPL-3.0-or-later
"""An STL file in millimetres for printing, with few triangles within a tolerance, of all visible meshes of a file.

    blender -b FILE --python-exit-code 1 --python examples/print_stl.py -- 0.1 OUT.stl

The number is the tolerance in millimetres. Needs the CC Depth extension installed.
"""

import sys

import bpy


def main(millimetres: float, output: str) -> None:
    unit = 1000 * bpy.context.scene.unit_settings.scale_length
    for obj in list(bpy.context.view_layer.objects):
        obj.select_set(obj.type == "MESH" and obj.visible_get())
    bpy.ops.ccdepth.subdivide(tolerance=millimetres / unit, tolerance_mode="ABSOLUTE", reduce=True)
    # The results are selected, and the originals are hidden.
    for result in bpy.context.selected_objects:
        record = result.data.ccdepth
        print(f"{result.name}: {record.faces} triangles, proved to be within {record.largest_bound * unit} mm")
    bpy.ops.wm.stl_export(filepath=output, export_selected_objects=True, global_scale=unit, check_existing=False)


arguments = sys.argv[sys.argv.index("--") + 1 :]
main(float(arguments[0]), arguments[1])
