# SPDX-License-Identifier: GPL-3.0-or-later
"""The common base of Apply Adaptive Subdivision, Update Result and Count Faces."""

from functools import partial

import bpy

from ..exchange.modifiers import applied_modifiers, has_own_keys, subdivision_modifier
from ..state import known, properties
from ..tasks.adaptive_meshes import TooManyError, subdivide
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask, prepare_adaptive
from ..tasks.reduce_task import triangle_count
from ..tasks.surfaces import ComputeError
from ..ui.lengths import bound_text
from ..ui.printable import printable
from . import edit_mode
from .job import Steps, Work
from .long_operator import LongOperator
from .place_results import NewMesh, make_meshes
from .reduced_meshes import Reducer
from .selected_meshes import LINKED, count_text, name_fault, refuse, selected_meshes


class AdaptiveOperator(properties.DivisionProperties, properties.FaceLimitProperties, LongOperator):
    """An operator that makes adaptive meshes or counts their faces; it leaves Edit Mode while it runs."""

    # How many faces there will be, where they were counted before.
    _counted: int | None = None

    def prepared(self, context: bpy.types.Context) -> Steps[list[AdaptiveTask]]:
        """Leave Edit Mode and read the objects: yields the stage, and returns the tasks. Raises ComputeError."""
        objects = self.objects(context)
        refuse(objects, self.fault)
        # What is evaluated for reading looks like a change of the objects.
        counted = known.known_count(objects, self.settings())
        self._counted = None if counted is None else counted.faces
        sources = [self.source(obj) for obj in objects]
        self.end_without(context, [*objects, *sources])
        self._goes_on_editing = context.mode == "EDIT_MESH"
        self._edited = edit_mode.leave(context)
        return (yield from prepare_adaptive(context, sources, self.settings(), objects))

    def objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The objects that get results."""
        return selected_meshes(context)

    def source(self, blender_object: bpy.types.Object) -> bpy.types.Object:
        """The object that the object's result is made from."""
        return blender_object

    def fault(self, blender_object: bpy.types.Object) -> str | None:
        """Why the object cannot have a result. Its mesh may be linked: nothing is written to it."""
        if not blender_object.is_editable:
            return LINKED
        return name_fault(self.source(blender_object))

    def leave(self, context: bpy.types.Context) -> None:
        edit_mode.enter(context, getattr(self, "_edited", ()))
        self._edited = []

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        settings = self.settings()
        outcome = super()._refuse(context, fault)
        if isinstance(fault, TooManyError):
            known.remember_count(context, [fault.object_names], settings, [fault.count])
        return outcome

    def settings(self) -> AdaptiveSettings:
        return AdaptiveSettings.of(self, self.tolerance)


class MakingOperator(properties.MakingProperties, AdaptiveOperator):
    """An operator that makes adaptive meshes."""

    def steps(self, context: bpy.types.Context) -> Steps[list[NewMesh]]:
        tasks = yield from self.prepared(context)
        self._notes = [note for task in tasks for note in _notes(task, self.use_modifiers)]
        settings = self.settings()
        answers = yield Work(partial(subdivide, tasks, settings), self.progress_text, self._counted)
        if not self.reduce:
            return (yield from make_meshes(context, answers, settings, exact_normals=self.exact_normals))
        reducer = Reducer(context, settings, exact_normals=self.exact_normals)
        made = yield from reducer.make(answers)
        self._notes += reducer.notes
        return made

    def fault(self, blender_object: bpy.types.Object) -> str | None:
        source = self.source(blender_object)
        if self.reduce and has_own_keys(source, use_modifiers=self.use_modifiers):
            return "Reduce cannot keep its shape keys; turn Reduce off, or apply them first"
        return super().fault(blender_object)

    def progress_text(self, progress: float) -> str:
        """The number of faces so far, as text."""
        if self._counted is None:
            return f"Subdividing: {progress:,.0f} faces so far"
        return f"Subdividing: {progress:,.0f} of {self._counted:,} faces"

    def report_made(self, made: list[NewMesh], objects: list[bpy.types.Object]) -> None:
        """Tell what was made, for these objects."""
        for note in self._notes:
            self.report({"WARNING"}, printable(note))
        faces = count_text(sum(len(each.depths) for each in made), "face", "faces")
        objects_text = f"{len(objects)} objects, " if len(objects) > 1 else ""
        # What was cleared before it was made anew has no record.
        proved = [each.data.ccdepth for each in objects if each.data.ccdepth.has_result]
        text = f"{objects_text}{faces}"
        if proved:
            largest, tolerance = max((record.largest_bound, record.world_tolerance) for record in proved)
            text += f", largest distance {bound_text(bpy.context.scene, largest, tolerance)}"
        if self.reduce:
            text += f"; without Reduce {sum(triangle_count(each.result) for each in made):,} triangles"
        self.report({"INFO"}, text)


def _notes(task: AdaptiveTask, use_modifiers: bool) -> list[str]:
    """Notes on shape keys, where what happens to them would surprise a user."""
    source = bpy.data.objects[task.targets[0].source]
    keys = source.data.shape_keys
    if keys is None:
        return []
    subdivision = subdivision_modifier(source)
    if any(m != subdivision for m in applied_modifiers(source, use_modifiers=use_modifiers)):
        return [f"{source.name}: its shape keys are applied, like the modifiers that are counted in"]
    if any(key.vertex_group and not key.mute and key.value for key in keys.key_blocks):
        return [f"{source.name}: the tolerance is not proved where a vertex group limits a shape key"]
    return []
