# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary copies of objects, for Blender to evaluate their modifiers, and the origins of evaluated faces among the
faces of the objects' own meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from typing import TypeVar

import bpy
import numpy as np

from ..core import IndexArray
from .blender_arrays import find_attribute, read_values, write_values
from .changes import paused
from .data_blocks import own_copy, unused_name
from .mesh_arrays import own_mesh
from .modifiers import SIMULATIONS, is_evaluated

Item = TypeVar("Item")

ORIGIN_ATTRIBUTE = "ccdepth_origin"
NO_ORIGIN = -1

# The second number of an origin is the square of the first modulo this prime. Averaged origins of several faces do not
# fit together, and so show that a modifier has merged faces.
ORIGIN_PRIME = 2**31 - 1

# Objects evaluated at once, and vertices of their own meshes: few enough to keep the window responsive.
OBJECTS_AT_ONCE = 128
VERTICES_AT_ONCE = 1 << 18

# The modifiers that remove faces. Other modifiers lose faces by merging them into faces that keep one origin alone.
REMOVING_FACES = {"BOOLEAN", "BUILD", "MASK", "NODES", "WELD"}

# The modifiers that make new faces alone, even where a new face has the origin of an old one.
REPLACING_FACES = {"OCEAN", "REMESH", "SCREW", "SKIN"}


def is_placed(layer: bpy.types.ViewLayer, blender_object: bpy.types.Object) -> bool:
    """Whether Blender computes the object's place in the scene: in a shown collection of the view layer, even behind a
    closed eye.

    Other objects keep an old place, or after loading none, even those that Blender counts as evaluated because a shown
    object refers to them.
    """
    return not blender_object.hide_viewport and _shows_any(layer.layer_collection, {*blender_object.users_collection})


def _shows_any(layer: bpy.types.LayerCollection, collections: set[bpy.types.Collection]) -> bool:
    """Whether one of the collections is shown, there or in a child."""
    if layer.collection.hide_viewport:
        return False
    is_here = layer.collection in collections and not layer.exclude
    return is_here or any(_shows_any(child, collections) for child in layer.children)


def in_batches(objects: Sequence[bpy.types.Object]) -> Iterator[list[bpy.types.Object]]:
    """The objects in groups few and small enough to be evaluated at once."""
    return batches(objects, lambda each: len(each.data.vertices), VERTICES_AT_ONCE)


def batches(items: Iterable[Item], size_of: Callable[[Item], int], most: int) -> Iterator[list[Item]]:
    """Items in groups to be evaluated at once; a group ends with the item that brings its size to the limit."""
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


@dataclass
class _Copy:
    """A copy of an object. faces: the number of faces of the object's own mesh; origins: the attribute with the numbers
    of faces; made: the mesh that the modifiers have made, and the origins of its faces."""

    holder: bpy.types.Object
    faces: int
    origins: str
    made: tuple[bpy.types.Mesh, IndexArray] | None = None

    def origins_on(self, mesh: bpy.types.Mesh) -> IndexArray:
        return _read_origins(mesh, self.origins, self.faces)


class Evaluated:
    """Temporary copies of objects in the scene, with some of their modifiers.

    Copies have the present values of the objects, keyed or not, so they must not be animated again. The scene is
    evaluated once for all copies, as each evaluation takes longer with more objects.
    """

    def __init__(self, context: bpy.types.Context) -> None:
        self._context = context
        self._copies: dict[int, _Copy] = {}
        # Copies of meshes, each made once for all objects that use it, and the names of the origins on them.
        self._meshes: dict[int, tuple[bpy.types.Mesh, str]] = {}
        self._losing: dict[int, str] | None = None

    def add(
        self,
        blender_object: bpy.types.Object,
        modifiers: Sequence[bpy.types.Modifier],
        other: bpy.types.Mesh | None = None,
    ) -> bpy.types.Object:
        """Copy an object, with chosen modifiers, and with origins on its faces, or with another mesh; returns the
        copy."""
        names = {modifier.name for modifier in modifiers}
        mesh, origins = self._mesh(blender_object) if other is None else (other, "")
        is_rigid = blender_object.rigid_body is not None
        copy = bpy.data.objects.new(blender_object.name, mesh) if is_rigid else own_copy(blender_object)
        self._context.scene.collection.objects.link(copy)
        self._copies[blender_object.session_uid] = _Copy(copy, len(mesh.polygons), origins)
        copy.data = mesh
        copy.animation_data_clear()
        # Objects hidden in all viewports are not evaluated.
        copy.hide_viewport = False
        if is_rigid:
            _make_like(blender_object, copy)
        for modifier in [m for m in copy.modifiers if m.name not in names]:
            copy.modifiers.remove(modifier)
        return copy

    def __contains__(self, blender_object: bpy.types.Object) -> bool:
        return blender_object.session_uid in self._copies

    def _mesh(self, blender_object: bpy.types.Object) -> tuple[bpy.types.Mesh, str]:
        """A copy of the object's mesh with origins, and their name."""
        uid = blender_object.data.session_uid
        if uid not in self._meshes:
            with own_mesh(blender_object) as own:
                mesh = own_copy(own)
            self._meshes[uid] = mesh, ""
            self._meshes[uid] = mesh, _write_origins(blender_object, mesh)
        return self._meshes[uid]

    def made(self, blender_object: bpy.types.Object) -> tuple[bpy.types.Mesh, IndexArray]:
        """The mesh made by the modifiers, which lasts as long as the copies, and the origins of its faces among the
        faces of the object's own mesh.

        Unlike Blender's own evaluated meshes, this mesh includes the last levels, which the graphics card makes in the
        viewport.
        """
        copy = self._copies[blender_object.session_uid]
        if copy.made is None:
            # All at once: each new mesh would have the scene evaluated again for the next.
            depsgraph = self._context.evaluated_depsgraph_get()
            for each in self._copies.values():
                mesh = bpy.data.meshes.new_from_object(
                    each.holder.evaluated_get(depsgraph), preserve_all_data_layers=True, depsgraph=depsgraph
                )
                each.made = mesh, each.origins_on(mesh)
        assert copy.made is not None
        return copy.made

    def without_origins(self, blender_object: bpy.types.Object) -> bpy.types.Mesh:
        """The mesh with the user's attributes alone."""
        mesh, _ = self.made(blender_object)
        origins = mesh.attributes.get(self._copies[blender_object.session_uid].origins)
        if origins is not None:
            mesh.attributes.remove(origins)
        return mesh

    def loss_of_faces(self, blender_object: bpy.types.Object, base_faces: IndexArray) -> str | None:
        """The modifier that merges or replaces faces, by name, with its way to do so; None without one. base_faces: the
        origins of the made mesh's faces."""
        if len(present_faces(base_faces)) == self._copies[blender_object.session_uid].faces:
            return None
        if self._losing is None:
            self._losing = self._find_losing()
        return self._losing.get(blender_object.session_uid)

    def _find_losing(self) -> dict[int, str]:
        """The first modifier of each copy that loses faces, and its way to do so, found by showing one more modifier of
        all copies at a time."""
        stacks = {uid: list(copy.holder.modifiers) for uid, copy in self._copies.items()}
        for modifier in [modifier for stack in stacks.values() for modifier in stack]:
            modifier.show_viewport = False
        present = {uid: copy.faces for uid, copy in self._copies.items()}
        losing: dict[int, str] = {}
        for place in range(max(map(len, stacks.values()))):
            shown = {uid: stack[place] for uid, stack in stacks.items() if place < len(stack)}
            for modifier in shown.values():
                modifier.show_viewport = True
            for uid, modifier in shown.items():
                copy = self._copies[uid]
                shape = copy.holder.evaluated_get(self._context.evaluated_depsgraph_get()).data
                before, present[uid] = present[uid], len(present_faces(copy.origins_on(shape)))
                if present[uid] < before and (present[uid] == 0 or modifier.type not in REMOVING_FACES):
                    is_replaced = present[uid] == 0 or modifier.type in REPLACING_FACES
                    way = "replaces all" if is_replaced else "merges"
                    losing.setdefault(uid, f"“{modifier.name}” {way} faces")
        return losing

    def remove(self) -> None:
        copies = self._copies.values()
        for copy in copies:
            self._context.scene.collection.objects.unlink(copy.holder)
        if self._context.scene.rigidbody_world is not None:
            # The removal of an object that is still evaluated ends the caches of rigid bodies.
            self._context.view_layer.update()
        made = [copy.made[0] for copy in copies if copy.made is not None]
        bpy.data.batch_remove([*(copy.holder for copy in copies), *(mesh for mesh, _ in self._meshes.values()), *made])


@contextmanager
def evaluated(
    context: bpy.types.Context, wanted: Mapping[bpy.types.Object, Sequence[bpy.types.Modifier]]
) -> Iterator[Evaluated]:
    """Copies of the objects that Blender must evaluate, each with its given modifiers."""
    # Simulations will be refused, and must not begin to run.
    copied = {
        each: modifiers
        for each, modifiers in wanted.items()
        if is_evaluated(each, modifiers) and not any(modifier.type in SIMULATIONS for modifier in modifiers)
    }
    copies = Evaluated(context)
    with paused(context) if copied else nullcontext():
        try:
            for each, modifiers in copied.items():
                copies.add(each, modifiers)
            yield copies
        finally:
            copies.remove()


@contextmanager
def with_other_meshes(
    context: bpy.types.Context, wanted: Mapping[bpy.types.Object, tuple[bpy.types.Mesh, Sequence[bpy.types.Modifier]]]
) -> Iterator[list[bpy.types.Object]]:
    """Temporary copies of objects in the scene, each with a mesh in place of its own, and with its given modifiers."""
    copies = Evaluated(context)
    with paused(context):
        try:
            yield [copies.add(each, modifiers, mesh) for each, (mesh, modifiers) in wanted.items()]
        finally:
            copies.remove()


def _make_like(rigid_body: bpy.types.Object, added: bpy.types.Object) -> None:
    """Give a new object the place, materials and modifiers of a rigid body. A copy would be a rigid body as well, and
    its coming and going would end the simulation's cache, and move everything simulated."""
    added.matrix_world = rigid_body.matrix_world
    added.show_only_shape_key = rigid_body.show_only_shape_key
    added.active_shape_key_index = rigid_body.active_shape_key_index
    for slot, own in zip(added.material_slots, rigid_body.material_slots, strict=True):
        slot.link, slot.material = own.link, own.material
    with bpy.context.temp_override(
        active_object=rigid_body, object=rigid_body, edit_object=None, selected_editable_objects=[added]
    ):
        bpy.ops.object.make_links_data(type="MODIFIERS")


def _write_origins(holder: bpy.types.Object, mesh: bpy.types.Mesh) -> str:
    """Write the number of each face of a mesh to a new attribute; returns its unique name."""
    name = unused_name(ORIGIN_ATTRIBUTE, {*holder.vertex_groups.keys(), *mesh.attributes.keys()})
    origins = np.arange(1, len(mesh.polygons) + 1)
    pairs = np.stack([origins, origins * origins % ORIGIN_PRIME], axis=1).astype(np.int32)
    write_values(mesh.attributes.new(name, "INT32_2D", "FACE").data, "value", pairs)
    return name


def _read_origins(mesh: bpy.types.Mesh, name: str, base_face_count: int) -> IndexArray:
    """(F,) intp: the origin of each face of an evaluated mesh, or NO_ORIGIN."""
    attribute = find_attribute(mesh, name, "INT32_2D", "FACE")
    if attribute is None:
        return np.full(len(mesh.polygons), NO_ORIGIN, dtype=np.intp)
    pairs = read_values(attribute.data, "value", np.int32, 2).astype(np.intp)
    origins = pairs[:, 0]
    known = (origins >= 1) & (origins <= base_face_count) & (origins * origins % ORIGIN_PRIME == pairs[:, 1])
    return np.where(known, origins - 1, NO_ORIGIN)


def present_faces(base_faces: IndexArray) -> IndexArray:
    """The faces of an object's own mesh, each once, among the origins (F,) of evaluated faces."""
    is_present = np.zeros(int(base_faces.max(initial=NO_ORIGIN)) + 1, dtype=bool)
    is_present[base_faces[base_faces != NO_ORIGIN]] = True
    return np.flatnonzero(is_present)
