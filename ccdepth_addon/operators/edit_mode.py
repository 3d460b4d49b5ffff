# SPDX-License-Identifier: GPL-3.0-or-later
"""Leave Edit Mode for a while, and enter it again with the same objects."""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def leave(context: bpy.types.Context) -> list[int]:
    """Leave the Edit Mode of meshes, if it is on; returns the session identifiers of the edited objects."""
    if context.mode != "EDIT_MESH":
        return []
    # Blender's own list lacks hidden ones.
    edited = [each.session_uid for each in context.view_layer.objects if each.mode == "EDIT"]
    bpy.ops.object.mode_set(mode="OBJECT")
    return edited


def enter(context: bpy.types.Context, uids: Iterable[int]) -> None:
    """Edit these objects and no others; what is selected and hidden stays so.

    Blender enters Edit Mode with what is selected and shown, but lets both change while it is on.
    """
    wanted = set(uids)
    if not wanted:
        return
    layer = context.view_layer
    # Until it is updated, the list has holes where objects were removed.
    layer.update()
    edited = [each for each in layer.objects if each.session_uid in wanted]
    if not edited:
        return
    hidden = [each for each in edited if each.hide_get()]
    for each in hidden:
        each.hide_set(False)
    selected = {each: each.select_get() for each in layer.objects}
    for each in selected:
        each.select_set(each in edited)
    if layer.objects.active not in edited:
        layer.objects.active = edited[0]
    bpy.ops.object.mode_set(mode="EDIT")
    for each, was_selected in selected.items():
        each.select_set(was_selected)
    for each in hidden:
        each.hide_set(True)
