# SPDX-License-Identifier: GPL-3.0-or-later
"""Three levels of detail of every visible mesh of a file, each a tenth as near to the limit surface as the one before.

    blender -b FILE --python-exit-code 1 --python examples/lod_chain.py -- 0.0002 OUT.glb

The number is the finest tolerance, as a part of each object's size. Needs the CC Depth extension installed.
"""

import sys

import bpy


def main(finest: float, output: str) -> None:
    objects = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]
    made = []
    for source in objects:
        for level in range(3):
            # A result hides its source.
            source.hide_set(False)
            before = set(bpy.data.objects)
            with bpy.context.temp_override(selected_objects=[source], active_object=source):
                bpy.ops.ccdepth.subdivide(tolerance=finest * 10**level, tolerance_mode="RELATIVE")
            [result] = set(bpy.data.objects) - before
            result.name = f"{source.name}_LOD{level}"
            made.append(result)
            print(f"{result.name}: {len(result.data.polygons)} faces")
    for obj in list(bpy.context.view_layer.objects):
        obj.select_set(obj in made)
    # Heat maps are for modellers.
    bpy.ops.ccdepth.clear()
    bpy.ops.export_scene.gltf(filepath=output, use_selection=True, check_existing=False)


arguments = sys.argv[sys.argv.index("--") + 1 :]
main(float(arguments[0]), arguments[1])
