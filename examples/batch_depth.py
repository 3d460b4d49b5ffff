# SPDX-License-Identifier: GPL-3.0-or-later
"""The Subdivision Surface level that every mesh of some files needs, as a table for a spreadsheet.

    for file in *.blend; do blender -b "$file" --python examples/batch_depth.py --python-exit-code 1 -- 0.002; done

The number is the tolerance, a distance in the scene. Needs the CC Depth extension installed; nothing is saved.
"""

import sys

import bpy
import numpy as np


def depths_of(mesh: bpy.types.Mesh) -> np.ndarray:
    """(F,) int32: the depth of every face, from the attribute that Compute Depth writes."""
    depths = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.attributes["ccdepth"].data.foreach_get("value", depths)
    return depths


def cell(text: str) -> str:
    """A name may hold tabs, line breaks and whatever a terminal would obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def main(tolerance: float) -> None:
    objects = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]
    print("file\tobject\tfaces\tlevel\tfaces at that level")
    for obj in objects:
        with bpy.context.temp_override(selected_objects=[obj], active_object=obj):
            bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="ABSOLUTE")
        depths = depths_of(obj.data)
        # A modifier has one level for all faces: the deepest.
        level = depths.max()
        count = np.count_nonzero(depths == level)
        print(f"{cell(bpy.data.filepath)}\t{cell(obj.name)}\t{len(depths)}\t{level}\t{count}", flush=True)


main(float(sys.argv[sys.argv.index("--") + 1]))
