# SPDX-License-Identifier: GPL-3.0-or-later
"""Make Levels of Detail."""

import bpy

from ..state import properties, result_record
from ..state.chosen import chosen
from ..tasks.adaptive_task import Level
from ..tasks.surfaces import ComputeError, shortest_decimal
from .adaptive_operator import MakingOperator
from .mesh_operators import Steps
from .place_results import as_levels
from .refusals import hidden_fault, refuse

MOST_LEVELS, LARGEST_STEP = 16, 1000.0


class CCDEPTH_OT_lods(properties.LevelProperties, MakingOperator):
    """Make levels of detail of the selected objects: adaptive meshes from the tolerance on, each coarser by the step,
    with the distance from which each is under a pixel. The objects are kept, and hidden"""

    bl_idname = "ccdepth.lods"
    bl_label = "Make Levels of Detail"
    not_in_edit_mode = "Works in Object Mode"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        step = shortest_decimal(self.step)
        if not 1 <= self.count <= MOST_LEVELS:
            raise ComputeError(f"There can be 1 to {MOST_LEVELS} levels of detail, not {self.count}")
        if not 1 < step <= LARGEST_STEP:
            raise ComputeError(f"The step must be more than 1, and at most {LARGEST_STEP:g}; it is {step:g}")
        objects = chosen(context)
        refuse(objects, self._fault)
        wanted = {Level(number, step): {each: each for each in objects} for number in range(self.count)}
        return (yield from self.make(context, wanted, as_levels))

    def _fault(self, blender_object: bpy.types.Object) -> str | None:
        if result_record.is_adaptive(blender_object):
            return "it was made by subdivision already; select the object it came from"
        return hidden_fault(blender_object) or self.making_fault(blender_object, blender_object)
