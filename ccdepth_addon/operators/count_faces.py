# SPDX-License-Identifier: GPL-3.0-or-later
"""Count Faces."""

from functools import partial
from typing import ClassVar

import bpy

from ..state import known, result_record
from ..tasks.adaptive_meshes import FaceCount, count_results, too_many_text
from ..tasks.adaptive_task import AdaptiveTask
from ..ui.printable import printable
from .adaptive_operator import AdaptiveOperator
from .job import Steps, Work
from .selected_meshes import count_text, hidden_fault


class CountingOperator(AdaptiveOperator):
    """An operator that says what adaptive meshes would be like, and makes none."""

    def source(self, blender_object: bpy.types.Object) -> bpy.types.Object:
        """The source that Update Result would make a result from."""
        return result_record.control_object(blender_object)

    def fault(self, blender_object: bpy.types.Object) -> str | None:
        return hidden_fault(blender_object) or super().fault(blender_object)


class CCDEPTH_OT_count_faces(CountingOperator):
    """Count the faces that Apply Adaptive Subdivision would make of the selected objects, and change nothing"""

    bl_idname = "ccdepth.count_faces"
    bl_label = "Count Faces"
    bl_options: ClassVar[set[str]] = {"REGISTER"}

    def steps(self, context: bpy.types.Context) -> Steps[tuple[list[AdaptiveTask], list[FaceCount]]]:
        tasks = yield from self.prepared(context)
        work = partial(count_results, tasks, self.settings())
        return tasks, (yield Work(work, "Counting faces: {:,.0f} so far".format, self._counted))

    def finish(self, context: bpy.types.Context, answer: tuple[list[AdaptiveTask], list[FaceCount]]) -> set[str]:
        tasks, counts = answer
        self.leave(context)
        known.remember_count(context, [task.object_names for task in tasks], self.settings(), counts)
        if not counts[0].are_too_many:
            self.report({"INFO"}, count_text(sum(count.faces for count in counts), "face", "faces"))
        else:
            self.report({"WARNING"}, printable(too_many_text(tasks, counts[0], self.settings())))
        return {"FINISHED"}
