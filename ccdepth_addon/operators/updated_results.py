# SPDX-License-Identifier: GPL-3.0-or-later
"""New meshes → results that exist already: each object keeps everything but its mesh."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

import bpy

from ..exchange.bulk_writing import is_writable
from ..state import result_record, results, sources
from ..state.result_record import MadeWith
from .adaptive_objects import Made, ObjectGroups, give_mesh, place

Materials = Sequence[bpy.types.Material | None]


def place_in_results(context: bpy.types.Context, made: list[Made], settings: MadeWith) -> list[str]:
    """Give each mesh to its results, and to the objects that share their mesh; returns notes for the user. Raises
    ComputeError, with nothing changed, when an object is no longer what it was."""
    notes: list[str] = []
    cleared: list[bool] = []
    from_source: list[list[bpy.types.Material | None]] = []

    def placing(
        _context: bpy.types.Context, updated: ObjectGroups, meshes: list[bpy.types.Mesh], undo: ExitStack
    ) -> ObjectGroups:
        old = [group[0].data for group in updated]
        cleared.extend(not results.has_result(mesh) for mesh in old)
        edited = [group[0].data for group in updated if result_record.is_edited(group[0])]
        for mesh, group in zip(meshes, _with_sharing(updated), strict=True):
            from_source.append(list(mesh.materials))
            _keep_materials(mesh, group)
            give_mesh(mesh, group, undo)
        # What follows cannot be undone, and does not fail.
        notes.extend(_take_places(meshes, old, edited, updated))
        # The tolerance is proved for these alone, and not for objects of other scales that share their meshes.
        return updated

    for group, materials, was_cleared in zip(place(context, made, placing), from_source, cleared, strict=True):
        if was_cleared:
            results.clear(group[0].user.data)
        for each in group:
            sources.remember_made(each.user, each.source, settings, materials)
    return notes


def _with_sharing(results: ObjectGroups) -> ObjectGroups:
    """The results, each with objects that share its mesh and are to go on doing so."""
    named = {result for group in results for result in group}
    sharing: dict[bpy.types.Mesh, list[bpy.types.Object]] = {}
    for other in bpy.data.objects:
        if other.type == "MESH" and other not in named and other.is_editable:
            sharing.setdefault(other.data, []).append(other)
    return [[*group, *sharing.pop(group[0].data, [])] for group in results]


def _keep_materials(mesh: bpy.types.Mesh, users: Sequence[bpy.types.Object]) -> None:
    """Put the materials that a user chose for the result in the place of those of the source."""
    result = users[0]
    recorded = [each.material for each in result.ccdepth.materials]
    for index, material in enumerate(result.data.materials):
        is_own = index >= len(recorded) or recorded[index] != material
        is_own |= any(user.material_slots[index].link == "OBJECT" for user in users)
        if not is_own:
            continue
        while len(mesh.materials) <= index:
            mesh.materials.append(None)
        mesh.materials[index] = material


def _take_places(
    meshes: Sequence[bpy.types.Mesh],
    old: Sequence[bpy.types.Mesh],
    edited: Sequence[bpy.types.Mesh],
    results: ObjectGroups,
) -> list[str]:
    """Remove the meshes that nothing uses any more, keep those that a user edited, and give their names to the new
    ones; returns what to tell of it. A mesh whose place several took gives its name to the first."""
    notes = []
    groups = {before: (mesh, group[0]) for mesh, before, group in reversed([*zip(meshes, old, results, strict=True)])}
    for before, (mesh, result) in groups.items():
        if before.users or not is_writable(before):
            continue
        name = before.name
        if before in edited:
            before.name = f"Edited {name}"
            before.use_fake_user = True
            notes.append(f"{result.name}: its mesh had been edited; the edited one is kept as “{before.name}”")
        else:
            bpy.data.meshes.remove(before)
        mesh.name = name
    return notes
