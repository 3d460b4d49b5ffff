# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Measure Deviation."""

from __future__ import annotations

from functools import partial

import bpy

from ..state import heat_map, out_of_date, properties, still_holds
from ..state.chosen import to_measure
from ..state.heat_map import Shown
from ..tasks.deviation_task import MeasureSettings, MeshDeviation, Verdict, measure, prepare_measurement
from ..tasks.surfaces import naming
from ..ui.facts import deviation_text, deviation_texts
from ..ui.lengths import printable
from .mesh_operators import LongOperator, Steps, Work
from .refusals import refuse_what_cannot_be_written, still_there

# The cause of an early end of a measurement, by whether it was the Time Limit.
ENDED = {
    True: "the Time Limit is over: raise the limit, or set 0 for none",
    False: "the rest would take too much memory: measure parts of the object, or a coarser mesh",
}


class CCDEPTH_OT_measure(properties.VariationProperties, properties.MeasureProperties, LongOperator):
    """Measure the distance between the shown mesh and the limit surface, both ways, with a proof. A result of Apply
    Adaptive Subdivision is measured against its source; of several selected objects, the others are measured against
    the active one"""

    bl_idname = "ccdepth.measure"
    bl_label = "Measure Deviation"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        wanted = to_measure(context)
        self.end_without(context, [each for target, group in wanted.items() for each in (target, *group)])
        answers = yield from deviations_measured(context, wanted, MeasureSettings.of(self, self.tolerance))
        self.report_skipped(context)
        for each in answers:
            name = "" if len(answers) == 1 else f"{printable(each.measured)}: "
            for note in deviation_notes([each]):
                self.report({"WARNING"}, f"{name}{note}")
            texts = deviation_texts(context.scene, each.proved, each.reached, each.tolerance, each.factors)
            self.report({"INFO"}, f"{name}{deviation_text(*texts, each.verdict)}")
        return {"FINISHED"}


def deviations_measured(
    context: bpy.types.Context,
    wanted: dict[bpy.types.Object, list[bpy.types.Object]],
    settings: MeasureSettings,
) -> Steps[list[MeshDeviation]]:
    """Measure objects, by the object with the limit surface, and write their deviations. Raises ComputeError."""
    refuse_what_cannot_be_written([each for group in wanted.values() for each in group])
    tasks = [prepare_measurement(context, group, target, settings) for target, group in wanted.items()]
    states = {
        each.session_uid: still_holds.measured_state(each, target, settings)
        for target, group in wanted.items()
        for each in group
    }
    answers: list[MeshDeviation] = []
    for task in tasks:
        with naming(task.surface.object_name):
            answers += yield Work(partial(measure, task, settings), "Measuring deviation: {:.0%}".format, total=1.0)
    measured = {}
    for each in answers:
        [target], [holder, *_] = still_there([each.against]), still_there(each.holders, len(each.deviations))
        measured[holder] = target
    out_of_date.write_deviations(measured, answers, settings, states)
    heat_map.show(context, Shown.DEVIATION)
    return answers


def deviation_notes(answers: list[MeshDeviation]) -> list[str]:
    """Notes on measurements that ended early."""
    early = [each for each in answers if each.verdict is Verdict.UNDECIDED or not each.accuracy_met]
    return [f"the distances are those proved so far; {ENDED[each.out_of_time]}" for each in early]
