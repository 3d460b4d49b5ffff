# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Apply Adaptive Subdivision, and Count Faces."""

from collections.abc import Generator
from typing import ClassVar

import bpy

from ..exchange.control_mesh import applied_modifiers, subdivision_modifier
from ..state import face_counts, properties
from ..tasks.adaptive_task import (
    FaceCount,
    SubdivisionSettings,
    SubdivisionTask,
    count_stepwise,
    prepare_subdivision,
    subdivide_stepwise,
    subdivision_settings,
    too_many_text,
)
from ..tasks.stepwise import Stage
from ..ui import heat_map
from ..ui.printable import printable
from . import edit_mode
from .adaptive_objects import Made, make_meshes, place_meshes
from .long_operator import LongOperator, count_text, hidden_fault, meshes_meant, name_fault, refuse, without_mesh_text


class SubdivisionOperator(LongOperator):
    """An operator that makes subdivisions, or finds out what they would be like; it leaves Edit Mode meanwhile."""

    SETTINGS: ClassVar[tuple[str, ...]] = ("tolerance_mode", "mode", "transitions", "use_modifiers", "max_faces")

    mode: properties.mode_property()
    transitions: properties.transitions_property()
    max_faces: properties.max_faces_property()

    def prepared(self, context: bpy.types.Context) -> Generator[Stage, None, list[SubdivisionTask]]:
        """What there is to make, with Edit Mode left; yields how far it is. Raises ComputeError."""
        objects = meshes_meant(context)
        refuse(objects, lambda obj: hidden_fault(obj) or self.object_fault(obj) or name_fault(obj))
        self._edited = edit_mode.leave(context)
        return (yield from prepare_subdivision(context, objects, self.settings()))

    def object_fault(self, blender_object: bpy.types.Object) -> str | None:
        """Why the object cannot have a result. Its mesh may be anybody's: nothing is written to it."""
        if not blender_object.is_editable:
            return "the object is linked from another file; make it local first"
        return None

    def leave(self, context: bpy.types.Context) -> None:
        edit_mode.enter(context, getattr(self, "_edited", ()))
        self._edited = []

    def settings(self) -> SubdivisionSettings:
        return subdivision_settings(self, self.tolerance)


class CCDEPTH_OT_subdivide(SubdivisionOperator):
    """Make the mesh that is within the tolerance of the limit surface with few faces, and without cracks.
    It takes the place of the Subdivision Surface modifier"""

    bl_idname = "ccdepth.subdivide"
    bl_label = "Apply Adaptive Subdivision"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    SETTINGS: ClassVar[tuple[str, ...]] = (*SubdivisionOperator.SETTINGS, "output", "exact_normals")

    output: properties.output_property()
    exact_normals: properties.exact_normals_property()

    def start(self, context: bpy.types.Context) -> Generator[Stage | int, None, list[Made]]:
        tasks = yield from self.prepared(context)
        self._notes = [note for task in tasks for note in _notes(task, self.use_modifiers)]
        answers = yield from subdivide_stepwise(tasks, self.settings())
        return (yield from make_meshes(context, answers, self.settings(), exact_normals=self.exact_normals))

    def object_fault(self, blender_object: bpy.types.Object) -> str | None:
        if self.output == "IN_PLACE" and blender_object.override_library is not None:
            return "the object is a library override; choose New Object, or make it local first"
        return super().object_fault(blender_object)

    def progress_text(self, progress: int) -> str:
        return f"Subdividing: {progress:,} faces so far"

    def finish(self, context: bpy.types.Context, answer: list[Made]) -> set[str]:
        objects = place_meshes(context, answer, self.settings(), in_place=self.output == "IN_PLACE")
        if self._edited:
            self._edited = [placed.session_uid for placed in objects]
        skipped = without_mesh_text(context)
        if skipped:
            self.report({"INFO"}, skipped)
        for note in self._notes:
            self.report({"WARNING"}, printable(note))
        results = [made.subdivision.adaptive for made in answer]
        faces = count_text(sum(len(each.depths) for each in results), "face", "faces")
        objects_text = f"{len(objects)} objects, " if len(objects) > 1 else ""
        deepest = max(int(each.depths.max(initial=0)) for each in results)
        self.report({"INFO"}, f"{objects_text}{faces}, deepest depth {deepest}")
        return {"FINISHED"}


def _notes(task: SubdivisionTask, use_modifiers: bool) -> list[str]:
    """What is lost or not promised, as far as shape keys are concerned."""
    blender_object = bpy.data.objects[task.object_names[0]]
    keys = blender_object.data.shape_keys
    if keys is None:
        return []
    subdivision = subdivision_modifier(blender_object)
    if any(m != subdivision for m in applied_modifiers(blender_object, use_modifiers=use_modifiers)):
        return [f"{blender_object.name}: its shape keys are applied, like the modifiers that are counted in"]
    if any(key.vertex_group and not key.mute and key.value for key in keys.key_blocks):
        return [f"{blender_object.name}: the tolerance is not proved where a vertex group limits a shape key"]
    return []


class CCDEPTH_OT_count_faces(SubdivisionOperator):
    """Find out how many faces Apply Adaptive Subdivision would make of the selected objects, and change nothing"""

    bl_idname = "ccdepth.count_faces"
    bl_label = "Count Faces"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    def start(
        self, context: bpy.types.Context
    ) -> Generator[Stage | int, None, tuple[list[SubdivisionTask], list[FaceCount]]]:
        tasks = yield from self.prepared(context)
        return tasks, (yield from count_stepwise(tasks, self.settings()))

    def progress_text(self, progress: int) -> str:
        return f"Counting faces: {progress:,} so far"

    def finish(self, context: bpy.types.Context, answer: tuple[list[SubdivisionTask], list[FaceCount]]) -> set[str]:
        tasks, counts = answer
        self.leave(context)
        # What was evaluated for counting must not look like a change of the objects.
        context.view_layer.update()
        for task, count in zip(tasks, counts, strict=True):
            for name in task.object_names:
                face_counts.remember(bpy.data.objects[name], self.settings(), count)
        if counts[0].fitting is None:
            self.report({"INFO"}, count_text(sum(count.faces for count in counts), "face", "faces"))
        else:
            self.report({"WARNING"}, printable(too_many_text(tasks, counts[0], self.settings())))
        heat_map.redraw_viewports(context)
        return {"FINISHED"}


CLASSES = (CCDEPTH_OT_subdivide, CCDEPTH_OT_count_faces)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
