# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result depends on, as checksums and texts small enough to keep in its record."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import bpy
import numpy as np

from . import results
from .computation import count_faces, gram_matrix
from .control_mesh import SurfaceRule, counted_modifiers, mesh_arrays, own_mesh, read_values, surface_rule
from .core.mesh import FloatArray

# How far, relatively, an object's scale may drift by rounding while it is turned.
SCALE_DRIFT = 1e-5

# What a modifier says about its own display, and not about its mesh.
DISPLAY_FIELDS = {
    "execution_time", "is_active", "is_override_data", "name", "open_adaptive_subdivision_panel", "open_advanced_panel",
    "persistent_uid", "show_expanded", "show_in_editmode", "show_on_cage", "show_render", "use_pin_to_last",
}  # fmt: skip


@dataclass(frozen=True)
class ObjectState:
    """What a result depends on beside the mesh: an object's scale, as AᵀA (6,), and its modifiers, as text."""

    scale: FloatArray
    modifiers: str


def object_state(blender_object: bpy.types.Object, *, use_modifiers: bool) -> ObjectState:
    """The state of an object as it is now."""
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    return ObjectState(gram_matrix(world)[np.triu_indices(3)], _modifiers_text(blender_object, use_modifiers))


def remember(blender_object: bpy.types.Object, states: Iterable[ObjectState]) -> None:
    """Put into the record of the object's mesh what the result just written to it depends on."""
    record = blender_object.data.ccdepth
    record.fingerprint = mesh_checksum(blender_object)
    record.contributors.clear()
    for state in states:
        contributor = record.contributors.add()
        contributor.gram, contributor.modifiers = state.scale, state.modifiers


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
    return crc32(read_values(points, "co", np.float32, 3).tobytes())


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


def has_changed(mesh: bpy.types.Mesh, users: list[bpy.types.Object]) -> bool:
    """Whether the mesh, or an object its result was computed for, is no longer as its record tells."""
    record = mesh.ccdepth
    if not users or count_faces(mesh) != record.faces or mesh_checksum(users[0]) != record.fingerprint:
        return True
    present = [object_state(user, use_modifiers=record.use_modifiers) for user in users]
    return not all(any(_is_same(contributor, state) for state in present) for contributor in record.contributors)


def _is_same(contributor: bpy.types.PropertyGroup, state: ObjectState) -> bool:
    recorded = np.array(contributor.gram, dtype=np.float64)
    drift = np.abs(recorded - state.scale).max()
    return contributor.modifiers == state.modifiers and bool(drift <= SCALE_DRIFT * np.abs(recorded).max())
