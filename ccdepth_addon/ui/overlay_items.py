# SPDX-License-Identifier: GPL-3.0-or-later
"""The items of the overlay in a 3D View: visible meshes with values, and instances of such meshes."""

from __future__ import annotations

from collections.abc import Hashable, Iterator
from typing import NamedTuple

import bpy
from mathutils import Matrix

from ..exchange.displayed_mesh import DisplayedMesh, read_displayed_mesh
from ..state import known
from ..state.heat_map import Shown, is_left_out, tolerance_of

# Objects that are drawn as less than their faces have none to draw over.
FACES_DRAWN = {"SOLID", "TEXTURED"}


class Item(NamedTuple):
    """An object or instance to draw.

    key: equal for objects that look the same. owner: the session identifier of the object whose changes change the
    item. scale: of the matrix. tolerance: of the values, as a length in the scene. in_front, is_edited: of the visible
    object.
    """

    key: Hashable
    owner: int
    matrix: Matrix
    scale: float
    tolerance: float
    in_front: bool
    is_edited: bool


def read_item(evaluated: bpy.types.Object, kind: Shown) -> DisplayedMesh | None:
    """The mesh to draw of an item's object; None without values."""
    # This call completes late evaluations, as in Edit Mode and with subdivision on the graphics card.
    mesh = evaluated.to_mesh()
    try:
        in_object_mode = evaluated.mode == "OBJECT"
        chosen = known.is_selection_shown(evaluated.original.data)
        return read_displayed_mesh(mesh, kind.values, with_hidden=in_object_mode, with_chosen=in_object_mode and chosen)
    finally:
        evaluated.to_mesh_clear()


def items(
    depsgraph: bpy.types.Depsgraph, space: bpy.types.SpaceView3D, kind: Shown
) -> Iterator[tuple[bpy.types.Object, Item]]:
    """The items to draw in a 3D View, each with its evaluated object, which is valid only until the next one."""
    for instance in depsgraph.object_instances:
        evaluated = instance.object
        if evaluated.type != "MESH" or not instance.show_self or not _may_have_values(evaluated, kind):
            continue
        original = evaluated.original
        seen = instance.parent.original if instance.is_instance else original
        if seen.visible_in_viewport_get(space) and seen.display_type in FACES_DRAWN:
            is_own = instance.is_instance and original == seen
            key, owner = _key(evaluated, is_own=is_own), (seen if is_own else original).session_uid
            matrix, tolerance = instance.matrix_world.copy(), tolerance_of(original.data, kind)
            is_edited = seen.mode == "EDIT"
            yield evaluated, Item(key, owner, matrix, matrix.median_scale, tolerance, seen.show_in_front, is_edited)


def _may_have_values(evaluated: bpy.types.Object, kind: Shown) -> bool:
    """Whether an object's mesh has values, or has had them before modifiers or while it is edited."""
    name = kind.values.name
    original = evaluated.original.data
    if not isinstance(original, bpy.types.Mesh):
        return name in evaluated.data.attributes
    return not is_left_out(original, kind) and (name in evaluated.data.attributes or name in original.attributes)


def _key(evaluated: bpy.types.Object, *, is_own: bool) -> Hashable:
    """A key, different for objects of different looks. is_own: whether modifiers of the visible object made the object,
    as an instance."""
    original = evaluated.original
    if is_own:
        return original.session_uid, evaluated.data.session_uid, evaluated.data.name
    shares_its_look = not original.modifiers and original.data.shape_keys is None
    return (original.data if shares_its_look else original).session_uid, evaluated.mode == "OBJECT"
