# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects in the scene: linked beside others, with notes on what else uses both, shown in local view, and hidden."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import bpy

# The types of data-blocks that can take all objects of a collection: by instances, modifiers, nodes or particles.
TAKERS = {"OBJECT", "NODETREE", "PARTICLE"}


def link_beside(context: bpy.types.Context, other: bpy.types.Object, added: bpy.types.Object) -> None:
    """Link an object to the collections of another, or to the scene's if all of them are linked or overrides, which
    accept no objects. Blender itself has put the copy of a rigid body into the collection of rigid bodies."""
    collections = set(other.users_collection) - set(added.users_collection)
    own = [collection for collection in collections if collection.is_editable and not collection.override_library]
    for collection in own or [context.scene.collection]:
        collection.objects.link(added)


def notes_on_collections(pairs: Sequence[tuple[bpy.types.Object, bpy.types.Object]]) -> list[str]:
    """Notes on collections with a source and its result in them, one for each collection with a user that takes hidden
    objects as well."""
    users_of = bpy.data.user_map(subset=bpy.data.collections, value_types=TAKERS)
    notes = []
    for collection, users in users_of.items():
        takers = sorted(user.name for user in users | _rigid_body_scenes(collection) if _takes(user, collection))
        members = set(collection.all_objects) if takers else set()
        if any(members.issuperset(pair) for pair in pairs):
            notes.append(
                f"“{collection.name}” has source and result in it, and “{takers[0]}” uses both, though the source is "
                "hidden; take one of them out"
            )
    return notes


def _rigid_body_scenes(collection: bpy.types.Collection) -> set[bpy.types.ID]:
    """The scenes with the collection for their rigid bodies or constraints."""
    worlds = {scene: scene.rigidbody_world for scene in bpy.data.scenes if scene.rigidbody_world}
    return {scene for scene, world in worlds.items() if collection in (world.collection, world.constraints)}


def _takes(user: bpy.types.ID, collection: bpy.types.Collection) -> bool:
    """Whether a user of a collection takes its objects: a light, or an empty that shows no instances, does not."""
    if not isinstance(user, bpy.types.Object):
        return True
    is_instance = user.instance_type == "COLLECTION" and user.instance_collection == collection
    return is_instance or len(user.modifiers) > 0


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
