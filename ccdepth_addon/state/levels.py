# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels that a Subdivision Surface modifier cannot have, or that make more faces than the Face Limit."""

from __future__ import annotations

from dataclasses import dataclass

import bpy


@dataclass(frozen=True)
class TooDeep:
    """A level at which all faces of a mesh are within the tolerance, and why it cannot be set.

    fitting: the deepest level that can be. faces_beyond: how many faces of the mesh need more than that.
    """

    reason: str
    fitting: int
    faces_beyond: int


def too_deep(record: bpy.types.PropertyGroup, face_limit: int) -> TooDeep | None:
    """Why the level in the record of a mesh cannot be set; None where it can."""
    needed, faces = record.uniform_level, int(record.uniform_faces)
    most = bpy.types.SubsurfModifier.bl_rna.properties["levels"].hard_max
    if needed > most:
        reason = f"it needs {needed} levels, and a Subdivision Surface modifier has {most} at most"
    elif faces > face_limit:
        reason = f"{needed} levels would make {faces:,} faces, and the Face Limit is {face_limit:,}"
    else:
        return None
    # After the first level each makes four faces of one.
    fitting = [level for level in range(1, min(needed, most + 1)) if faces >> 2 * (needed - level) <= face_limit]
    deepest = max(fitting, default=0)
    return TooDeep(reason, deepest, sum(row.faces for row in record.rows if row.depth > deepest))
