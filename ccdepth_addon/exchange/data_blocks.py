# SPDX-License-Identifier: GPL-3.0-or-later
"""Writable copies of data-blocks, and changes of data-blocks that only operators make."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from itertools import count
from typing import Any, NamedTuple, TypeVar

import bmesh
import bpy

Data = TypeVar("Data", bpy.types.Mesh, bpy.types.Object)


class Identity(NamedTuple):
    """An object and its mesh by their session identifiers, without references to Blender's data; and its name, for
    people: a linked object may have the same."""

    uid: int
    mesh_uid: int
    name: str

    @classmethod
    def of(cls, blender_object: bpy.types.Object) -> Identity:
        return cls(blender_object.session_uid, blender_object.data.session_uid, blender_object.name)


def objects_with(uids: Iterable[int]) -> list[bpy.types.Object | None]:
    """The objects with these session identifiers, in their order, and None for removed ones."""
    by_uid = {each.session_uid: each for each in bpy.data.objects}
    return [by_uid.get(uid) for uid in uids]


def unused_name(prefix: str, taken: Container[str]) -> str:
    """A name for something temporary: the prefix and a number, different from the names taken."""
    return next(name for number in count() if (name := f"{prefix}_{number}") not in taken)


def meshes_with(uids: Iterable[int]) -> list[bpy.types.Mesh]:
    """The remaining meshes with these session identifiers, in their order."""
    by_uid = {mesh.session_uid: mesh for mesh in bpy.data.meshes}
    return [by_uid[uid] for uid in uids if uid in by_uid]


@contextmanager
def held(mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    """A temporary object with the mesh, outside all scenes: only objects know the names of vertex groups."""
    holder = bpy.data.objects.new(mesh.name, mesh)
    try:
        yield holder
    finally:
        bpy.data.objects.remove(holder)


@contextmanager
def removed_on_failure(made: list[int]) -> Iterator[list[int]]:
    """Remove new meshes if this context fails, unless objects use them. made: their session identifiers, of which more
    may come."""
    try:
        yield made
    except BaseException:
        bpy.data.batch_remove([mesh for mesh in meshes_with(made) if not mesh.users])
        raise


def is_writable(mesh: bpy.types.Mesh) -> bool:
    """Whether a mesh keeps written values: it is neither linked nor a library override."""
    return mesh.is_editable and mesh.override_library is None


def own_copy(data: Data) -> Data:
    """A local copy, which is no library override."""
    copy = data.copy()
    return copy if copy.override_library is None else copy.make_local(clear_liboverride=True)


@contextmanager
def as_bmesh(mesh: bpy.types.Mesh, target: bpy.types.Mesh | None = None) -> Iterator[Any]:
    """The mesh as a BMesh, which is written back at the end of this context, or to another mesh."""
    edited = bmesh.new()
    try:
        edited.from_mesh(mesh)
        yield edited
        edited.to_mesh(target or mesh)
    finally:
        edited.free()


def remove_shape_keys(holder: bpy.types.Object) -> None:
    """Remove the shape keys from the object's mesh, and their data-block from the file.

    Before Blender 5.2 the keys of a copied mesh have a user too many and would stay without a mesh. A file with such
    keys cannot be saved again.
    """
    keys = holder.data.shape_keys
    if keys is None:
        return
    uid = keys.session_uid
    holder.shape_key_clear()
    bpy.data.batch_remove([left for left in bpy.data.shape_keys if left.session_uid == uid])


def convert_attribute(holder: bpy.types.Object, name: str, **settings: Any) -> None:
    """Convert an attribute of the mesh of ``holder``, which belongs to no scene, as Convert Attribute does.

    settings: of that operator. Calling an operator evaluates the scene before and after, in a time that grows with the
    number of its objects; so the operator gets an empty scene.
    """
    attributes = holder.data.attributes
    attributes.active = attributes[name]
    scene = bpy.data.scenes.new(name)
    try:
        # Another object that is being edited must not stand in the way.
        with bpy.context.temp_override(
            scene=scene, view_layer=scene.view_layers[0], object=holder, active_object=holder, edit_object=None
        ):
            bpy.ops.geometry.attribute_convert(**settings)
    finally:
        bpy.data.scenes.remove(scene)
