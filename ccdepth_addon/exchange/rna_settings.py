# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of modifiers, nodes and data, by Blender's own lists of properties."""

from __future__ import annotations

from functools import cache
from typing import Any

import bpy

# The state of Blender's interface, and counts of a modifier's last evaluation.
DISPLAY_PREFIXES = ("active_", "open_")
DISPLAY_FIELDS = {
    "active", "face_count", "id_data", "is_active_output", "node_warnings", "panels", "rna_type", "select",
    "show_group_selector", "show_manage_panel", "show_only_control_edges", "ui_type",
}  # fmt: skip

# Properties of every node that do more than display it.
NODE_FIELDS = {"bl_idname", "mute"}

# Blender's own, filled in while it evaluates.
UNREAD_TYPES = {"AnimData", "ParticleSystem", "PointCache"}

FIELD_TYPES = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM", "POINTER", "COLLECTION"}


def _names(base: str) -> frozenset[str]:
    """The properties that all structures of a kind have."""
    return frozenset(getattr(bpy.types, base).bl_rna.properties.keys())


def _fields(kind: type[bpy.types.bpy_struct]) -> tuple[str, ...]:
    unread: frozenset[str] = frozenset()
    if issubclass(kind, bpy.types.Modifier):
        unread = _names("Modifier") - {"type"}
    elif issubclass(kind, bpy.types.Node):
        unread = _names("Node") - NODE_FIELDS
    elif issubclass(kind, bpy.types.ID):
        # Its name stands in the description of its user; how Blender displays it does not matter.
        unread = _names("ID") | {name for name in kind.bl_rna.properties.keys() if name.startswith("show_")}  # noqa: SIM118
    return tuple(
        each.identifier
        for each in kind.bl_rna.properties
        if each.type in FIELD_TYPES
        and each.identifier not in unread
        and each.identifier not in DISPLAY_FIELDS
        and not each.identifier.startswith(DISPLAY_PREFIXES)
        and getattr(each.fixed_type if each.type == "POINTER" else None, "identifier", "") not in UNREAD_TYPES
    )


_kept_fields = cache(_fields)


def settings_of(holder: bpy.types.bpy_struct) -> tuple[str, ...]:
    """The properties of a structure that do more than display it."""
    # Blender makes the types of node groups' inputs anew, under the same names.
    kind: Any = type(holder)
    return _fields(kind) if issubclass(kind, bpy.types.PropertyGroup) else _kept_fields(kind)


def read_setting(holder: bpy.types.bpy_struct, name: str) -> Any:
    """A property; None if Blender cannot read it, as of an object not evaluated yet."""
    try:
        return getattr(holder, name)
    except (AttributeError, RuntimeError, TypeError, ValueError):
        return None
