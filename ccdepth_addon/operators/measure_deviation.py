# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Measure Deviation."""

from __future__ import annotations

from functools import partial

import bpy

from ..state import heat_map, mesh_values, out_of_date, properties, result_record, still_holds
from ..state.heat_map import Shown
from ..tasks.deviation_task import MeasureSettings, MeshDeviation, Verdict, measure, prepare_measurement
from ..tasks.surfaces import ComputeError, naming
from ..ui.facts import deviation_text
from ..ui.lengths import Rounding, bound_texts, common_unit, length_text
from ..ui.printable import printable
from .job import Steps, Work
from .long_operator import LongOperator
from .selected_meshes import refuse_what_cannot_be_written, selected_meshes, still_there

# The cause of an early end of a measurement, by whether it was the Time Limit.
ENDED = {
    True: "the Time Limit is over: raise the limit, or set 0 for none",
    False: "the rest would take too much memory: measure parts of the object, or a coarser mesh",
}


class CCDEPTH_OT_measure(properties.MeasureProperties, LongOperator):
    """Measure the distance between the shown mesh and the limit surface, both ways, with a proof. A result of Apply
    Adaptive Subdivision is measured against its source; of several selected objects, the others are measured against
    the active one"""

    bl_idname = "ccdepth.measure"
    bl_label = "Measure Deviation"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        target, objects = _target_and_measured(context)
        refuse_what_cannot_be_written(objects)
        self.end_without(context, [target, *objects])
        settings = MeasureSettings.of(self, self.tolerance)
        task = prepare_measurement(context, objects, target, settings)
        use_modifiers = settings.use_modifiers
        states = {each.name: still_holds.measured_state(each, target, use_modifiers=use_modifiers) for each in objects}
        with naming(task.surface.object_name):
            answers = yield Work(partial(measure, task, settings), "Measuring deviation: {:.0%}".format, total=1.0)
        holders = [_still_there(each) for each in answers]
        mesh_values.write_deviations(holders, answers, settings)
        for each, measured in zip(answers, holders, strict=True):
            out_of_date.remember_measurement(measured, bpy.data.objects[each.against], states[each.measured])
        heat_map.show(context, Shown.DEVIATION)
        self.report_skipped(context)
        for each in answers:
            name = "" if len(answers) == 1 else f"{printable(each.measured)}: "
            if each.verdict is Verdict.UNDECIDED or not each.accuracy_met:
                self.report({"WARNING"}, f"{name}the distances are those proved so far; {ENDED[each.out_of_time]}")
            self.report({"INFO"}, f"{name}{_text(context.scene, each)}")
        return {"FINISHED"}


def _target_and_measured(context: bpy.types.Context) -> tuple[bpy.types.Object, list[bpy.types.Object]]:
    """The object whose limit surface counts, and the objects to measure. Raises ComputeError."""
    objects = selected_meshes(context)
    if len(objects) == 1:
        return surface_object(objects[0]), objects
    target = context.active_object
    if target not in objects:
        raise ComputeError(
            "Several objects are selected, and none is active: make the object with the limit surface active"
        )
    return target, [each for each in objects if each != target]


def surface_object(measured: bpy.types.Object) -> bpy.types.Object:
    """The object of the limit surface for an object selected alone: itself, or for a result of Apply Adaptive
    Subdivision its source. Raises ComputeError for a removed source."""
    if not result_record.is_result(measured):
        return measured
    source = result_record.source_of(measured)
    if source is None or source.type != "MESH":
        raise ComputeError(f"{measured.name}: its source has been removed")
    return source


def _still_there(answer: MeshDeviation) -> bpy.types.Object:
    """The object to write the answer to. Raises ComputeError if an object has changed since it was read."""
    for name in (*answer.object_names, answer.against):
        still_there(name)
    return still_there(answer.measured, answer.mesh_uid, len(answer.deviations))


def _text(scene: bpy.types.Scene, answer: MeshDeviation) -> str:
    """The report of a measurement."""
    unit = common_unit(scene, (answer.proved, answer.reached, answer.tolerance))
    most, tolerance = bound_texts(scene, answer.proved, answer.tolerance, unit)
    least = length_text(scene, answer.reached, Rounding.DOWN, unit=unit)
    return deviation_text(most, least, tolerance, answer.verdict)
