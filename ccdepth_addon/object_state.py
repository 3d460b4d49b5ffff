# SPDX-License-Identifier: GPL-3.0-or-later
"""What a result depends on beside the mesh: the object's scale, its modifiers, and what those look at."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import bpy
import numpy as np

from .control_mesh import counted_modifiers, read_values, surface_rule
from .core.mesh import FloatArray
from .surfaces import gram_matrix

# What modifiers and nodes say about their own display, and not about the mesh.
DISPLAY_PREFIXES = ("open_", "show_")
DISPLAY_FIELDS = {
    "color", "dimensions", "execution_time", "height", "is_active", "is_active_output", "is_override_data", "label",
    "location", "location_absolute", "name", "persistent_uid", "rna_type", "select", "use_custom_color",
    "use_pin_to_last", "warning_propagation", "width",
}  # fmt: skip

FIELD_TYPES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM", "POINTER"}


@dataclass(frozen=True)
class ObjectState:
    """An object's scale, as AᵀA (6,), and a checksum of everything else that shapes its surface."""

    scale: FloatArray
    checksum: str


def object_state(blender_object: bpy.types.Object, *, use_modifiers: bool) -> ObjectState:
    """The state of an object as it is now."""
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    counted = counted_modifiers(blender_object) if use_modifiers else []
    texts = [repr(surface_rule(blender_object)), _shape_keys_text(blender_object)]
    texts += [_modifier_text(blender_object, modifier) for modifier in counted]
    checksum = crc32("\n".join(texts).encode())
    return ObjectState(gram_matrix(world)[np.triu_indices(3)], f"{checksum:08x}")


def shown_checksum(blender_object: bpy.types.Object, shown: Iterable[bpy.types.Modifier]) -> str:
    """A checksum of what these modifiers, and shape keys, make of the object's mesh."""
    texts = [_shape_keys_text(blender_object)] + [_modifier_text(blender_object, modifier) for modifier in shown]
    return f"{crc32(chr(10).join(texts).encode()):08x}"


def _shape_keys_text(blender_object: bpy.types.Object) -> str:
    keys = blender_object.data.shape_keys
    if keys is None:
        return ""
    shown = blender_object.active_shape_key_index if blender_object.show_only_shape_key else None
    return repr((shown, [(key.value, key.mute, _checksum_of_points(key.data)) for key in keys.key_blocks]))


def _checksum_of_points(points: Any) -> int:
    return crc32(read_values(points, "co", np.float32, 3).tobytes())


def _modifier_text(blender_object: bpy.types.Object, modifier: bpy.types.Modifier) -> str:
    settings = _settings_text(blender_object, modifier)
    return settings + _inputs_text(blender_object, modifier) if modifier.type == "NODES" else settings


def _inputs_text(blender_object: bpy.types.Object, modifier: bpy.types.Modifier) -> str:
    """The inputs of the modifier's node group: properties since Blender 5.2, custom ones before."""
    if not hasattr(modifier, "properties"):
        return " ".join(f"{key}={_value_text(blender_object, modifier[key])}" for key in modifier.keys())  # noqa: SIM118
    inputs = modifier.properties.inputs
    names = [field.identifier for field in inputs.bl_rna.properties if field.type == "POINTER"]
    return " ".join(_settings_text(blender_object, getattr(inputs, name)) for name in names if name != "rna_type")


def _settings_text(blender_object: bpy.types.Object, holder: bpy.types.bpy_struct) -> str:
    """All settings of a modifier, a node or an input that do more than show it."""
    fields = (field for field in holder.bl_rna.properties if field.type in FIELD_TYPES)
    names = [field.identifier for field in fields if not _is_display(field.identifier)]
    return " ".join(f"{name}={_value_text(blender_object, getattr(holder, name))}" for name in names)


def _is_display(name: str) -> bool:
    return name in DISPLAY_FIELDS or name.startswith(DISPLAY_PREFIXES)


def _value_text(blender_object: bpy.types.Object, value: Any) -> str:
    """A setting as text; another object as where it stands relative to this one, and what it is like."""
    if isinstance(value, bpy.types.Object):
        relative = blender_object.matrix_world.inverted_safe() @ value.matrix_world
        return repr(np.array(relative).round(5).tolist()) + _content_text(value)
    if isinstance(value, bpy.types.NodeTree):
        return _tree_text(blender_object, value)
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, bpy.types.bpy_struct):
        return type(value).__name__
    if isinstance(value, set):
        return repr(sorted(value))
    # Blender's arrays are sequences that do not print their values.
    return repr(list(value)) if hasattr(value, "__len__") and not isinstance(value, str) else repr(value)


def _content_text(other: bpy.types.Object) -> str:
    if other.type == "MESH" and not other.data.is_editmode:
        return str(_checksum_of_points(other.data.vertices))
    if other.type == "ARMATURE":
        return repr([np.array(bone.matrix).round(5).tolist() for bone in other.pose.bones])
    return ""


def _tree_text(blender_object: bpy.types.Object, tree: bpy.types.NodeTree) -> str:
    nodes = []
    for node in tree.nodes:
        values = [_value_text(blender_object, getattr(socket, "default_value", None)) for socket in node.inputs]
        nodes.append(f"{node.name} {_settings_text(blender_object, node)} {values}")
    links = [
        (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        for link in tree.links
    ]
    return f"{nodes} {links}"
