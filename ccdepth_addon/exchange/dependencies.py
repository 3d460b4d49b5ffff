# SPDX-License-Identifier: GPL-3.0-or-later
"""The dependencies of depths beside the mesh: the object's scale, its shape keys, and the settings of its modifiers. Of
other data, the changes that Blender tells of during a session are counted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any
from zlib import crc32

import bpy
import numpy as np

from ..core import FloatArray
from .blender_arrays import read_values
from .changes import known_changes
from .control_mesh import gram_matrix
from .mesh_arrays import CREASE_DOMAINS, attributes_checksum, own_checksum
from .modifiers import (
    OF_OBJECT,
    SIMULATIONS,
    counted_modifiers,
    shown_vertices,
    simplified_levels,
    surface_rule,
)
from .tolerance_factors import factors_text

# No settings of modifiers are nested deeper.
DEEPEST = 5

# The state of Blender's interface, and what Blender fills in while it evaluates.
UNREAD_PREFIXES = ("active_", "open_", "show_")
UNREAD = {"active", "face_count", "id_data", "node_warnings", "panels", "rna_type", "select", "ui_type"}
UNREAD_TYPES = {"AnimData", "ParticleSystem", "PointCache"}

# Modifiers with a part that settings do not tell: nodes, sculpted levels, bound meshes, radii, files, and frames.
HIDDEN_STATE = {
    "ARMATURE", "BUILD", "CORRECTIVE_SMOOTH", "DYNAMIC_PAINT", "LAPLACIANDEFORM", "MESH_CACHE", "MESH_DEFORM",
    "MESH_SEQUENCE_CACHE", "MULTIRES", "NODES", "PARTICLE_INSTANCE", "SKIN", "SURFACE_DEFORM", "WAVE",
}  # fmt: skip


@dataclass(frozen=True)
class ObjectState:
    """An object's scale, as AᵀA (6,), and a checksum of everything else that shapes its surface. frame: the frame of
    reading; None for the present scene.

    Of an object that depends on other data the checksum is followed by the session, the changes so far, the frame,
    and whether frames matter; ``compared`` says what follows from two checksums.
    """

    scale: FloatArray
    checksum: str
    frame: int | None = None


def object_state(
    blender_object: bpy.types.Object, *, use_modifiers: bool, with_vertices: bool = False, varied: Any = None
) -> ObjectState:
    """The present state of an object. with_vertices: whether the vertices of the object's own Subdivision Surface
    modifier matter; varied: the settings by which the tolerance varies, if that matters."""
    world = np.array(blender_object.matrix_world, dtype=np.float64)[:3, :3]
    counted = counted_modifiers(blender_object, use_modifiers=use_modifiers)
    rule = surface_rule(blender_object)
    texts = [repr(rule)]
    if rule.use_creases:
        texts += _crease_groups(blender_object)
    if with_vertices:
        texts.append(shown_vertices(blender_object, OF_OBJECT))
    if varied is not None and varied.tolerance_by != "NONE":
        texts.append(factors_text(blender_object, varied))
    return ObjectState(gram_matrix(world)[np.triu_indices(3)], _checksum(blender_object, counted, texts))


def shown_checksum(blender_object: bpy.types.Object, shown: Iterable[bpy.types.Modifier]) -> str:
    """A checksum of these modifiers, and of shape keys."""
    return _checksum(blender_object, list(shown), _crease_groups(blender_object))


def compared(one: str, other: str) -> bool | None:
    """Whether two checksums of an object are of one state; None if that is not known, as one is of another session."""
    (first, *others), (second, *rest) = one.split(":"), other.split(":")
    if first != second or len(others) != len(rest):
        return False
    if not others:
        return True
    if others[0] != rest[0]:
        return None
    is_animated = "animated" in (others[3], rest[3])
    return others[1] == rest[1] and (others[2] == rest[2] or not is_animated)


def _checksum(holder: bpy.types.Object, modifiers: Sequence[bpy.types.Modifier], texts: Sequence[str]) -> str:
    described = [*texts, *_shape_keys(holder), *map(_modifier, modifiers)]
    others = any(map(_depends_on_more, modifiers))
    if others:
        described.append(str(own_checksum(holder, attributes_checksum)))
    checksum = f"{crc32(chr(10).join(described).encode(errors='backslashreplace')):08x}"
    if not others:
        return checksum
    return f"{checksum}:{known_changes(holder)}"


def _shape_keys(holder: bpy.types.Object) -> Iterator[str]:
    keys = getattr(holder.data, "shape_keys", None)
    if keys is None:
        return
    blocks = [
        (
            key.value,
            key.mute,
            key.vertex_group,
            key.relative_key.name,
            key.name,
            crc32(read_values(key.data, "co", np.float32, 3).data),
        )
        for key in keys.key_blocks
    ]
    shown = holder.active_shape_key_index if holder.show_only_shape_key else None
    yield repr((shown, keys.use_relative, keys.use_relative or keys.eval_time, blocks))


def _crease_groups(holder: bpy.types.Object) -> list[str]:
    """The vertex groups that the Subdivision Surface modifier takes for creases, mostly none."""
    return [f"group {name}" for name in CREASE_DOMAINS if name in holder.vertex_groups]


def _depends_on_more(modifier: bpy.types.Modifier) -> bool:
    """Whether a modifier depends on other data, or on weights and attributes of the mesh."""
    if modifier.type in HIDDEN_STATE or modifier.type == "EDGE_SPLIT" or getattr(modifier, "vertex_group", ""):
        return True
    return any(isinstance(_read(modifier, name), bpy.types.ID) for name in _names_of(modifier))


def _modifier(modifier: bpy.types.Modifier) -> str:
    if modifier.type in SIMULATIONS:
        # Simulations are refused, and their settings hold whole grids of their state.
        return str(modifier.type)
    text = _settings(modifier)
    if modifier.type == "NODES" and not hasattr(modifier, "properties"):
        # Since Blender 5.2 the inputs are ordinary properties; before, custom properties.
        text += " ".join(f"{key}={_value(modifier[key])}" for key in modifier.keys())  # noqa: SIM118
    limits = simplified_levels(bpy.context.scene) if modifier.type == "SUBSURF" else None
    return f"{text} simplified to {limits[0]}" if limits is not None and limits[0] < modifier.levels else text


def _names_of(holder: bpy.types.bpy_struct) -> tuple[str, ...]:
    """The properties of a modifier, an input or a curve that do more than display it."""
    kind: Any = type(holder)
    # Blender makes the types of node groups' inputs anew, under the same names.
    return _names(kind) if isinstance(holder, bpy.types.PropertyGroup) else _kept_names(kind)


def _names(kind: type[bpy.types.bpy_struct]) -> tuple[str, ...]:
    shared = {*bpy.types.Modifier.bl_rna.properties.keys()} if issubclass(kind, bpy.types.Modifier) else set()
    return tuple(
        each.identifier
        for each in kind.bl_rna.properties
        if each.identifier not in UNREAD | (shared - {"type"})
        and not each.identifier.startswith(UNREAD_PREFIXES)
        and getattr(each.fixed_type if each.type == "POINTER" else None, "identifier", "") not in UNREAD_TYPES
    )


_kept_names = cache(_names)


def _read(holder: bpy.types.bpy_struct, name: str) -> Any:
    """A property; None if Blender cannot read it, as of an object not evaluated yet."""
    try:
        return getattr(holder, name)
    except (AttributeError, RuntimeError, TypeError, ValueError):
        return None


def _settings(holder: bpy.types.bpy_struct, depth: int = 0) -> str:
    """The settings of a modifier, an input or a curve, as text."""
    return " ".join(f"{name}={_value(_read(holder, name), depth)}" for name in _names_of(holder))


def _value(value: Any, depth: int = 0) -> str:
    """A setting as text; other data by their names."""
    if isinstance(value, bpy.types.ID):
        return str(value.name_full)
    if isinstance(value, bpy.types.bpy_struct):
        return f"({_settings(value, depth + 1)})" if depth < DEEPEST else type(value).__name__
    if isinstance(value, bpy.types.bpy_prop_collection):
        return f"[{', '.join(_value(item, depth) for item in value)}]"
    if isinstance(value, set):
        return repr(sorted(value))
    if hasattr(value, "to_dict"):
        return repr(value.to_dict())
    # Blender's arrays are sequences that do not print their values.
    return repr(list(value)) if hasattr(value, "__len__") and not isinstance(value, str) else repr(value)
