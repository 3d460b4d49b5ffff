# SPDX-License-Identifier: GPL-3.0-or-later
"""Count Faces and Find Tolerance."""

from functools import partial
from typing import ClassVar

import bpy

from ..state import known, properties, result_record
from ..state.chosen import chosen
from ..tasks.adaptive_meshes import FaceCount, best_tolerance, count_results, too_many_text
from ..tasks.adaptive_task import AdaptiveTask
from ..tasks.surfaces import ComputeError
from ..ui.lengths import count_text, printable
from .adaptive_operator import AdaptiveOperator, result_fault
from .mesh_operators import Steps, Work
from .refusals import hidden_fault, refuse
from .scene_objects import edit_mode_left


class CountingOperator(AdaptiveOperator):
    """An operator that predicts adaptive meshes, and makes none."""

    def read_chosen(self, context: bpy.types.Context) -> Steps[list[AdaptiveTask]]:
        """Read the objects, or for results the sources of Update Result; returns the tasks. Raises ComputeError."""
        objects = chosen(context)
        sources = [result_record.control_object(each) for each in objects]
        faults = {
            each: hidden_fault(each) or result_fault(each, source)
            for each, source in zip(objects, sources, strict=True)
        }
        refuse(objects, faults.get)
        with edit_mode_left(context):
            return (yield from self.read(context, objects, sources))


class CCDEPTH_OT_count_faces(CountingOperator):
    """Count the faces that Apply Adaptive Subdivision would make of the selected objects, and change nothing"""

    bl_idname = "ccdepth.count_faces"
    bl_label = "Count Faces"
    bl_options: ClassVar[set[str]] = set()

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        tasks = yield from self.read_chosen(context)
        work = partial(count_results, tasks, self.settings())
        counts = yield Work(work, "Counting faces: {:,.0f} so far".format, self.counted)
        known.remember_count(context, tasks, self.settings(), counts)
        if not counts[0].are_too_many:
            self.report({"INFO"}, count_text(sum(count.faces for count in counts), "face", "faces"))
        else:
            self.report({"WARNING"}, printable(too_many_text(tasks, counts[0], self.settings())))
        return {"FINISHED"}


class CCDEPTH_OT_find_tolerance(properties.BudgetProperties, CountingOperator):
    """Set the best tolerance for a largest number of faces, of the adaptive meshes of all selected objects together,
    and angles that go with the tolerance"""

    bl_idname = "ccdepth.find_tolerance"
    bl_label = "Find Tolerance"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        if self.face_budget > self.max_faces:
            raise ComputeError(f"The Face Limit is {self.max_faces:,}; raise it first")
        tasks = yield from self.read_chosen(context)
        work = partial(best_tolerance, tasks, self.settings(), self.face_budget)
        fit = yield Work(work, "Finding the tolerance: {:,.0f} faces counted".format, self.counted)
        if fit is None:
            raise ComputeError(f"Even undivided there would be more than {self.face_budget:,} faces")
        context.scene.ccdepth.tolerance_mode = self.tolerance_mode
        properties.set_scene_tolerance(context.scene.ccdepth, fit.tolerance)
        for name in ("shading_angle", "facet_angle"):
            setattr(context.scene.ccdepth, name, getattr(fit.settings, name))
        counts = [FaceCount(faces) for faces in fit.counts]
        known.remember_count(context, tasks, fit.settings, counts)
        unit = {"RELATIVE": " of the diagonal", "PIXELS": " pixels"}.get(self.tolerance_mode, "")
        text = f"{count_text(sum(fit.counts), 'face', 'faces')} with a tolerance of {fit.tolerance:.3g}{unit}"
        self.report({"INFO"}, text)
        return {"FINISHED"}
