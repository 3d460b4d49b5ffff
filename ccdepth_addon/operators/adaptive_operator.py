# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision, and the common base of this operator, Update Result and Count Faces."""

from collections.abc import Sequence
from functools import partial

import bpy

from ..exchange.modifiers import counted_modifiers, has_own_keys, left_out_sculpting
from ..state import heat_map, known, properties, result_record
from ..state.chosen import chosen
from ..state.heat_map import Shown
from ..tasks.adaptive_meshes import TooManyError, subdivide
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask, prepare_adaptive
from ..tasks.reduce_task import triangle_count
from ..tasks.surfaces import ComputeError
from ..ui.lengths import bound_texts, count_text, printable
from .mesh_operators import LongOperator, Steps, Work
from .place_results import NewMesh, Way, beside, in_results, instead, make_meshes, place
from .reduced_meshes import Reducer
from .refusals import LINKED, hidden_fault, name_fault, refuse, still_there
from .scene_objects import edit_mode_left


class AdaptiveOperator(properties.DivisionProperties, properties.FaceLimitProperties, LongOperator):
    """An operator that makes adaptive meshes or counts their faces."""

    # The number of faces to be made, if counted before.
    counted: int | None = None

    def read(
        self, context: bpy.types.Context, objects: Sequence[bpy.types.Object], sources: Sequence[bpy.types.Object]
    ) -> Steps[list[AdaptiveTask]]:
        """Read the sources in Object Mode, to make meshes for the objects; the run ends when one of these is deleted.
        Raises ComputeError."""
        # The evaluation for reading looks like a change of the objects.
        counted = known.known_count(objects, self.settings())
        self.counted = None if counted is None else counted.faces
        self.end_without(context, [*objects, *sources])
        return (yield from prepare_adaptive(context, sources, self.settings(), objects))

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        settings = self.settings()
        outcome = super()._refuse(context, fault)
        if isinstance(fault, TooManyError):
            known.remember_count(context, fault.tasks, settings, [fault.count])
        return outcome

    def settings(self) -> AdaptiveSettings:
        return AdaptiveSettings.of(self, self.tolerance)


class MakingOperator(properties.MakingProperties, AdaptiveOperator):
    """An operator that makes adaptive meshes."""

    def make(
        self,
        context: bpy.types.Context,
        objects: Sequence[bpy.types.Object],
        sources: Sequence[bpy.types.Object],
        way: Way,
    ) -> Steps[set[str]]:
        """Make the meshes of sources for objects, and place them in a way. Raises ComputeError."""
        settings, is_editing = self.settings(), context.mode == "EDIT_MESH"
        # The shading angle is about the stored normals.
        exact_normals = self.exact_normals or self.shading_angle > 0
        with edit_mode_left(context) as edited:
            tasks = yield from self.read(context, objects, sources)
            notes = [note for task in tasks for note in _notes(task, settings, exact_normals)]
            answers = yield Work(partial(subdivide, tasks, settings), self._progress_text, self.counted)
            if self.reduce:
                reducer = Reducer(context, settings, exact_normals=exact_normals)
                made = yield from reducer.make(answers)
                notes += reducer.notes
            else:
                made = yield from make_meshes(context, answers, settings, exact_normals=exact_normals)
            names = properties.Settings.of(self, result_record.SETTINGS)
            placed, more = place(context, made, names, way)
            if is_editing and way is beside:
                edited[:] = [each.session_uid for each in placed]
        if way is not in_results:
            self.report_skipped(context)
        self._report_made(made, notes + more, placed)
        return {"FINISHED"}

    def _progress_text(self, faces: float) -> str:
        of_all = "faces so far" if self.counted is None else f"of {self.counted:,} faces"
        return f"Subdividing: {faces:,.0f} {of_all}"

    def making_fault(self, blender_object: bpy.types.Object, source: bpy.types.Object) -> str | None:
        """The reason why the object cannot have a mesh made from the source, or None."""
        if self.reduce and self.tolerance_by != "NONE":
            return "Reduce takes one tolerance; turn Reduce off, or set Vary by to Nothing"
        if self.reduce and has_own_keys(source, use_modifiers=self.use_modifiers):
            return "Reduce cannot keep its shape keys; turn Reduce off, or apply them first"
        return result_fault(blender_object, source)

    def _report_made(self, made: list[NewMesh], notes: list[str], objects: list[bpy.types.Object]) -> None:
        """Report the meshes made for these objects."""
        faces = count_text(sum(len(each.depths) for each in made), "face", "faces")
        objects_text = f"{len(objects)} objects, " if len(objects) > 1 else ""
        # A result cleared before it was made anew has no record.
        proved = [each.data.ccdepth for each in objects if each.data.ccdepth.has_result]
        text = f"{objects_text}{faces}"
        if proved:
            largest, tolerance = max((record.largest_bound, record.world_tolerance) for record in proved)
            text += f", largest distance {bound_texts(bpy.context.scene, largest, tolerance)[0]}"
        if self.reduce:
            text += f"; without Reduce {sum(triangle_count(each.answer) for each in made):,} triangles"
        self.report({"INFO"}, text)
        # Blender's status bar shows the last report alone.
        for note in notes:
            self.report({"WARNING"}, printable(note))


def result_fault(blender_object: bpy.types.Object, source: bpy.types.Object) -> str | None:
    """The reason why the object cannot have a result of the source, or None. Its mesh may be linked, as nothing is
    written to it."""
    return name_fault(source) if blender_object.is_editable else LINKED


def _notes(task: AdaptiveTask, settings: AdaptiveSettings, exact_normals: bool) -> list[str]:
    """Notes on sculpting, custom normals, shape keys and weights with an outcome that would surprise a user."""
    [source] = still_there([task.targets[0].source])
    notes, use_modifiers = [], settings.use_modifiers
    if settings.tolerance_by == "VERTEX_GROUP" and task.least_factor == settings.coarsest > 1:
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
        refuse(objects, self._fault)
        status = yield from self.make(context, objects, objects, instead if self.output == "IN_PLACE" else beside)
        heat_map.show(context, Shown.DISTANCE)
        return status

    def _fault(self, blender_object: bpy.types.Object) -> str | None:
        if not self.subdivide_results and result_record.is_adaptive(blender_object):
            return _result_fault(blender_object)
        if self.output == "IN_PLACE" and (fault := self._replacing_fault(blender_object)):
            return fault
        return hidden_fault(blender_object) or self.making_fault(blender_object, blender_object)

    def _replacing_fault(self, blender_object: bpy.types.Object) -> str | None:
        """The reason why the object's mesh cannot be replaced, or None."""
        if blender_object.override_library is not None:
            return "the object is a library override; choose New Object, or make it local first"
        if left_out_sculpting(blender_object, use_modifiers=self.use_modifiers):
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
