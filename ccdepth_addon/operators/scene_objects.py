# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects in the scene: linked beside others, shown and hidden; and a pause of Edit Mode, which is left, and entered
again with the same objects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import bpy

from .refusals import refuse


def own_collections(
    context: bpy.types.Context, other: bpy.types.Object, without: Iterable[bpy.types.Collection] = ()
) -> list[bpy.types.Collection]:
    """The collections of an object, or the scene's if all of them are linked or overrides, which accept nothing."""
    collections = set(other.users_collection) - set(without)
    own = [collection for collection in collections if collection.is_editable and not collection.override_library]
    return own or [context.scene.collection]


def link_beside(context: bpy.types.Context, other: bpy.types.Object, added: bpy.types.Object) -> None:
    """Link an object to the collections of another. Blender itself has put the copy of a rigid body into the collection
    of rigid bodies."""
    for collection in own_collections(context, other, added.users_collection):
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


HIDDEN = "it is edited while it is hidden, and could not be edited again; show it first"


@contextmanager
def edit_mode_left(context: bpy.types.Context) -> Iterator[list[int]]:
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
