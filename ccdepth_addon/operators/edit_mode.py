# SPDX-License-Identifier: GPL-3.0-or-later
"""A pause of Edit Mode: it is left for a while, and entered again with the same objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

from .scene_objects import can_be_shown
from .selected_meshes import refuse

HIDDEN = "it is edited while it is hidden, and could not be edited again; show it first"


@contextmanager
def left(context: bpy.types.Context) -> Iterator[list[int]]:
    """Leave the Edit Mode of meshes, if it is on, while this context lasts. Gives a changeable list of the session
    identifiers of the objects to be edited afterwards.

    Edit Mode can be on without the active object: with Lock Object Modes off, another object may become active
    meanwhile. Raises ComputeError, with nothing changed, if an object could not be edited again.
    """
    layer = context.view_layer
    # Blender's own list lacks hidden objects.
    edited = [each for each in layer.objects if each.type == "MESH" and each.mode == "EDIT"]
    refuse(edited, lambda each: None if can_be_shown(each) else HIDDEN)
    if edited:
        _set_mode(layer, edited, "OBJECT")
    uids = [each.session_uid for each in edited]
    try:
        yield uids
    finally:
        _enter(context, uids)


def _enter(context: bpy.types.Context, uids: Iterable[int]) -> None:
    """Edit these objects and no others, without a change of selected and hidden objects.

    Blender enters Edit Mode with the selected and shown objects, but lets both change meanwhile.
    """
    wanted = set(uids)
    if not wanted:
        return
    layer = context.view_layer
    # Without an update, the list has holes in place of removed objects.
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
    _set_mode(layer, edited, "EDIT")
    for each, was_selected in selected.items():
        each.select_set(was_selected)
    for each in hidden:
        each.hide_set(True)


def _set_mode(layer: bpy.types.ViewLayer, objects: list[bpy.types.Object], mode: str) -> None:
    """Set the mode of objects that are in one mode; the active object stays active."""
    active = layer.objects.active
    if active not in objects:
        layer.objects.active = objects[0]
    bpy.ops.object.mode_set(mode=mode)
    layer.objects.active = active
