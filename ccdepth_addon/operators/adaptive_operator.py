# SPDX-License-Identifier: GPL-3.0-or-later
"""The common base of Apply Adaptive Subdivision, Update Result and Count Faces."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import bpy

from ..exchange.modifiers import base_modifiers, has_own_keys, left_out_sculpting
from ..state import known, properties
from ..tasks.adaptive_meshes import TooManyError, subdivide
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask, prepare_adaptive
from ..tasks.reduce_task import triangle_count
from ..tasks.surfaces import ComputeError
from ..ui.lengths import bound_texts
from ..ui.printable import printable
from . import edit_mode
from .job import Steps, Work
from .long_operator import LongOperator
from .place_results import NewMesh, make_meshes
from .reduced_meshes import Reducer
from .selected_meshes import LINKED, count_text, name_fault, still_there


class AdaptiveOperator(properties.DivisionProperties, properties.FaceLimitProperties, LongOperator):
    """An operator that makes adaptive meshes or counts their faces."""

    # The number of faces to be made, if counted before.
    counted: int | None = None

    @contextmanager
    def in_object_mode(
        self, context: bpy.types.Context, objects: Sequence[bpy.types.Object], sources: Sequence[bpy.types.Object]
    ) -> Iterator[list[int]]:
        """Leave Edit Mode while this context lasts, and end the run when one of these objects is deleted. Gives the
        list of ``edit_mode.left``."""
        # The evaluation for reading looks like a change of the objects.
        counted = known.known_count(objects, self.settings())
        self.counted = None if counted is None else counted.faces
        self.end_without(context, [*objects, *sources])
        with edit_mode.left(context) as edited:
            yield edited

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

    def made(
        self,
        context: bpy.types.Context,
        sources: Sequence[bpy.types.Object],
        objects: Sequence[bpy.types.Object],
        text: Callable[[float], str],
    ) -> Steps[tuple[list[NewMesh], list[str]]]:
        """Make the meshes of sources for their objects; returns the meshes, and notes for the user. text: of the
        progress in faces. Raises ComputeError."""
        settings = self.settings()
        # The shading angle is about the stored normals.
        exact_normals = self.exact_normals or self.shading_angle > 0
        tasks = yield from prepare_adaptive(context, sources, settings, objects)
        notes = [note for task in tasks for note in _notes(task, self.use_modifiers, exact_normals)]
        answers = yield Work(partial(subdivide, tasks, settings), text, self.counted)
        if not self.reduce:
            return (yield from make_meshes(context, answers, settings, exact_normals=exact_normals)), notes
        reducer = Reducer(context, settings, exact_normals=exact_normals)
        made = yield from reducer.make(answers)
        return made, notes + reducer.notes

    def making_fault(self, blender_object: bpy.types.Object, source: bpy.types.Object) -> str | None:
        """The reason why the object cannot have a mesh made from the source, or None."""
        if self.reduce and has_own_keys(source, use_modifiers=self.use_modifiers):
            return "Reduce cannot keep its shape keys; turn Reduce off, or apply them first"
        return result_fault(blender_object, source)

    def report_made(self, made: list[NewMesh], notes: list[str], objects: list[bpy.types.Object]) -> None:
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


def _notes(task: AdaptiveTask, use_modifiers: bool, exact_normals: bool) -> list[str]:
    """Notes on sculpting, custom normals and shape keys with an outcome that would surprise a user."""
    [source] = still_there([task.targets[0].source])
    notes = []
    if left_out_sculpting(source, use_modifiers=use_modifiers):
        notes.append("its Multiresolution modifier is not included, so the result lacks its sculpting")
    if source.data.has_custom_normals and not exact_normals:
        notes.append("its custom normals are left out; Exact Normals shades like the limit surface")
    keys = source.data.shape_keys
    if keys is not None and base_modifiers(source, use_modifiers=use_modifiers):
        notes.append("its shape keys are applied, like the included modifiers")
    elif keys is not None and any(key.vertex_group and not key.mute and key.value for key in keys.key_blocks):
        notes.append("the tolerance is not proved where a vertex group limits a shape key")
    return [f"{source.name}: {note}" for note in notes]
