# SPDX-License-Identifier: GPL-3.0-or-later
"""The reasons why operators refuse objects."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import TypeVar

import bpy

from ..exchange.data_blocks import Identity, objects_with
from ..exchange.face_values import conflict
from ..exchange.mesh_arrays import mesh_face_count
from ..tasks.surfaces import ComputeError

Holder = TypeVar("Holder", bpy.types.Object, bpy.types.Mesh)

CHANGED = "The objects were changed in the meantime: nothing was written"

LINKED = "the object is linked from another file; make it local first"


def still_there(holders: Collection[Identity], face_count: int | None = None) -> list[bpy.types.Object]:
    """The unchanged objects. Raises ComputeError if one is gone, or has another mesh, or another number of faces."""
    there = []
    for holder, each in zip(holders, objects_with(holder.uid for holder in holders), strict=True):
        if (
            each is None
            or each.type != "MESH"
            or each.data.session_uid != holder.mesh_uid
            or face_count not in (None, mesh_face_count(each.data))
        ):
            raise ComputeError(CHANGED)
        there.append(each)
    return there


def refuse_what_cannot_be_written(objects: list[bpy.types.Object]) -> None:
    """Raise ComputeError naming every hidden object, and every object with a mesh that cannot hold values."""
    refuse(objects, lambda obj: hidden_fault(obj) or mesh_fault(obj.data) or name_fault(obj))


def refuse(holders: Iterable[Holder], fault_of: Callable[[Holder], str | None]) -> None:
    """Raise ComputeError naming every object or mesh with a fault."""
    faults = [f"{holder.name}: {fault}" for holder in holders if (fault := fault_of(holder))]
    if faults:
        raise ComputeError("\n".join(faults))


def hidden_fault(blender_object: bpy.types.Object) -> str | None:
    return None if blender_object.visible_get() else "the object is hidden; show it first"


def mesh_fault(mesh: bpy.types.Mesh) -> str | None:
    """The reason why the mesh cannot be written to, or None."""
    if not mesh.is_editable:
        return "the mesh is linked from another file and cannot be written to; make it local first"
    if mesh.override_library is not None:
        return "the mesh is a library override, on which Blender keeps no attributes; make it local first"
    return None


def name_fault(blender_object: bpy.types.Object) -> str | None:
    """The report about an attribute or a vertex group with a name that our values need."""
    name = conflict(blender_object)
    if name is not None:
        return f"the mesh has an attribute or a vertex group of its own called “{name}”; rename it first"
    return None
