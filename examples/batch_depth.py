# SPDX-License-Identifier: GPL-3.0-or-later
"""The Subdivision Surface level that every mesh of some files needs, as a table for a spreadsheet.

    for file in *.blend; do blender -b "$file" --python examples/batch_depth.py --python-exit-code 1 -- 0.002; done

The number is the tolerance, a distance in the scene. Needs the CC Depth extension installed; nothing is saved.
"""

import sys

import bpy


def cell(text: str) -> str:
    """The text with escapes for tabs, line breaks and control characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def main(tolerance: float) -> None:
    objects = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]
    print("file\tobject\tfaces\tlevel\tfaces at that level")
    for obj in objects:
        with bpy.context.temp_override(selected_objects=[obj], active_object=obj):
            bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="ABSOLUTE")
        # A modifier has one level for all faces: the first that is proved for all of them at once.
        found = obj.data.ccdepth
        names = f"{cell(bpy.data.filepath)}\t{cell(obj.name)}"
        print(f"{names}\t{found.faces}\t{found.uniform_level}\t{found.uniform_faces}", flush=True)


main(float(sys.argv[sys.argv.index("--") + 1]))
