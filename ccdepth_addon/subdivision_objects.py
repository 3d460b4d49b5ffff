# SPDX-License-Identifier: GPL-3.0-or-later
"""Subdivisions → objects: their meshes with everything carried over, in the place of the objects or beside them."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from . import fingerprint, heat_map, results, staleness
from .control_mesh import applied_modifiers, base_mesh, subdivision_modifier
from .fingerprint import Topology
from .object_state import object_state
from .subdivided_object import CarryOptions, new_mesh
from .subdivision import Subdivision, SubdivisionSettings
from .surfaces import ComputeError, same_control_mesh
from .writing import WriteError, own_copy

NAME_SUFFIX = " Adaptive"

CHANGED = "The objects were changed in the meantime: nothing was written"


@dataclass(frozen=True)
class Placing:
    """How results become objects."""

    in_place: bool
    exact_normals: bool


def write_objects(
    context: bpy.types.Context, answers: list[Subdivision], settings: SubdivisionSettings, placing: Placing
) -> list[bpy.types.Object]:
    """Make the results' meshes, all or none, and put them where they belong; returns the objects that have them.

    In Object Mode. Raises ComputeError when an object is no longer what it was.
    """
    meshes: list[bpy.types.Mesh] = []
    placed: list[bpy.types.Object] = []
    try:
        for answer in answers:
            meshes.append(_new_result_mesh(context, answer, settings, placing))
        for answer, mesh in zip(answers, meshes, strict=True):
            placed += _place_and_describe(context, answer, mesh, settings, placing)
    except BaseException:
        bpy.data.batch_remove([mesh for mesh in meshes if not mesh.users])
        raise
    heat_map.synchronise(context)
    return placed


def _place_and_describe(
    context: bpy.types.Context,
    answer: Subdivision,
    mesh: bpy.types.Mesh,
    settings: SubdivisionSettings,
    placing: Placing,
) -> list[bpy.types.Object]:
    """Put a result where it belongs, and remember in its record what it depends on."""
    users = _place(context, answer, mesh, settings, placing)
    # New objects have no matrix of their own before.
    context.view_layer.update()
    made, states = answer.adaptive.mesh, [object_state(user, use_modifiers=False) for user in users]
    starts = made.face_starts[:-1].astype(np.int32)
    fingerprint.remember(users[0], states, Topology(starts, made.corner_vertices, made.edge_vertices))
    staleness.note_write(mesh)
    return users


def _new_result_mesh(
    context: bpy.types.Context, answer: Subdivision, settings: SubdivisionSettings, placing: Placing
) -> bpy.types.Mesh:
    """The mesh of an answer, used by no object yet. Raises ComputeError when it cannot be made."""
    name = answer.task.object_names[0]
    try:
        mesh = _carried_mesh(context, answer, settings, placing)
        try:
            mesh.name = name + NAME_SUFFIX
            results.write_subdivision(mesh, answer, settings)
        except BaseException:
            bpy.data.meshes.remove(mesh)
            raise
    except WriteError as fault:
        raise ComputeError(f"{name}: {fault}") from fault
    return mesh


def _carried_mesh(
    context: bpy.types.Context, answer: Subdivision, settings: SubdivisionSettings, placing: Placing
) -> bpy.types.Mesh:
    objects = [bpy.data.objects.get(name) for name in answer.task.object_names]
    if any(obj is None or obj.type != "MESH" or obj.data.session_uid != answer.task.mesh_uid for obj in objects):
        raise ComputeError(CHANGED)
    made_for = objects[0]
    modifier = subdivision_modifier(made_for)
    options = CarryOptions(limit_normals=placing.exact_normals)
    if modifier is not None:
        options = CarryOptions(uv_smooth=modifier.uv_smooth, limit_normals=placing.exact_normals)
    control = answer.task.surface.control
    with base_mesh(context, made_for, use_modifiers=settings.use_modifiers) as (base, own_control):
        if not same_control_mesh(own_control, control):
            raise ComputeError(CHANGED)
        if base != made_for.data:
            results.remember_same_colors(made_for.data, base)
        return new_mesh(base, control.mesh, answer.adaptive.mesh, options)


def _place(
    context: bpy.types.Context,
    answer: Subdivision,
    mesh: bpy.types.Mesh,
    settings: SubdivisionSettings,
    placing: Placing,
) -> list[bpy.types.Object]:
    originals = [bpy.data.objects[name] for name in answer.task.object_names]
    if not placing.in_place:
        return [_place_beside(context, original, mesh, settings) for original in originals]
    old = originals[0].data
    for original in originals:
        _take_modifiers_off(original, settings)
        original.data = mesh
    name = old.name
    if not old.users:
        bpy.data.meshes.remove(old)
    mesh.name = name
    return originals


def _place_beside(
    context: bpy.types.Context, original: bpy.types.Object, mesh: bpy.types.Mesh, settings: SubdivisionSettings
) -> bpy.types.Object:
    """A copy of the object with the mesh, selected in its stead, and the object hidden, from the render as well."""
    copy = own_copy(original)
    copy.name = original.name + NAME_SUFFIX
    _take_modifiers_off(copy, settings)
    copy.data = mesh
    _link_beside(context, original, copy)
    space = context.space_data
    if space is not None and space.type == "VIEW_3D" and space.local_view:
        copy.local_view_set(space, True)
    copy.select_set(original.select_get())
    if context.view_layer.objects.active == original:
        context.view_layer.objects.active = copy
    original.select_set(False)
    original.hide_set(True)
    original.hide_render = True
    return copy


def _link_beside(context: bpy.types.Context, original: bpy.types.Object, copy: bpy.types.Object) -> None:
    """Put the copy into the original's collections, and where all of them are of another file or overrides of its own,
    which take no objects, into the scene's."""
    collections = original.users_collection
    own = [collection for collection in collections if collection.is_editable and not collection.override_library]
    for collection in own or [context.scene.collection]:
        collection.objects.link(copy)


def _take_modifiers_off(blender_object: bpy.types.Object, settings: SubdivisionSettings) -> None:
    for modifier in applied_modifiers(blender_object, use_modifiers=settings.use_modifiers):
        blender_object.modifiers.remove(modifier)
