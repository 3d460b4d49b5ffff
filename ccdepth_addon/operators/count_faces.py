# SPDX-License-Identifier: GPL-3.0-or-later
"""Count Faces and Find Tolerance."""

from functools import partial
from typing import ClassVar

import bpy

from ..state import known, properties, result_record
from ..state.chosen import chosen
from ..tasks.adaptive_meshes import FaceCount, Fit, best_tolerance, count_results, too_many_text
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask, prepare_adaptive
from ..tasks.surfaces import ComputeError
from ..ui.lengths import count_text, printable
from .adaptive_operator import AdaptiveOperator, result_fault
from .mesh_operators import Steps, Work
from .refusals import hidden_fault, refuse
from .scene_objects import edit_mode_left


class CountingOperator(AdaptiveOperator):
    """An operator that predicts adaptive meshes, and makes none."""

    # The number of faces to be made, if counted before.
    counted: int | None = None

    def read_chosen(self, context: bpy.types.Context) -> Steps[list[AdaptiveTask]]:
        """Read the objects, or for results the sources of Update Result; returns the tasks. Raises ComputeError."""
        objects = chosen(context)
        sources = [result_record.control_object(each) for each in objects]
        self.counted = self.know(context, objects, sources)
        return (yield from read_to_count(context, objects, sources, self.settings()))


def read_to_count(
    context: bpy.types.Context,
    objects: list[bpy.types.Object],
    sources: list[bpy.types.Object],
    settings: AdaptiveSettings,
) -> Steps[list[AdaptiveTask]]:
    """Read the sources of results of the objects; returns the tasks. Raises ComputeError."""
    faults = {
        each: hidden_fault(each) or result_fault(each, source) for each, source in zip(objects, sources, strict=True)
    }
    refuse(objects, faults.get)
    with edit_mode_left(context):
        return (yield from prepare_adaptive(context, sources, settings, objects))


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
        tasks = yield from self.read_chosen(context)
        fit = yield from tolerance_found(context, tasks, self.settings(), self.face_budget, self.counted)
        unit = {"RELATIVE": " of the diagonal", "PIXELS": " pixels"}.get(self.tolerance_mode, "")
        text = f"{count_text(sum(fit.counts), 'face', 'faces')} with a tolerance of {fit.tolerance:.3g}{unit}"
        self.report({"INFO"}, text)
        return {"FINISHED"}


def tolerance_found(
    context: bpy.types.Context,
    tasks: list[AdaptiveTask],
    settings: AdaptiveSettings,
    face_budget: int,
    counted: int | None = None,
) -> Steps[Fit]:
    """Set the scene's tolerance and angles to the best ones for a number of faces. Raises ComputeError."""
    if face_budget > settings.max_faces:
        raise ComputeError(f"The Face Limit is {settings.max_faces:,}; raise it first")
    work = partial(best_tolerance, tasks, settings, face_budget)
    fit: Fit | None = yield Work(work, "Finding the tolerance: {:,.0f} faces counted".format, counted)
    if fit is None:
        raise ComputeError(f"With any tolerance there would be more than {face_budget:,} faces")
    holder = context.scene.ccdepth
    holder.tolerance_mode = settings.tolerance_mode
    properties.set_scene_tolerance(holder, fit.tolerance)
    for name in ("shading_angle", "facet_angle"):
        setattr(holder, name, getattr(fit.settings, name))
    known.remember_count(context, tasks, fit.settings, [FaceCount(faces) for faces in fit.counts])
    return fit
