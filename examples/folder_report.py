# SPDX-License-Identifier: GPL-3.0-or-later
"""The distances of all meshes in a folder of .blend files from their limit surfaces, as a table.

    blender -b --python-exit-code 1 --python examples/folder_report.py -- FOLDER

Lengths are in the scene. Needs the CC Depth extension installed; nothing is saved.
"""

import csv
import sys
from pathlib import Path

import bpy


def main(folder: Path) -> None:
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["file", "object", "deviation at most", "at least", "error"])
    for path in sorted(folder.glob("*.blend")):
        try:
            bpy.ops.wm.open_mainfile(filepath=str(path), use_scripts=False)
        except RuntimeError as fault:
            table.writerow([path.name, "", "", "", str(fault).strip()])
            continue
        for obj in [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]:
            try:
                with bpy.context.temp_override(selected_objects=[obj], active_object=obj):
                    bpy.ops.ccdepth.measure(time_limit=10)
            except RuntimeError as fault:
                table.writerow([path.name, obj.name, "", "", str(fault).strip()])
                continue
            record = obj.data.ccdepth
            # All digits, as rounding to nearest would promise too much.
            table.writerow([path.name, obj.name, record.deviation, record.deviation_reached, ""])
        sys.stdout.flush()


main(Path(sys.argv[sys.argv.index("--") + 1]))
