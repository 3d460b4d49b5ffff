# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive results → objects: new meshes with everything of the old ones, in place of these, beside the objects, or in
results that there are already, which keep everything but their meshes."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

from ..exchange.adaptive_mesh import UV_SMOOTH, new_mesh
from ..exchange.control_mesh import base_mesh
from ..exchange.data_blocks import is_writable, meshes_with, own_copy
from ..exchange.dependencies import StateAtFrame, object_state
from ..exchange.evaluated import Evaluated, batches, evaluated
from ..exchange.mesh_arrays import geometry_checksum
from ..exchange.modifiers import applied_modifiers, base_modifiers, subdivision_modifier
from ..state import out_of_date, result_record, results
from ..tasks.adaptive_task import AdaptiveResult, AdaptiveSettings
from ..tasks.surfaces import ComputeError, naming
from .scene_objects import hide, link_beside, show_in_local_view
from .selected_meshes import CHANGED, still_there

# Faces written in one go: few enough to keep the window responsive.
FACES_AT_ONCE = 1 << 17

NAME_SUFFIX = " Adaptive"


@dataclass(frozen=True)
class NewMesh:
    """A result, the session identifier of the mesh made for it, that mesh's checksum, and (F,) int32 its depths."""

    result: AdaptiveResult
    mesh_uid: int
    geometry: int
    depths: NDArray[np.int32]


class Placed(NamedTuple):
    """An object that has a result, and the object this was made from."""

    user: bpy.types.Object
    source: bpy.types.Object


# What gives meshes to the objects that each is for, which are returned as they are then; undone with the stack.
ObjectGroups = list[list[bpy.types.Object]]
Placing = Callable[[bpy.types.Context, ObjectGroups, list[bpy.types.Mesh], ExitStack], ObjectGroups]


def make_meshes(
    context: bpy.types.Context, answers: list[AdaptiveResult], settings: AdaptiveSettings, *, exact_normals: bool
) -> Generator[str, None, list[NewMesh]]:
    """Make the adaptive meshes in Object Mode, all or none; yields the stage.

    Nothing else changes, and no object uses them before they are placed. Raises ComputeError when an object has changed
    since it was read.
    """
    made: list[NewMesh] = []
    try:
        for batch in batches(answers, lambda answer: len(answer.adaptive.mesh.base_faces), FACES_AT_ONCE):
            yield f"Writing meshes: {len(made):,} of {len(answers):,}"
            context.view_layer.update()
            holders = [_sources(answer)[0] for answer in batch]
            bases = {each: base_modifiers(each, use_modifiers=settings.use_modifiers) for each in holders}
            with evaluated(context, bases) as copies:
                for answer, holder in zip(batch, holders, strict=True):
                    with naming(holder.name):
                        made.append(_make_mesh(context, answer, holder, settings, exact_normals, copies))
    except BaseException:
        bpy.data.batch_remove(meshes_with(each.mesh_uid for each in made))
        raise
    return made


def place_meshes(
    context: bpy.types.Context, made: list[NewMesh], settings: AdaptiveSettings, *, in_place: bool
) -> list[list[Placed]]:
    """Put meshes in the place of those they were made from, or beside them: see ``place``."""
    return place(context, made, partial(_place_instead if in_place else _place_all_beside, settings))


def place(context: bpy.types.Context, made: list[NewMesh], placing: Placing) -> list[list[Placed]]:
    """Put meshes where they belong, all or none; returns who has each of them, in the order of the task's targets.

    Raises ComputeError when an object is no longer what it was; whatever goes wrong, the meshes are removed and nothing
    is changed.
    """
    meshes = meshes_with(each.mesh_uid for each in made)
    try:
        sources = [_sources(each.result) for each in made]
        originals = [[still_there((name, None)) for name in each.result.task.object_names] for each in made]
        with ExitStack() as undo:
            users = placing(context, originals, meshes, undo)
            undo.pop_all()
    except BaseException:
        bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])
        raise
    # New objects have no matrix before.
    context.view_layer.update()
    for each, mesh, group in zip(made, meshes, users, strict=True):
        states = [StateAtFrame(object_state(user, use_modifiers=False), None) for user in group]
        out_of_date.remember_depths(mesh, each.geometry, each.depths, states)
    return [[Placed(*pair) for pair in zip(*groups, strict=True)] for groups in zip(users, sources, strict=True)]


def _sources(answer: AdaptiveResult) -> list[bpy.types.Object]:
    """The objects the result is made from. Raises ComputeError when one of them has changed since it was read."""
    return [still_there(target.source, answer.task.mesh_uid) for target in answer.task.targets]


def _make_mesh(
    context: bpy.types.Context,
    answer: AdaptiveResult,
    source: bpy.types.Object,
    settings: AdaptiveSettings,
    exact_normals: bool,
    copies: Evaluated,
) -> NewMesh:
    modifier = subdivision_modifier(source)
    uv_smooth = UV_SMOOTH if modifier is None else modifier.uv_smooth
    control = answer.task.surface.control
    base, own_control = base_mesh(context, source, use_modifiers=settings.use_modifiers, copies=copies)
    if own_control.key != control.key:
        raise ComputeError(CHANGED)
    mesh = new_mesh(base, control.mesh, answer.adaptive.mesh, uv_smooth=uv_smooth, exact_normals=exact_normals)
    try:
        mesh.name = source.name + NAME_SUFFIX
        results.write_adaptive(mesh, answer, settings, answer.adaptive.depths, answer.adaptive.bounds)
    except BaseException:
        bpy.data.meshes.remove(mesh)
        raise
    return NewMesh(answer, mesh.session_uid, geometry_checksum(mesh), answer.adaptive.depths)


def _place_instead(
    settings: AdaptiveSettings,
    _context: bpy.types.Context,
    originals: ObjectGroups,
    meshes: list[bpy.types.Mesh],
    undo: ExitStack,
) -> ObjectGroups:
    """Let each mesh take the place of that of its objects."""
    old = [found[0].data for found in originals]
    names = [mesh.name for mesh in old]
    for found, mesh in zip(originals, meshes, strict=True):
        give_mesh(mesh, found, undo)
    # What follows cannot be undone; of objects that are this file's own it does not fail.
    for found in originals:
        for original in found:
            _remove_applied_modifiers(original, settings)
    bpy.data.batch_remove([mesh for mesh in dict.fromkeys(old) if not mesh.users])
    for mesh, name in zip(meshes, names, strict=True):
        mesh.name = name
    return originals


def give_mesh(mesh: bpy.types.Mesh, users: Iterable[bpy.types.Object], undo: ExitStack) -> None:
    """Let objects use a mesh. Raises ComputeError when one does not take it."""
    for user in users:
        undo.callback(setattr, user, "data", user.data)
        user.data = mesh
        # In Edit Mode Blender says nothing, and does nothing.
        if user.data != mesh:
            raise ComputeError(CHANGED)


def _place_all_beside(
    settings: AdaptiveSettings,
    context: bpy.types.Context,
    originals: ObjectGroups,
    meshes: list[bpy.types.Mesh],
    undo: ExitStack,
) -> ObjectGroups:
    """Make objects with the meshes beside the originals, which are hidden."""
    layer_objects = context.view_layer.objects
    undo.callback(setattr, layer_objects, "active", layer_objects.active)
    return [
        [_place_beside(context, original, mesh, settings, undo) for original in found]
        for found, mesh in zip(originals, meshes, strict=True)
    ]


def _place_beside(
    context: bpy.types.Context,
    original: bpy.types.Object,
    mesh: bpy.types.Mesh,
    settings: AdaptiveSettings,
    undo: ExitStack,
) -> bpy.types.Object:
    """A copy of the object with the mesh, selected in its stead, and the object hidden, from the render as well."""
    if not original.visible_get():
        # It was, and one that has left the view layer can neither be hidden nor selected.
        raise ComputeError(CHANGED)
    copy = own_copy(original)
    undo.callback(bpy.data.objects.remove, copy)
    copy.name = original.name + NAME_SUFFIX
    _remove_applied_modifiers(copy, settings)
    copy.data = mesh
    link_beside(context, original, copy)
    show_in_local_view(context, copy)
    copy.select_set(original.select_get())
    if context.view_layer.objects.active == original:
        context.view_layer.objects.active = copy
    undo.callback(_show_again, original, selected=original.select_get(), render_hidden=original.hide_render)
    hide(original)
    return copy


def _show_again(original: bpy.types.Object, *, selected: bool, render_hidden: bool) -> None:
    """Show the objects that get a result again."""
    original.hide_render = render_hidden
    original.hide_set(False)
    original.select_set(selected)


def place_in_results(context: bpy.types.Context, made: list[NewMesh], settings: dict[str, Any]) -> list[str]:
    """Give each mesh to its results, and to the objects that share their mesh; returns notes for the user. Raises
    ComputeError, with nothing changed, when an object is no longer what it was."""
    notes: list[str] = []
    cleared: list[bool] = []
    from_source: list[list[bpy.types.Material | None]] = []

    def placing(
        _context: bpy.types.Context, updated: ObjectGroups, meshes: list[bpy.types.Mesh], undo: ExitStack
    ) -> ObjectGroups:
        old = [group[0].data for group in updated]
        cleared.extend(not results.has_result(mesh) for mesh in old)
        edited = [group[0].data for group in updated if result_record.is_edited(group[0])]
        for mesh, group in zip(meshes, _with_sharing(updated), strict=True):
            from_source.append(list(mesh.materials))
            _keep_materials(mesh, group)
            give_mesh(mesh, group, undo)
        # What follows cannot be undone, and does not fail.
        notes.extend(_take_places(meshes, old, edited, updated))
        # The tolerance is proved for these alone, and not for objects of other scales that share their meshes.
        return updated

    for group, materials, was_cleared in zip(place(context, made, placing), from_source, cleared, strict=True):
        if was_cleared:
            results.clear(group[0].user.data)
        for each in group:
            out_of_date.remember_made(each.user, each.source, settings, materials)
    return notes


def _with_sharing(results: ObjectGroups) -> ObjectGroups:
    """The results, each with objects that share its mesh and are to go on doing so."""
    named = {result for group in results for result in group}
    sharing: dict[bpy.types.Mesh, list[bpy.types.Object]] = {}
    for other in bpy.data.objects:
        if other.type == "MESH" and other not in named and other.is_editable:
            sharing.setdefault(other.data, []).append(other)
    return [[*group, *sharing.pop(group[0].data, [])] for group in results]


def _keep_materials(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> None:
    """Put the materials that a user chose for the result in the place of those of the source."""
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


def _take_places(
    meshes: Sequence[bpy.types.Mesh],
    old: Sequence[bpy.types.Mesh],
    edited: Sequence[bpy.types.Mesh],
    results: ObjectGroups,
) -> list[str]:
    """Remove the meshes that nothing uses any more, keep those that a user edited, and give their names to the new
    ones; returns what to tell of it. A mesh whose place several took gives its name to the first."""
    notes = []
    groups = {before: (mesh, group[0]) for mesh, before, group in reversed([*zip(meshes, old, results, strict=True)])}
    for before, (mesh, result) in groups.items():
        if before.users or not is_writable(before):
            continue
        name = before.name
        if before in edited:
            before.name = f"Edited {name}"
            before.use_fake_user = True
            notes.append(f"{result.name}: the edited mesh is kept as “{before.name}”")
        else:
            bpy.data.meshes.remove(before)
        mesh.name = name
    return notes


def _remove_applied_modifiers(blender_object: bpy.types.Object, settings: AdaptiveSettings) -> None:
    for modifier in applied_modifiers(blender_object, use_modifiers=settings.use_modifiers):
        blender_object.modifiers.remove(modifier)
