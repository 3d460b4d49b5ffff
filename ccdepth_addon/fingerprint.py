# SPDX-License-Identifier: GPL-3.0-or-later
"""Noticing that a result is stale, without computing anything while the interface is drawn.

A handler only notes which meshes with a result were touched. Some time later a timer compares their checksums with
those in the record, and keeps the answer until they are touched again.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from zlib import crc32

import bpy
import numpy as np
from bpy.app.handlers import persistent

from . import heat_map, results
from .computation import count_faces, gram_matrix
from .control_mesh import SurfaceRule, counted_modifiers, mesh_arrays, own_mesh, read_values, surface_rule
from .core.mesh import FloatArray

# Seconds without a change before checksums are compared.
PATIENCE = 0.3

# In Edit Mode a larger mesh is not read again after every change: any change of its geometry makes its result stale.
LARGEST_EDITED_FACE_COUNT = 200_000

# How far, relatively, an object's scale may drift by rounding while it is turned.
SCALE_DRIFT = 1e-5

# What a modifier says about its own display, and not about its mesh.
DISPLAY_FIELDS = {
    "execution_time", "is_active", "is_override_data", "name", "open_adaptive_subdivision_panel", "open_advanced_panel",
    "persistent_uid", "show_expanded", "show_in_editmode", "show_on_cage", "show_render", "use_pin_to_last",
}  # fmt: skip

_touched: set[int] = set()
_stale: set[int] = set()
_own_writes: set[int] = set()


def is_stale(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh has changed since its result was computed, as far as has been noticed yet."""
    return mesh.session_uid in _stale


def remember(mesh: bpy.types.Mesh, objects: Iterable[bpy.types.Object]) -> None:
    """Put into the record of a mesh that has just been written to what its result depends on."""
    record = mesh.ccdepth
    objects = list(objects)
    record.fingerprint = mesh_checksum(objects[0])
    record.contributors.clear()
    for blender_object in objects:
        contributor = record.contributors.add()
        contributor.gram = _scale_of(blender_object)
        contributor.modifiers = _modifiers_text(blender_object, record.use_modifiers)
    _stale.discard(mesh.session_uid)
    _own_writes.add(mesh.session_uid)


def mesh_checksum(blender_object: bpy.types.Object) -> str:
    """A checksum of the object's own mesh, as far as its surface depends on it, and of the depths on it."""
    with own_mesh(blender_object) as mesh:
        arrays = mesh_arrays(mesh, SurfaceRule())
        checksum = 0
        for array in (
            arrays.positions,
            arrays.face_starts,
            arrays.corner_vertices,
            arrays.edge_vertices,
            arrays.edge_sharpness,
            arrays.vertex_sharpness,
            _depths(mesh),
        ):
            checksum = crc32(array.tobytes(), checksum)
    return f"{checksum:08x}"


def _depths(mesh: bpy.types.Mesh) -> Any:
    attribute = mesh.attributes.get(results.DEPTH)
    return np.zeros(0) if attribute is None else read_values(attribute.data, "value", np.int32)


def _scale_of(blender_object: bpy.types.Object) -> FloatArray:
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    return gram_matrix(world)[np.triu_indices(3)]


def _modifiers_text(blender_object: bpy.types.Object, use_modifiers: bool) -> str:
    """Every setting the surface depends on: of the counted modifiers, and of the Subdivision Surface modifier."""
    counted = counted_modifiers(blender_object) if use_modifiers else []
    texts = [repr(surface_rule(blender_object)), _shape_keys_text(blender_object)]
    return "\n".join(texts + [_modifier_text(blender_object, modifier) for modifier in counted])


def _shape_keys_text(blender_object: bpy.types.Object) -> str:
    keys = blender_object.data.shape_keys
    if keys is None:
        return ""
    shown = (blender_object.show_only_shape_key, blender_object.active_shape_key_index)
    return repr((shown, [(key.value, key.mute, _checksum_of_points(key.data)) for key in keys.key_blocks]))


def _checksum_of_points(points: Any) -> int:
    return crc32(read_values(points, "co", np.float32).tobytes())


def _modifier_text(blender_object: bpy.types.Object, modifier: bpy.types.Modifier) -> str:
    fields = [
        f"{field.identifier}={_field_text(blender_object, field, getattr(modifier, field.identifier))}"
        for field in modifier.bl_rna.properties
        if field.identifier not in DISPLAY_FIELDS and field.type != "COLLECTION"
    ]
    # Only a Geometry Nodes modifier has keys: the inputs of its node group.
    inputs = [f"{key}={_value_text(blender_object, modifier[key])}" for key in _keys(modifier)]
    return " ".join(fields + inputs)


def _keys(modifier: bpy.types.Modifier) -> list[str]:
    return list(modifier.keys()) if modifier.type == "NODES" else []


def _field_text(blender_object: bpy.types.Object, field: bpy.types.Property, value: Any) -> str:
    if getattr(field, "is_array", False):
        return repr(list(value))
    return _value_text(blender_object, value)


def _value_text(blender_object: bpy.types.Object, value: Any) -> str:
    """A setting as text; another object as where it stands relative to this one, and what it is like."""
    if isinstance(value, bpy.types.Object):
        relative = blender_object.matrix_world.inverted_safe() @ value.matrix_world
        return repr(np.array(relative).round(5).tolist()) + _content_text(value)
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.bpy_struct):
        return type(value).__name__
    return repr(value)


def _content_text(blender_object: bpy.types.Object) -> str:
    if blender_object.type == "MESH" and not blender_object.data.is_editmode:
        return str(_checksum_of_points(blender_object.data.vertices))
    if blender_object.type == "ARMATURE":
        return repr([np.array(bone.matrix).round(5).tolist() for bone in blender_object.pose.bones])
    return ""


def _has_changed(mesh: bpy.types.Mesh, users: list[bpy.types.Object]) -> bool:
    record = mesh.ccdepth
    if not users or count_faces(mesh) != record.faces or mesh_checksum(users[0]) != record.fingerprint:
        return True
    present = [(_scale_of(user), _modifiers_text(user, record.use_modifiers)) for user in users]
    return not all(
        any(contributor.modifiers == text and _same_scale(contributor.gram, scale) for scale, text in present)
        for contributor in record.contributors
    )


def _same_scale(one: Any, other: FloatArray) -> bool:
    recorded = np.array(one, dtype=np.float64)
    return bool(np.abs(recorded - other).max() <= SCALE_DRIFT * np.abs(recorded).max())


def check_touched() -> None:
    """Compare the checksums of the meshes that were touched, and remember which have changed."""
    users = _users_of_results(_touched)
    _touched.clear()
    for mesh, objects in users.items():
        if _has_changed(mesh, objects):
            _stale.add(mesh.session_uid)
        else:
            _stale.discard(mesh.session_uid)
    if users:
        heat_map.redraw_viewports(bpy.context)


def _users_of_results(uids: set[int]) -> dict[bpy.types.Mesh, list[bpy.types.Object]]:
    """The meshes among these that hold a result, and the objects that use each."""
    users: dict[bpy.types.Mesh, list[bpy.types.Object]] = {
        mesh: [] for mesh in bpy.data.meshes if mesh.session_uid in uids and results.has_result(mesh)
    }
    for blender_object in bpy.data.objects if users else ():
        if blender_object.data in users:
            users[blender_object.data].append(blender_object)
    return users


def touch(mesh: bpy.types.Mesh) -> None:
    """Have the mesh's result checked soon."""
    _touched.add(mesh.session_uid)
    if bpy.app.timers.is_registered(check_touched):
        bpy.app.timers.unregister(check_touched)
    bpy.app.timers.register(check_touched, first_interval=PATIENCE)


@persistent
def _notice_updates(_scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    for update in depsgraph.updates:
        if not (update.is_updated_geometry or update.is_updated_transform):
            continue
        original = update.id.original
        if isinstance(original, bpy.types.Object) and original.type == "MESH" and results.has_result(original.data):
            _notice_update(original.data, update.is_updated_geometry)


def _notice_update(mesh: bpy.types.Mesh, geometry: bool) -> None:
    own_write = geometry and mesh.session_uid in _own_writes
    if geometry:
        _own_writes.discard(mesh.session_uid)
    if not mesh.is_editmode or count_faces(mesh) <= LARGEST_EDITED_FACE_COUNT:
        touch(mesh)
    elif geometry and not own_write:
        _stale.add(mesh.session_uid)


@persistent
def _check_everything(*_: Any) -> None:
    """After undo, redo and loading: data may have been replaced as a whole."""
    heat_map.synchronise(bpy.context)
    for mesh in bpy.data.meshes:
        if results.has_result(mesh):
            touch(mesh)


@persistent
def _forget_everything(*_: Any) -> None:
    for runtime in (_touched, _stale, _own_writes):
        runtime.clear()


HANDLERS = (
    ("depsgraph_update_post", _notice_updates),
    ("undo_post", _check_everything),
    ("redo_post", _check_everything),
    ("load_pre", _forget_everything),
    ("load_post", _check_everything),
)


def register() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)


def unregister() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(check_touched):
        bpy.app.timers.unregister(check_touched)
    _forget_everything()
