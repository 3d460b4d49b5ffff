# SPDX-License-Identifier: GPL-3.0-or-later
"""Find Tolerance."""

from functools import partial

import bpy

from ..state import known, properties
from ..tasks.adaptive_meshes import FaceCount, best_tolerance
from ..tasks.surfaces import ComputeError
from .count_faces import CountingOperator
from .job import Steps, Work
from .selected_meshes import count_text


class CCDEPTH_OT_find_tolerance(properties.BudgetProperties, CountingOperator):
    """Set the best tolerance for a largest number of faces, of the adaptive meshes of all selected objects together,
    and angles that go with the tolerance"""

    bl_idname = "ccdepth.find_tolerance"
    bl_label = "Find Tolerance"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        if self.face_budget > self.max_faces:
            raise ComputeError(f"The Face Limit is {self.max_faces:,}; raise it first")
        tasks = yield from self.read(context)
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
        unit = " of the diagonal" if self.tolerance_mode == "RELATIVE" else ""
        text = f"{count_text(sum(fit.counts), 'face', 'faces')} with a tolerance of {fit.tolerance:.3g}{unit}"
        self.report({"INFO"}, text)
        return {"FINISHED"}
