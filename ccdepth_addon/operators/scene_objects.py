# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects in the scene: linked beside others, shown and hidden."""

from __future__ import annotations

from collections.abc import Sequence

import bpy


def link_beside(context: bpy.types.Context, other: bpy.types.Object, added: bpy.types.Object) -> None:
    """Link an object to the collections of another, or to the scene's if all of them are linked or overrides, which
    accept no objects. Blender itself has put the copy of a rigid body into the collection of rigid bodies."""
    collections = set(other.users_collection) - set(added.users_collection)
    own = [collection for collection in collections if collection.is_editable and not collection.override_library]
    for collection in own or [context.scene.collection]:
        collection.objects.link(added)


def show_in_local_view(context: bpy.types.Context, blender_object: bpy.types.Object) -> None:
    """Show the object in the operator's 3D View, if that is in local view."""
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and space.local_view:
        blender_object.local_view_set(space, True)


def can_be_shown(blender_object: bpy.types.Object) -> bool:
    """Whether an object is shown once its closed eye is open."""
    is_hidden = blender_object.hide_get()
    blender_object.hide_set(False)
    is_shown = blender_object.visible_get()
    blender_object.hide_set(is_hidden)
    return bool(is_shown)


def hide(blender_object: bpy.types.Object, result: bpy.types.Object) -> None:
    """Deselect a result or its source, and hide it, from the render as well. The result keeps what was hidden, as
    library overrides keep no values of ours."""
    blender_object.select_set(False)
    blender_object.hide_set(True)
    if not blender_object.hide_render:
        blender_object.hide_render = True
        setattr(result.ccdepth, _flag(blender_object, result), True)


def show(blender_object: bpy.types.Object, results: Sequence[bpy.types.Object]) -> None:
    """Show one of these results or the source of all, and in the render if ``hide`` has hidden it from there."""
    blender_object.hide_set(False)
    for each in results:
        flag = _flag(blender_object, each)
        if (blender_object == each or blender_object not in results) and getattr(each.ccdepth, flag):
            blender_object.hide_render = False
            setattr(each.ccdepth, flag, False)


def _flag(blender_object: bpy.types.Object, result: bpy.types.Object) -> str:
    return "result_left_render" if blender_object == result else "source_left_render"
