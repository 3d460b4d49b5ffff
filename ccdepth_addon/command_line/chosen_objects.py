# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects of a file are worked on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy

from ..ui.printable import printable
from .blender_calls import CommandError
from .report import name_of


def chosen_objects(
    source: Path | None, names: Sequence[str] | None = None, collection: str | None = None
) -> list[bpy.types.Object]:
    """The mesh objects of what is open that are not hidden; those of these names and of this collection alone, if any
    are given. Raises CommandError when there are none, when one of the names is missing, and when the file that one is
    linked from is."""
    file, place, there = name_of(source), "it", set(bpy.data.objects)
    whole = bpy.context.scene.collection
    if collection is not None:
        if collection not in bpy.data.collections:
            raise CommandError(f"{file}: there is no collection “{collection}” in it")
        whole = bpy.data.collections[collection]
        place, there = f"its collection “{collection}”", set(whole.all_objects)
    found = [obj for obj in bpy.context.view_layer.objects if obj in there]
    if names is not None:
        found = [obj for obj in found if obj.name in names]
    shown = [obj for obj in found if obj.visible_get()]
    parts = set() if names else {whole, *whole.children_recursive}
    collections = [each for each in _shown_collections(bpy.context.view_layer.layer_collection) if each in parts]
    _refuse_missing(file, [*collections, *shown, *(obj.data for obj in shown if obj.data is not None)])
    visible = [obj for obj in shown if obj.type == "MESH"]
    found_names = {obj.name for obj in visible}
    unknown = next((name for name in names or () if name not in found_names), None)
    if unknown is not None:
        raise CommandError(f"{file}: there is no mesh object “{unknown}” in {place} that is not hidden")
    for hidden in [obj for obj in found if obj.type == "MESH" and not obj.visible_get()]:
        print(f"Left out because it is hidden: {printable(hidden.name)}")
    if not visible:
        which = " that is not hidden" if any(obj.type == "MESH" for obj in there) else ""
        raise CommandError(f"{file}: there is no mesh object in {place}{which}")
    return visible


def _shown_collections(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Collection]:
    """The collections of a view layer that are not excluded from it."""
    for child in layer.children:
        if not child.exclude:
            yield child.collection
            yield from _shown_collections(child)


def _refuse_missing(file: str, used: Sequence[bpy.types.ID]) -> None:
    """Raise CommandError when one of these is linked from a file that does not have it. Blender puts an empty one in
    its place, of which everything would be true."""
    lost = next((each for each in used if each.is_missing), None)
    if lost is not None:
        library = bpy.path.abspath(lost.library.filepath)
        raise CommandError(f"{file}: “{lost.name}” is missing: it is linked from {library}")
