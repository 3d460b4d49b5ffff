# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision, and the common base of this operator, Update Result and Count Faces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import bpy

from ..exchange.data_blocks import removed_on_failure
from ..exchange.modifiers import counted_modifiers, has_own_keys, left_out_sculpting
from ..state import known, properties, result_record, switch_distances
from ..state.chosen import chosen
from ..tasks.adaptive_meshes import TooManyError, subdivide
from ..tasks.adaptive_task import FINEST, AdaptiveSettings, AdaptiveTask, Level, prepare_adaptive
from ..tasks.reduce_task import triangle_count
from ..tasks.surfaces import ComputeError
from ..ui.lengths import bound_texts, count_text, printable
from .mesh_operators import LongOperator, Steps, Work
from .place_results import NewMesh, Placed, Way, beside, in_results, instead, make_meshes, place
from .reduced_meshes import Reducer
from .refusals import LINKED, hidden_fault, name_fault, refuse, still_there
from .scene_objects import edit_mode_left


@dataclass(frozen=True)
class Made:
    """The results by the levels of detail and objects they were made for, their meshes, and notes for the user."""

    placed: Placed
    meshes: list[NewMesh]
    notes: list[str]


class AdaptiveOperator(
    properties.VariationProperties, properties.DivisionProperties, properties.FaceLimitProperties, LongOperator
):
    """An operator that makes adaptive meshes or counts their faces."""

    def know(
        self, context: bpy.types.Context, objects: Sequence[bpy.types.Object], sources: Sequence[bpy.types.Object]
    ) -> int | None:
        """Let the run end when one of these is deleted; returns the number of faces to be made, if counted before. The
        evaluation for reading looks like a change of the objects."""
        self.end_without(context, [*objects, *sources])
        counted = known.known_count(objects, self.settings())
        return None if counted is None else counted.faces

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        settings = self.settings()
        outcome = super()._refuse(context, fault)
        if isinstance(fault, TooManyError):
            known.remember_count(context, fault.tasks, settings, [fault.count])
        return outcome

    def settings(self) -> AdaptiveSettings:
        return AdaptiveSettings.of(self, self.tolerance)


# The objects that get meshes, each with its source, by the level of detail.
Wanted = Mapping[Level, Mapping[bpy.types.Object, bpy.types.Object]]


class MakingOperator(properties.MakingProperties, AdaptiveOperator):
    """An operator that makes adaptive meshes."""

    def make(self, context: bpy.types.Context, wanted: Wanted, way: Way) -> Steps[set[str]]:
        """Make all wanted meshes, and place them in a way. Raises ComputeError."""
        source_of = {each: source for pairs in wanted.values() for each, source in pairs.items()}
        counted = self.know(context, [*source_of], [*source_of.values()])
        made = yield from make_and_place(context, wanted, self, self.settings(), way, counted)
        if way is not in_results:
            self.report_skipped(context)
        self._report_made(made)
        return {"FINISHED"}

    def _report_made(self, made: Made) -> None:
        """Report the meshes that were made."""
        objects = [*made.placed.values()]
        faces = count_text(sum(len(each.depths) for each in made.meshes), "face", "faces")
        objects_text = f"{len(objects)} objects, " if len(objects) > 1 else ""
        # A result cleared before it was made anew has no record.
        proved = [each.data.ccdepth for each in objects if each.data.ccdepth.has_result]
        text = f"{objects_text}{faces}"
        if proved:
            largest, tolerance = max((record.largest_bound, record.world_tolerance) for record in proved)
            text += f", largest distance {bound_texts(bpy.context.scene, largest, tolerance)[0]}"
        if self.reduce:
            text += f"; without Reduce {sum(triangle_count(each.answer) for each in made.meshes):,} triangles"
        self.report({"INFO"}, text)
        # Blender's status bar shows the last report alone.
        for note in made.notes:
            self.report({"WARNING"}, printable(note))


def finest(objects: Sequence[bpy.types.Object]) -> Wanted:
    """The meshes of objects with the settings as they are."""
    return {FINEST: {each: each for each in objects}}


def make_and_place(
    context: bpy.types.Context,
    wanted: Wanted,
    holder: Any,
    settings: AdaptiveSettings,
    way: Way,
    counted: int | None = None,
) -> Steps[Made]:
    """Make all wanted meshes, and place them in a way. holder: of further settings, an operator or a scene's. counted:
    the number of faces of the finest level, if known. Raises ComputeError."""
    is_editing = context.mode == "EDIT_MESH"
    meshes: list[NewMesh] = []
    notes: list[str] = []
    with edit_mode_left(context) as edited:
        with removed_on_failure([]) as uids:
            for level, source_of in wanted.items():
                own, count = settings.at_level(level), None if level.number else counted
                tasks = yield from prepare_adaptive(context, [*source_of.values()], own, [*source_of])
                found, more = yield from make_unplaced(context, tasks, holder, own, count)
                meshes += [replace(each, level=level) for each in found]
                notes += more
                uids += [each.mesh_uid for each in found]
        names = properties.Settings.of(holder, result_record.SETTINGS)
        placed, more = place(context, meshes, names, way)
        if is_editing and way is beside:
            edited[:] = [each.session_uid for each in placed.values()]
    switch_distances.write(context.scene, [*placed.values()])
    # Levels of detail have the same notes.
    return Made(placed, meshes, [*dict.fromkeys(notes + more)])


def make_unplaced(
    context: bpy.types.Context,
    tasks: list[AdaptiveTask],
    holder: Any,
    settings: AdaptiveSettings,
    counted: int | None = None,
) -> Steps[tuple[list[NewMesh], list[str]]]:
    """Make the meshes of tasks, in Object Mode, which no object uses yet; returns them, and notes for the user. holder,
    counted: as of ``make_and_place``. Raises ComputeError."""

    def text(faces: float) -> str:
        of_all = "faces so far" if counted is None else f"of {counted:,} faces"
        return f"Subdividing: {faces:,.0f} {of_all}"

    # The shading angle is about the stored normals.
    exact_normals = holder.exact_normals or settings.shading_angle > 0
    notes = [note for task in tasks for note in _notes(task, settings, exact_normals)]
    answers = yield Work(partial(subdivide, tasks, settings), text, counted)
    if not holder.reduce:
        return (yield from make_meshes(context, answers, settings, exact_normals=exact_normals)), notes
    reducer = Reducer(context, settings, exact_normals=exact_normals)
    meshes = yield from reducer.make(answers)
    return meshes, notes + reducer.notes


def making_fault(blender_object: bpy.types.Object, source: bpy.types.Object, holder: Any) -> str | None:
    """The reason why the object cannot have a mesh made from the source with the holder's settings, or None."""
    if holder.reduce and holder.longest_edge:
        return "Reduce keeps no edges short; turn Reduce off, or set Longest Edge to 0"
    if holder.reduce and has_own_keys(source, use_modifiers=holder.use_modifiers):
        return "Reduce cannot keep its shape keys; turn Reduce off, or apply them first"
    return result_fault(blender_object, source)


def result_fault(blender_object: bpy.types.Object, source: bpy.types.Object) -> str | None:
    """The reason why the object cannot have a result of the source, or None. Its mesh may be linked, as nothing is
    written to it."""
    return name_fault(source) if blender_object.is_editable else LINKED


def _notes(task: AdaptiveTask, settings: AdaptiveSettings, exact_normals: bool) -> list[str]:
    """Notes on sculpting, custom normals, shape keys and weights with an outcome that would surprise a user."""
    [source] = still_there([task.targets[0].source])
    notes, use_modifiers = [], settings.use_modifiers
    if settings.tolerance_by == "VERTEX_GROUP" and task.surface.least_factor == settings.coarsest > 1:
        notes.append(f"“{settings.vertex_group}” has no weight above 0: the tolerance is the coarsest everywhere")
    if left_out_sculpting(source, use_modifiers=use_modifiers):
        notes.append("its Multiresolution modifier is not included, so the result lacks its sculpting")
    if source.data.has_custom_normals and not exact_normals:
        notes.append("its custom normals are left out; Exact Normals shades like the limit surface")
    keys = source.data.shape_keys
    if keys is not None and counted_modifiers(source, use_modifiers=use_modifiers):
        notes.append("its shape keys are applied, like the included modifiers")
    elif keys is not None and any(key.vertex_group and not key.mute and key.value for key in keys.key_blocks):
        notes.append("the tolerance is not proved where a vertex group limits a shape key")
    return [f"{source.name}: {note}" for note in notes]


class CCDEPTH_OT_subdivide(properties.OutputProperties, MakingOperator):
    """Make a mesh with few faces, without cracks, and within the tolerance of the limit surface. The mesh takes the
    place of the Subdivision Surface modifier"""

    bl_idname = "ccdepth.subdivide"
    bl_label = "Apply Adaptive Subdivision"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        objects = chosen(context)
        return (yield from self.make(context, finest(objects), way_to_place(objects, self)))


def way_to_place(objects: list[bpy.types.Object], holder: Any) -> Way:
    """The way to place the meshes made of objects, by the settings of an operator or a scene. Raises ComputeError,
    naming every object that cannot have one."""
    refuse(objects, lambda each: _fault(each, holder))
    return instead if holder.output == "IN_PLACE" else beside


def _fault(blender_object: bpy.types.Object, holder: Any) -> str | None:
    if not holder.subdivide_results and result_record.is_adaptive(blender_object):
        return _result_fault(blender_object)
    if holder.output == "IN_PLACE" and (fault := _replacing_fault(blender_object, holder)):
        return fault
    return hidden_fault(blender_object) or making_fault(blender_object, blender_object, holder)


def _replacing_fault(blender_object: bpy.types.Object, holder: Any) -> str | None:
    """The reason why the object's mesh cannot be replaced, or None."""
    if blender_object.override_library is not None:
        return "the object is a library override; choose New Object, or make it local first"
    if left_out_sculpting(blender_object, use_modifiers=holder.use_modifiers):
        return (
            "the sculpting of its Multiresolution modifier would be lost; turn Include Modifiers on and show the "
            "modifier, or choose New Object"
        )
    return None


def _result_fault(blender_object: bpy.types.Object) -> str:
    """The reason why a result is not subdivided."""
    if result_record.is_result(blender_object):
        return (
            f"it is a result already, made from “{blender_object.ccdepth.source_name}”; use Update Result to make it "
            "anew, or turn Subdivide Results on to subdivide it once more"
        )
    return "it was subdivided in place already, and has no source; turn Subdivide Results on to subdivide it once more"
