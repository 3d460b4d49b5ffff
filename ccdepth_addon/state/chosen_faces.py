# SPDX-License-Identifier: GPL-3.0-or-later
"""The meshes whose faces an operator selected in Object Mode, where Blender shows no selection: the overlay does, until
the mesh is edited."""

from __future__ import annotations

import bpy

_meshes: set[int] = set()


def note(mesh: bpy.types.Mesh) -> None:
    """Have the mesh's selection shown in Object Mode."""
    _meshes.add(mesh.session_uid)


def is_shown(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh's selection is shown in Object Mode; in Edit Mode a user selects, and it is not any more."""
    if mesh.is_editmode:
        _meshes.discard(mesh.session_uid)
    return mesh.session_uid in _meshes


def forget() -> None:
    """Show none any more."""
    _meshes.clear()
