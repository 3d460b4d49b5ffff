# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects in the scene: linked beside others, shown in local view, and hidden."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

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
    space = _local_view(context)
    if space is not None:
        blender_object.local_view_set(space, True)


@contextmanager
def in_local_view(context: bpy.types.Context, blender_object: bpy.types.Object) -> Iterator[None]:
    """Show the object in the operator's local view, if there is one, while this context lasts."""
    space = _local_view(context)
    was_in_view = space is not None and blender_object.local_view_get(space)
    show_in_local_view(context, blender_object)
    try:
        yield
    finally:
        if space is not None:
            blender_object.local_view_set(space, was_in_view)


def _local_view(context: bpy.types.Context) -> bpy.types.SpaceView3D | None:
    space = context.space_data
    return space if space is not None and space.type == "VIEW_3D" and space.local_view else None


def can_be_shown(blender_object: bpy.types.Object) -> bool:
    """Whether an object is shown once its closed eye is open."""
    is_hidden = blender_object.hide_get()
    blender_object.hide_set(False)
    is_shown = blender_object.visible_get()
    blender_object.hide_set(is_hidden)
    return bool(is_shown)


def hide(blender_object: bpy.types.Object) -> None:
    """Deselect an object, and hide it, from the render as well."""
    blender_object.select_set(False)
    blender_object.hide_set(True)
    if not blender_object.hide_render:
        blender_object.hide_render = blender_object.ccdepth.left_render = True


def show(blender_object: bpy.types.Object) -> None:
    """Show an object, and in the render if ``hide`` has hidden it from there."""
    blender_object.hide_set(False)
    if blender_object.ccdepth.left_render:
        blender_object.hide_render = blender_object.ccdepth.left_render = False
