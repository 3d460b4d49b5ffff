# SPDX-License-Identifier: GPL-3.0-or-later
"""Which meshes the last run refused because of some of their faces, for the panel to offer to select these."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from . import watch

# How many faces were at fault, by the session identifiers of meshes.
_refused: dict[int, int] = {}


def note(faces_at_fault: Mapping[str, int]) -> None:
    """Note how many faces the run that has just ended could not use, by the names of objects; none if it went well."""
    _refused.clear()
    for name, faces in faces_at_fault.items():
        holder = bpy.data.objects.get(name)
        # It may have been deleted while the run went on.
        if holder is not None:
            _refused[holder.data.session_uid] = faces


def faces_at_fault(mesh: bpy.types.Mesh) -> int:
    """How many faces of the mesh the last run could not use."""
    return _refused.get(mesh.session_uid, 0)


watch.clients.append(watch.Client(forget=_refused.clear))
