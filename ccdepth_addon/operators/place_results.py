# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive answers → objects: new meshes with all data of the old meshes, placed beside the objects, instead of their
meshes, or in existing results, which keep everything but their meshes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ..exchange.adaptive_mesh import UV_SMOOTH, new_mesh
from ..exchange.changes import paused
from ..exchange.control_mesh import base_mesh, counted_copies, read
from ..exchange.data_blocks import is_writable, meshes_with, own_copy, removed_on_failure
from ..exchange.dependencies import ObjectState, object_state
from ..exchange.evaluated import Evaluated, batches
from ..exchange.mesh_arrays import geometry_checksum
from ..exchange.modifiers import applied_modifiers, left_out_sculpting, subdivision_modifier
from ..state import mesh_values, out_of_date, result_record
from ..state.properties import Settings
from ..tasks.adaptive_task import FINEST, AdaptiveAnswer, AdaptiveSettings, Level
from ..tasks.surfaces import ComputeError, naming
from .refusals import CHANGED, still_there
from .scene_objects import hide, link_beside, own_collections, show, show_in_local_view

# Faces written in one go: few enough to keep the window responsive.
FACES_AT_ONCE = 1 << 17

NAME_SUFFIX = " Adaptive"


@dataclass(frozen=True)
class NewMesh:
    """An answer, the session identifier of the mesh made for it, the mesh's checksum, and its depths, (F,) int32.
    sources: the checksums of its sources as they were read. level: of detail."""

    answer: AdaptiveAnswer
    mesh_uid: int
    geometry: int
    depths: NDArray[np.int32]
    sources: list[str]
    level: Level = FINEST


@dataclass
class Placement:
    """A mesh to place. users: the objects that get it; sources: the source for each of them. materials: of the source.
    old: the mesh of the first user; is_edited, was_cleared: whether a user changed it, and whether it has no depths."""

    made: NewMesh
    mesh: bpy.types.Mesh
    users: list[bpy.types.Object]
    sources: list[bpy.types.Object]
    materials: list[bpy.types.Material | None]
    old: bpy.types.Mesh
    is_edited: bool
    was_cleared: bool

    @classmethod
    def of(cls, made: NewMesh, mesh: bpy.types.Mesh) -> Placement:
        """Raises ComputeError if an object has changed."""
        users = still_there([target.user for target in made.answer.task.targets])
        old, is_edited = users[0].data, result_record.is_edited(users[0])
        was_cleared = not mesh_values.has_depths(old)
        return cls(made, mesh, users, _sources(made.answer), [*mesh.materials], old, is_edited, was_cleared)


def make_meshes(
    context: bpy.types.Context, answers: list[AdaptiveAnswer], settings: AdaptiveSettings, *, exact_normals: bool
) -> Generator[str, None, list[NewMesh]]:
    """Make the adaptive meshes in Object Mode, all or none; yields the stage.

    Nothing else changes, and no object uses a mesh before it is placed. Raises ComputeError if an object has changed
    since it was read.
    """
    made: list[NewMesh] = []
    with removed_on_failure([]) as uids:
        for batch in batches(answers, lambda answer: len(answer.adaptive.mesh.base_faces), FACES_AT_ONCE):
            yield f"Writing meshes: {len(made):,} of {len(answers):,}"
            holders = [_sources(answer)[0] for answer in batch]
            with counted_copies(context, holders, use_modifiers=settings.use_modifiers) as copies:
                for answer, holder in zip(batch, holders, strict=True):
                    with naming(holder.name):
                        made.append(_make_mesh(answer, holder, settings, exact_normals, copies))
                        uids.append(made[-1].mesh_uid)
    return made


# A way to place meshes, which adds what undoes it to the stack, and returns notes for the user.
Way = Callable[[bpy.types.Context, list[Placement], bool, ExitStack], list[str]]

# Results by the levels of detail and the objects that they were made for.
Placed = dict[tuple[Level, bpy.types.Object], bpy.types.Object]


def place(context: bpy.types.Context, made: list[NewMesh], settings: Settings, way: Way) -> tuple[Placed, list[str]]:
    """Place the meshes in one of the ways of this file, all or none, with their records.

    Returns the objects with results, and notes for the user. Raises ComputeError,
    with nothing changed and the meshes removed, if an object has changed.
    """
    with removed_on_failure([each.mesh_uid for each in made]) as uids:
        places = [Placement.of(*pair) for pair in zip(made, meshes_with(uids), strict=True)]
        wanted = [(each.made.level, user) for each in places for user in each.users]
        # Objects of ours that come into the scene are no change of the sources.
        with paused(context), ExitStack() as undo:
            notes = way(context, places, settings.values["use_modifiers"], undo)
            undo.pop_all()
    # New objects have no matrix before.
    context.view_layer.update()
    out_of_date.remember_depths({each.mesh: (each.made.geometry, each.made.depths, _states(each)) for each in places})
    for each in places:
        if way is in_results and each.was_cleared:
            mesh_values.clear(each.mesh)
        for user, source, checksum in zip(each.users, each.sources, each.made.sources, strict=True):
            if way is instead:
                # It came from nothing any more.
                result_record.forget(user)
            else:
                out_of_date.remember_made(user, source, settings, each.materials, checksum)
    return dict(zip(wanted, (user for each in places for user in each.users), strict=True)), notes


def _states(place: Placement) -> list[ObjectState]:
    """The states of the users, with the scales that were read: for those the proof holds, and not for objects of other
    scales that share the mesh."""
    targets = place.made.answer.task.targets
    return [
        replace(object_state(user, use_modifiers=False), scale=target.scale)
        for user, target in zip(place.users, targets, strict=True)
    ]


def _sources(answer: AdaptiveAnswer) -> list[bpy.types.Object]:
    """The sources of the result. Raises ComputeError if one of them has changed since it was read."""
    return still_there([target.source for target in answer.task.targets])


def _make_mesh(
    answer: AdaptiveAnswer,
    source: bpy.types.Object,
    settings: AdaptiveSettings,
    exact_normals: bool,
    copies: Evaluated,
) -> NewMesh:
    modifier = subdivision_modifier(source)
    uv_smooth = UV_SMOOTH if modifier is None else modifier.uv_smooth
    control = answer.task.surface.control
    if read(source, copies, use_modifiers=settings.use_modifiers).key != control.key:
        raise ComputeError(CHANGED)
    mesh = new_mesh(
        base_mesh(source, copies, use_modifiers=settings.use_modifiers),
        control.mesh,
        answer.adaptive.mesh,
        uv_smooth=uv_smooth,
        exact_normals=exact_normals,
        normals=answer.adaptive.normals,
    )
    with removed_on_failure([mesh.session_uid]):
        mesh.name = source.name + NAME_SUFFIX
        adaptive, has_angles = answer.adaptive, answer.task.has_angles(settings)
        values = adaptive.depths, adaptive.bounds, adaptive.ratios
        mesh_values.write_adaptive(mesh, answer, settings, *values, has_angles=has_angles)
    checksums = [result_record.source_checksum(each, use_modifiers=settings.use_modifiers) for each in _sources(answer)]
    return NewMesh(answer, mesh.session_uid, geometry_checksum(mesh), answer.adaptive.depths, checksums)


def instead(_context: bpy.types.Context, places: list[Placement], use_modifiers: bool, undo: ExitStack) -> list[str]:
    """Let each mesh take the place of its objects' mesh."""
    names = [each.old.name for each in places]
    for each in places:
        _give_mesh(each.mesh, each.users, undo)
    # The next steps cannot be undone; with the file's own objects they do not fail.
    for user in [user for each in places for user in each.users]:
        _remove_applied_modifiers(user, use_modifiers=use_modifiers)
    bpy.data.batch_remove([mesh for mesh in {each.old for each in places} if not mesh.users])
    for each, name in zip(places, names, strict=True):
        each.mesh.name = name
    return []


def beside(context: bpy.types.Context, places: list[Placement], use_modifiers: bool, undo: ExitStack) -> list[str]:
    """Put each mesh in new objects beside the hidden originals."""
    layer_objects = context.view_layer.objects
    undo.callback(setattr, layer_objects, "active", layer_objects.active)
    for each in places:
        originals = each.users
        each.users = [_copy_of(user, each.mesh, use_modifiers, undo) for user in originals]
        for original, copy in zip(originals, each.users, strict=True):
            copy.name = original.name + NAME_SUFFIX
            link_beside(context, original, copy)
            _show_instead(context, original, [copy], undo)
    return []


def as_levels(context: bpy.types.Context, places: list[Placement], use_modifiers: bool, undo: ExitStack) -> list[str]:
    """Put each mesh in new objects, the levels of detail of an original in a collection of their own beside it; only
    the finest is rendered."""
    layer_objects = context.view_layer.objects
    undo.callback(setattr, layer_objects, "active", layer_objects.active)
    levels: dict[bpy.types.Object, list[bpy.types.Object]] = {}
    for each in places:
        number, step = each.made.level
        originals = each.users
        each.users = [_copy_of(user, each.mesh, use_modifiers, undo) for user in originals]
        each.mesh.name = f"{originals[0].name}_LOD{number}"
        for original, copy in zip(originals, each.users, strict=True):
            copy.name = f"{original.name}_LOD{number}"
            copy.ccdepth.level, copy.ccdepth.level_step = number, step
            copy.hide_render = number > 0
            levels.setdefault(original, []).append(copy)
    for original, copies in levels.items():
        collection = bpy.data.collections.new(f"{original.name} LODs")
        undo.callback(bpy.data.collections.remove, collection)
        for parent in own_collections(context, original):
            parent.children.link(collection)
        for copy in copies:
            collection.objects.link(copy)
        _show_instead(context, original, copies, undo)
    return []


def in_results(
    _context: bpy.types.Context, places: list[Placement], _use_modifiers: bool, undo: ExitStack
) -> list[str]:
    """Give each mesh to its results, and to the objects that share their mesh."""
    for each, users in zip(places, _with_sharing(places), strict=True):
        _keep_materials(each.mesh, users)
        _give_mesh(each.mesh, users, undo)
    # The next steps cannot be undone, and do not fail.
    return _take_places(places)


def _give_mesh(mesh: bpy.types.Mesh, users: Iterable[bpy.types.Object], undo: ExitStack) -> None:
    """Let objects use a mesh. Raises ComputeError if an object does not take the mesh."""
    for user in users:
        undo.callback(setattr, user, "data", user.data)
        user.data = mesh
        # In Edit Mode Blender silently does nothing.
        if user.data != mesh:
            raise ComputeError(CHANGED)


def _copy_of(
    original: bpy.types.Object, mesh: bpy.types.Mesh, use_modifiers: bool, undo: ExitStack
) -> bpy.types.Object:
    """A copy of the object with the mesh, in no collection yet."""
    if not original.visible_get():
        # The object was selected, and an object outside the view layer can neither be hidden nor selected.
        raise ComputeError(CHANGED)
    copy = own_copy(original)
    undo.callback(bpy.data.objects.remove, copy)
    # A result that was subdivided is the source of its copy.
    result_record.forget(copy)
    _remove_applied_modifiers(copy, use_modifiers=use_modifiers)
    copy.data = mesh
    return copy


def _show_instead(
    context: bpy.types.Context, original: bpy.types.Object, copies: list[bpy.types.Object], undo: ExitStack
) -> None:
    """Select the copies instead of the object, and hide the object, from the render as well."""
    for copy in copies:
        show_in_local_view(context, copy)
        copy.select_set(original.select_get())
    if context.view_layer.objects.active == original:
        context.view_layer.objects.active = copies[0]
    undo.callback(setattr, original, "hide_render", original.hide_render)
    undo.callback(original.select_set, original.select_get())
    undo.callback(show, original, copies[:1])
    hide(original, copies[0])


def _with_sharing(places: list[Placement]) -> list[list[bpy.types.Object]]:
    """The results, each with the objects that share its mesh, and will share the new one."""
    named = {user for place in places for user in place.users}
    sharing: dict[bpy.types.Mesh, list[bpy.types.Object]] = {}
    for other in bpy.data.objects:
        if other.type == "MESH" and other not in named and other.is_editable:
            sharing.setdefault(other.data, []).append(other)
    return [[*place.users, *sharing.pop(place.users[0].data, [])] for place in places]


def _keep_materials(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> None:
    """Keep the materials that a user chose for the result, in place of the source's."""
    result = users[0]
    recorded = [each.material for each in result.ccdepth.materials]
    for index, material in enumerate(result.data.materials):
        is_own = index >= len(recorded) or recorded[index] != material
        is_own |= any(user.material_slots[index].link == "OBJECT" for user in users)
        if not is_own:
            continue
        while len(mesh.materials) <= index:
            mesh.materials.append(None)
        mesh.materials[index] = material


def _take_places(places: Sequence[Placement]) -> list[str]:
    """Remove unused old meshes, keep meshes edited by a user, and give their names to the new meshes; returns notes for
    the user. A mesh replaced by several gives its name to the first."""
    notes = []
    for before, place in {place.old: place for place in reversed(places)}.items():
        if before.users or not is_writable(before):
            continue
        name = before.name
        if place.is_edited:
            before.name = f"Edited {name}"
            before.use_fake_user = True
            notes.append(f"{place.users[0].name}: the edited mesh is kept as “{before.name}”")
        else:
            bpy.data.meshes.remove(before)
        place.mesh.name = name
    return notes


def _remove_applied_modifiers(blender_object: bpy.types.Object, *, use_modifiers: bool) -> None:
    """Remove the modifiers that the mesh replaces, and Multiresolution modifiers left out: without their sculpting they
    would only divide the faces."""
    applied = applied_modifiers(blender_object, use_modifiers=use_modifiers)
    for modifier in applied + left_out_sculpting(blender_object, use_modifiers=use_modifiers):
        blender_object.modifiers.remove(modifier)
