# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary copies of objects, by which Blender evaluates their modifiers, and the faces of the objects' own meshes
that evaluated faces come from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TypeVar

import bpy
import numpy as np

from ..core import IndexArray
from .blender_arrays import read_values, write_values
from .data_blocks import own_copy, unused_name
from .mesh_arrays import own_mesh
from .modifiers import SIMULATIONS, is_evaluated

Item = TypeVar("Item")

ORIGIN_ATTRIBUTE = "ccdepth_origin"
NO_ORIGIN = -1

# The second number of an origin is the square of the first modulo this prime. Averaged origins of several faces do not
# fit together, which shows that a modifier has merged these faces.
ORIGIN_PRIME = 2**31 - 1

# Objects evaluated at once, and vertices of their own meshes: few enough to keep the window responsive.
OBJECTS_AT_ONCE = 128
VERTICES_AT_ONCE = 1 << 18

# These remove faces. Faces that other modifiers lose are merged into faces that keep one origin alone.
REMOVING_FACES = {"BOOLEAN", "BUILD", "MASK", "NODES", "WELD"}


def in_batches(objects: Sequence[bpy.types.Object]) -> Iterator[list[bpy.types.Object]]:
    """The objects in groups that are few and small enough to be evaluated at once."""
    return batches(objects, lambda each: len(each.data.vertices), VERTICES_AT_ONCE)


def batches(items: Iterable[Item], size_of: Callable[[Item], int], most: int) -> Iterator[list[Item]]:
    """Items in groups of as many as are evaluated at once; a group ends with the item that makes its size the most."""
    batch: list[Item] = []
    size = 0
    for item in items:
        batch.append(item)
        size += size_of(item)
        if len(batch) == OBJECTS_AT_ONCE or size >= most:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


class FrozenCopies:
    """Temporary copies of objects in the scene, with some of their modifiers.

    Their values are those the objects have now, keyed or not, so they must not be animated again. The scene is
    evaluated once for all of them: each time takes as long as there are objects.
    """

    def __init__(self, context: bpy.types.Context) -> None:
        self._context = context
        self._copies: dict[int, bpy.types.Object] = {}
        self._face_counts: dict[int, int] = {}
        self._own_copies: dict[int, bpy.types.Mesh] = {}
        # The attribute with the origins, by copied meshes and by objects.
        self._origins: dict[int, str] = {}
        self._names: dict[int, str] = {}
        self._made: dict[int, bpy.types.Mesh] = {}
        self._losing: dict[int, bpy.types.Modifier | None] | None = None

    def add(self, blender_object: bpy.types.Object, modifiers: Sequence[bpy.types.Modifier]) -> None:
        """Copy an object, with these of its modifiers, and with origins on its faces."""
        uid = blender_object.session_uid
        mesh = self._own_copy(blender_object)
        names = {modifier.name for modifier in modifiers}
        copy = self._copies[uid] = own_copy(blender_object)
        self._face_counts[uid] = len(mesh.polygons)
        copy.data = mesh
        copy.animation_data_clear()
        # What is hidden in all viewports is not evaluated.
        copy.hide_viewport = False
        for modifier in [m for m in copy.modifiers if m.name not in names]:
            copy.modifiers.remove(modifier)
        self._context.scene.collection.objects.link(copy)
        if mesh.session_uid not in self._origins:
            self._origins[mesh.session_uid] = _write_origins(copy, mesh)
        self._names[uid] = self._origins[mesh.session_uid]

    def _own_copy(self, blender_object: bpy.types.Object) -> bpy.types.Mesh:
        """A copy of the object's mesh, made once for all objects that use it."""
        key = blender_object.data.session_uid
        if key not in self._own_copies:
            with own_mesh(blender_object) as own:
                mesh = self._own_copies[key] = own_copy(own)
            if mesh.shape_keys is not None:
                mesh.shape_keys.animation_data_clear()
        return self._own_copies[key]

    def made(self, blender_object: bpy.types.Object) -> tuple[bpy.types.Mesh, IndexArray]:
        """What the modifiers have made, as a mesh that lasts as long as the copies do, and the face of the object's own
        mesh that each face comes from.

        Unlike what Blender evaluates for itself, it has the last levels that the graphics card makes in the viewport.
        """
        if not self._made:
            # All at once: each new mesh would have the scene evaluated again for the next.
            depsgraph = self._context.evaluated_depsgraph_get()
            for uid, copy in self._copies.items():
                self._made[uid] = bpy.data.meshes.new_from_object(
                    copy.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
                )
        uid = blender_object.session_uid
        return self._made[uid], self._read_origins(uid, self._made[uid])

    def without_origins(self, blender_object: bpy.types.Object) -> bpy.types.Mesh:
        """The same mesh, with the user's attributes alone."""
        mesh, _ = self.made(blender_object)
        origins = mesh.attributes.get(self._names[blender_object.session_uid])
        if origins is not None:
            mesh.attributes.remove(origins)
        return mesh

    def _read_origins(self, uid: int, mesh: bpy.types.Mesh) -> IndexArray:
        return _read_origins(mesh, self._names[uid], self._face_counts[uid])

    def face_count(self, blender_object: bpy.types.Object) -> int:
        """Of the object's own mesh."""
        return self._face_counts[blender_object.session_uid]

    def losing_modifier(self, blender_object: bpy.types.Object) -> str | None:
        """The modifier that merges faces of the object, if there is one."""
        if self._losing is None:
            self._losing = self._find_losing()
        modifier = self._losing.get(blender_object.session_uid)
        return None if modifier is None else modifier.name

    def _find_losing(self) -> dict[int, bpy.types.Modifier | None]:
        """Show one more modifier of all copies at a time."""
        stacks = {uid: list(copy.modifiers) for uid, copy in self._copies.items()}
        for modifier in [modifier for stack in stacks.values() for modifier in stack]:
            modifier.show_viewport = False
        present = dict(self._face_counts)
        losing: dict[int, bpy.types.Modifier | None] = {}
        for place in range(max(map(len, stacks.values()))):
            shown = {uid: stack[place] for uid, stack in stacks.items() if place < len(stack)}
            for modifier in shown.values():
                modifier.show_viewport = True
            for uid, modifier in shown.items():
                origins = self._read_origins(uid, self._evaluated(self._copies[uid]))
                before, present[uid] = present[uid], len(present_faces(origins))
                if present[uid] < before and (present[uid] == 0 or modifier.type not in REMOVING_FACES):
                    losing.setdefault(uid, modifier)
        return losing

    def _evaluated(self, copy: bpy.types.Object) -> bpy.types.Mesh:
        return copy.evaluated_get(self._context.evaluated_depsgraph_get()).data

    def remove(self) -> None:
        bpy.data.batch_remove([*self._copies.values(), *self._own_copies.values(), *self._made.values()])


@contextmanager
def frozen_copies(
    context: bpy.types.Context, wanted: Mapping[bpy.types.Object, Sequence[bpy.types.Modifier]]
) -> Iterator[FrozenCopies]:
    """Copies of those of the objects that Blender must evaluate, each with the modifiers given."""
    copies = FrozenCopies(context)
    try:
        for blender_object, modifiers in wanted.items():
            # Simulations will be refused, and must not begin to run.
            if is_evaluated(blender_object, modifiers) and not any(each.type in SIMULATIONS for each in modifiers):
                copies.add(blender_object, modifiers)
        yield copies
    finally:
        copies.remove()


def _write_origins(holder: bpy.types.Object, mesh: bpy.types.Mesh) -> str:
    """Write its number on every face of a mesh, and return the name it has there, which nothing else has."""
    name = unused_name(ORIGIN_ATTRIBUTE, {*holder.vertex_groups.keys(), *mesh.attributes.keys()})
    origins = np.arange(1, len(mesh.polygons) + 1)
    pairs = np.stack([origins, origins * origins % ORIGIN_PRIME], axis=1).astype(np.int32)
    write_values(mesh.attributes.new(name, "INT32_2D", "FACE").data, "value", pairs)
    return name


def _read_origins(mesh: bpy.types.Mesh, name: str, base_face_count: int) -> IndexArray:
    """(F,) intp: the face each face of an evaluated mesh comes from, or NO_ORIGIN."""
    attribute = mesh.attributes.get(name)
    if attribute is None or (attribute.data_type, attribute.domain) != ("INT32_2D", "FACE"):
        return np.full(len(mesh.polygons), NO_ORIGIN, dtype=np.intp)
    pairs = read_values(attribute.data, "value", np.int32, 2).astype(np.intp)
    origins = pairs[:, 0]
    known = (origins >= 1) & (origins <= base_face_count) & (origins * origins % ORIGIN_PRIME == pairs[:, 1])
    return np.where(known, origins - 1, NO_ORIGIN)


def present_faces(base_faces: IndexArray) -> IndexArray:
    """The faces of an object's own mesh, each once, that faces (F,) of the evaluated one come from."""
    is_present = np.zeros(int(base_faces.max(initial=NO_ORIGIN)) + 1, dtype=bool)
    is_present[base_faces[base_faces != NO_ORIGIN]] = True
    return np.flatnonzero(is_present)
