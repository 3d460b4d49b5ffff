# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects that a button works on, the same for panels and operators."""

from __future__ import annotations

import bpy

from ..tasks.surfaces import ComputeError
from . import result_record


def chosen(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The mesh objects that a button works on: the selected objects, or the active object if nothing is selected.

    In Edit Mode: the edited objects, and selected objects that share a mesh with them; undo covers no others there.
    """
    if context.mode == "EDIT_MESH":
        edited = dict.fromkeys([*context.objects_in_mode, *context.selected_objects])
        return [obj for obj in edited if obj.type == "MESH" and obj.data.is_editmode]
    active = context.active_object
    candidates = context.selected_objects or ([] if active is None else [active])
    return [obj for obj in candidates if obj.type == "MESH"]


def to_measure(context: bpy.types.Context) -> dict[bpy.types.Object, list[bpy.types.Object]]:
    """The objects to measure, by the object with the limit surface: results against their sources, an object alone
    against itself, and several others against the active one. Raises ComputeError."""
    objects, active = chosen(context), context.active_object
    if len(objects) == 1:
        return {surface_object(objects[0]): objects}
    results = [each for each in objects if result_record.control_object(each) != each]
    others = [each for each in objects if each not in results]
    if others and active not in objects:
        raise ComputeError(
            "Several objects are selected, and none is active: make the object with the limit surface active"
        )
    wanted: dict[bpy.types.Object, list[bpy.types.Object]] = {}
    for each in objects:
        if each in others and each != active:
            wanted.setdefault(active, []).append(each)
        # A result that is the active one among others is their limit surface.
        elif each in results and (each != active or not others):
            wanted.setdefault(surface_object(each), []).append(each)
    return wanted


def surface_object(measured: bpy.types.Object) -> bpy.types.Object:
    """The object of the limit surface for an object selected alone: itself, or for a result of Apply Adaptive
    Subdivision its source. Raises ComputeError for a removed source."""
    if not result_record.is_result(measured):
        return measured
    source = result_record.source_of(measured)
    if source is None or source.type != "MESH":
        raise ComputeError(f"{measured.name}: its source has been removed")
    return source
