# SPDX-License-Identifier: GPL-3.0-or-later
"""The chosen objects of a file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy

from ..exchange.blender_calls import CommandError, scripts_allowed
from ..exchange.data_blocks import is_writable, own_copy
from .report import name_of

# Objects of these types show no surface of their own.
NO_SURFACE = {"ARMATURE", "CAMERA", "EMPTY", "LATTICE", "LIGHT", "LIGHT_PROBE", "SPEAKER"}


def chosen_objects(
    source: Path | None, names: Sequence[str] | None = None, collection: str | None = None
) -> tuple[list[bpy.types.Object], tuple[str, ...]]:
    """The visible mesh objects of the open file, and the names of others that are left out; with given names or a
    collection, only these objects. Meshes without faces are left out beside others, unless they are named. Linked
    objects and overrides are hidden, and copies take their places. Raises CommandError without any objects, for a
    missing name, and for an object linked from a missing file."""
    file, place, there = name_of(source), "it", set(bpy.data.objects)
    whole = bpy.context.scene.collection
    if collection is not None:
        # Blender itself looks for no name that is not UTF-8.
        named = [each for each in bpy.data.collections if each.name == collection]
        if not named:
            raise CommandError(f"{file}: there is no collection “{collection}” in it")
        whole = named[0]
        place, there = f"its collection “{collection}”", set(whole.all_objects)
    found = [obj for obj in bpy.context.view_layer.objects if obj in there and (names is None or obj.name in names)]
    shown = [obj for obj in found if obj.visible_get()]
    parts = set() if names else {whole, *whole.children_recursive}
    collections = [each for each in _shown_collections(bpy.context.view_layer.layer_collection) if each in parts]
    _refuse_missing(file, [*collections, *shown, *(obj.data for obj in shown if obj.data is not None)])
    visible = [obj for obj in shown if obj.type == "MESH"]
    if names is None:
        visible = [obj for obj in visible if not _is_without_faces(obj)] or visible
    found_names = {obj.name for obj in visible}
    unknown = next((name for name in names or () if name not in found_names), None)
    if unknown is not None:
        raise CommandError(f"{file}: there is no mesh object “{unknown}” in {place} that is not hidden")
    if not visible:
        which = " that is not hidden" if any(obj.type == "MESH" for obj in there) else ""
        raise CommandError(f"{file}: there is no mesh object in {place}{which}")
    others = set(found) - set(visible)
    left_out = [obj.name for obj in found if obj in others and _has_surface(obj)]
    left_out += [obj.name for obj in _excluded_meshes() if obj in there and names is None]
    meshes: dict[bpy.types.Mesh, bpy.types.Mesh] = {}
    return [_own(each, meshes) for each in visible], tuple(left_out)


def _has_surface(blender_object: bpy.types.Object) -> bool:
    """Whether an object is a mesh, even a hidden one, or shows a surface of its own or of a collection."""
    if blender_object.instance_type == "COLLECTION" and blender_object.instance_collection is not None:
        return True
    is_shown = blender_object.type not in NO_SURFACE and blender_object.visible_get()
    return blender_object.type == "MESH" or is_shown


def _is_without_faces(blender_object: bpy.types.Object) -> bool:
    """Whether the mesh object has no faces, and no modifiers that make any."""
    return not blender_object.data.polygons and not blender_object.modifiers


def _excluded_meshes() -> list[bpy.types.Object]:
    """The mesh objects of the scene in collections that the view layer excludes, and in no other."""
    shown = set(bpy.context.view_layer.objects)
    return [obj for obj in bpy.context.scene.collection.all_objects if obj.type == "MESH" and obj not in shown]


def _own(blender_object: bpy.types.Object, meshes: dict[bpy.types.Mesh, bpy.types.Mesh]) -> bpy.types.Object:
    """The object, or a copy of an object for which Blender keeps no written data. meshes: copies of such meshes so
    far."""
    own, mesh = blender_object, blender_object.data
    if not own.is_editable or own.override_library is not None:
        own, name = own_copy(blender_object), blender_object.name
        if blender_object.is_editable:
            blender_object.name = f"Original {name}"
        own.name = name
        bpy.context.scene.collection.objects.link(own)
        blender_object.hide_set(True)
    if not is_writable(mesh):
        if mesh not in meshes:
            meshes[mesh] = own_copy(mesh)
        own.data = meshes[mesh]
    return own


def _shown_collections(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    """The collections of a view layer that are not excluded from it."""
    for child in layer.children:
        if not child.exclude:
            yield child.collection
            yield from _shown_collections(child)


def _refuse_missing(file: str, used: Sequence[bpy.types.ID]) -> None:
    """Raise CommandError if a data-block is missing from the file that it is linked from. Blender puts an empty one in
    its place, for which everything would be true."""
    lost = next((each for each in used if each.is_missing), None)
    if lost is not None:
        library = bpy.path.abspath(lost.library.filepath)
        raise CommandError(f"{file}: “{lost.name}” is missing: it is linked from {library}")


# The kinds of data that do not shape an object.
NO_SHAPE = (bpy.types.Material, bpy.types.Scene, bpy.types.World)

# The kinds of data that are read from files of their own.
READ = (bpy.types.CacheFile, bpy.types.Image, bpy.types.VectorFont, bpy.types.Volume)


def missing_inputs(objects: Sequence[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """The objects that depend on something missing, and one such cause each.

    An object depends on all used data: its mesh and shape keys, its parent, the data named by its modifiers,
    constraints and drivers, and the data used by these.
    """
    bpy.context.view_layer.update()
    users = bpy.data.user_map()
    causes = {each: cause for each in users if not isinstance(each, NO_SHAPE) and (cause := _missing_for(each))}
    waiting = list(causes)
    while waiting:
        used = waiting.pop()
        for user in users.get(used, ()):
            if user not in causes and _is_shaped_by(user, used):
                causes[user] = causes[used]
                waiting.append(user)
    return {each: causes[each] for each in objects if each in causes}


def _is_shaped_by(user: bpy.types.ID, used: bpy.types.ID) -> bool:
    # Empties show images for reference alone.
    is_reference = isinstance(used, bpy.types.Image) and getattr(user, "type", "") == "EMPTY"
    return not (is_reference or isinstance(user, NO_SHAPE))


def _missing_for(block: bpy.types.ID) -> str | None:
    """The cause why a data-block itself is not what it should be, or None."""
    if block.is_missing and block.library is not None:
        return f"“{block.name}”, which is missing: it is linked from {bpy.path.abspath(block.library.filepath)}"
    path = _missing_file(block)
    return f"the file {path}, which is missing" if path else _failed_driver(block)


def _missing_file(block: bpy.types.ID) -> str | None:
    """The missing file among the files that the data-block is read from, or None."""
    paths: list[str] = []
    if isinstance(block, bpy.types.Object):
        paths = [each.filepath for each in block.modifiers if each.type == "MESH_CACHE" and each.show_viewport]
    elif isinstance(block, READ) and getattr(block, "source", "FILE") == "FILE" and block.filepath != "<builtin>":
        paths = [] if getattr(block, "packed_file", None) else [block.filepath]
    found = (bpy.path.abspath(path, library=block.library) for path in paths)
    return next((path for path in found if not Path(path).is_file()), None)


def _failed_driver(holder: bpy.types.ID) -> str | None:
    """A driver of this data-block that did not evaluate, if there is one."""
    animation = getattr(holder, "animation_data", None)
    for curve in animation.drivers if animation else ():
        if not curve.mute and not (curve.is_valid and curve.driver.is_valid):
            hint = "" if scripts_allowed() else "; blender -y runs the scripts of files"
            return f"a driver that did not run, “{curve.driver.expression or curve.data_path}”{hint}"
    return None
