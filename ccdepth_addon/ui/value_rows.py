# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and values beside each other, like properties, with tooltips that say what the values mean."""

from __future__ import annotations

import bpy

# By names, without the number of a level.
MEANINGS = {
    "Objects": "How many of the selected objects have a result",
    "Faces": "How many faces the mesh of the result has",
    "Deepest Depth": "The largest number of levels that a face needs to be within the tolerance of the limit surface",
    "Method": "How the distance to the limit surface was bounded",
    "Vertices": "Where the subdivided mesh has its vertices",
    "Frames": "The frames that depths were computed on: each face has the deepest one",
    "Tolerance": "The distance from the limit surface that was allowed, in the scene's unit",
    "Faces at Level": "How many faces there are when all of the mesh is subdivided to the level that is enough",
    "Least Possible": "On how many faces it is proved that no lesser depth is enough",
    "Deepest Part": "How many times the most divided part of a face was halved each way",
    "Base Faces": "How many faces the mesh had before it was subdivided",
    "Without Reduce": "How many triangles there were before Reduce",
    "Largest Distance": "No point of the mesh or of the limit surface is farther from the other one than this; proved",
    "Will Make": "How many faces Apply Adaptive Subdivision makes with these settings",
    "Before Reduce": "How many faces there are before Reduce takes most of them away",
    "Object": "The object that was measured",
    "Against": "Whose limit surface it was measured against",
    "At Most": "No point of the one is farther from the other than this; proved",
    "At Least": "A point that is as far away was found; the largest distance is between the two",
}


def draw_rows(layout: bpy.types.UILayout, rows: list[tuple[str, str]]) -> None:
    """Names and values; the names are those of ``MEANINGS``, whatever level follows."""
    column = layout.column(align=True)
    for name, value in rows:
        split = column.split(factor=0.45)
        for text, alignment in ((name, "RIGHT"), (value, "LEFT")):
            row = split.row()
            row.alignment = alignment
            button = row.operator("ccdepth.copy_value", text=text, translate=False, emboss=False)
            button.value, button.meaning = value, MEANINGS[name.rstrip("0123456789").rstrip()]
