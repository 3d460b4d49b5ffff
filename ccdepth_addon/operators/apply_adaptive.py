# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Apply Adaptive Subdivision."""

from collections.abc import Generator
from typing import ClassVar

import bpy

from ..exchange.control_mesh import applied_modifiers, has_own_keys, subdivision_modifier
from ..state import properties
from ..tasks.adaptive_task import AdaptiveTask, subdivide
from ..tasks.reduce_task import triangle_count
from ..tasks.stepwise import Stage
from ..ui.printable import printable
from .adaptive_objects import Made, make_meshes, place_meshes
from .adaptive_operator import AdaptiveOperator
from .reduced_meshes import Reducer
from .selected_meshes import count_text, without_mesh_text


class CCDEPTH_OT_subdivide(AdaptiveOperator):
    """Make the mesh that is within the tolerance of the limit surface with few faces, and without cracks.
    It takes the place of the Subdivision Surface modifier"""

    bl_idname = "ccdepth.subdivide"
    bl_label = "Apply Adaptive Subdivision"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    SETTINGS: ClassVar[tuple[str, ...]] = (*AdaptiveOperator.SETTINGS, "output", "exact_normals", "reduce")

    output: properties.output_property()
    exact_normals: properties.exact_normals_property()
    reduce: properties.reduce_property()

    def start(self, context: bpy.types.Context) -> Generator[Stage | float, None, list[Made]]:
        tasks = yield from self.prepared(context)
        self._notes = [note for task in tasks for note in _notes(task, self.use_modifiers)]
        settings = self.settings()
        answers = yield from self.computed(lambda progress: subdivide(tasks, settings, progress))
        if not self.reduce:
            return (yield from make_meshes(context, answers, settings, exact_normals=self.exact_normals))
        reducer = Reducer(context, settings, self.computed, exact_normals=self.exact_normals)
        made = yield from reducer.make(answers)
        self._notes += reducer.notes
        return made

    def object_fault(self, blender_object: bpy.types.Object) -> str | None:
        if self.output == "IN_PLACE" and blender_object.override_library is not None:
            return "the object is a library override; choose New Object, or make it local first"
        if self.reduce and has_own_keys(blender_object, use_modifiers=self.use_modifiers):
            return "Reduce cannot keep its shape keys; turn Reduce off, or apply them first"
        return super().object_fault(blender_object)

    def progress_text(self, progress: float) -> str:
        return f"Subdividing: {progress:,.0f} faces so far"

    def finish(self, context: bpy.types.Context, answer: list[Made]) -> set[str]:
        objects = place_meshes(context, answer, self.settings(), in_place=self.output == "IN_PLACE")
        if self._goes_on_editing:
            self._edited = [placed.session_uid for placed in objects]
        skipped = without_mesh_text(context)
        if skipped:
            self.report({"INFO"}, skipped)
        for note in self._notes:
            self.report({"WARNING"}, printable(note))
        faces = count_text(sum(len(each.depths) for each in answer), "face", "faces")
        objects_text = f"{len(objects)} objects, " if len(objects) > 1 else ""
        deepest = max(int(each.depths.max(initial=0)) for each in answer)
        text = f"{objects_text}{faces}, deepest depth {deepest}"
        if self.reduce:
            text += f"; without Reduce {sum(triangle_count(each.result) for each in answer):,} triangles"
        self.report({"INFO"}, text)
        return {"FINISHED"}


def _notes(task: AdaptiveTask, use_modifiers: bool) -> list[str]:
    """What happens to shape keys that a user would not expect."""
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
