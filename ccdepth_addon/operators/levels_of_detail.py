# SPDX-License-Identifier: GPL-3.0-or-later
"""Make Levels of Detail."""

from collections.abc import Sequence
from typing import Any

import bpy

from ..state import properties, result_record
from ..state.chosen import chosen
from ..tasks.adaptive_task import Level
from ..tasks.surfaces import ComputeError, shortest_decimal
from .adaptive_operator import MakingOperator, Wanted, making_fault
from .mesh_operators import Steps
from .place_results import as_levels
from .refusals import hidden_fault, refuse

MOST_LEVELS, LARGEST_STEP = 16, 1000.0


class CCDEPTH_OT_lods(properties.LevelProperties, MakingOperator):
    """Make levels of detail of the selected objects: adaptive meshes from the tolerance on, each coarser by the step,
    with the distance from which each is under a pixel. The finest is shown; the objects are kept, and hidden"""

    bl_idname = "ccdepth.lods"
    bl_label = "Make Levels of Detail"
    not_in_edit_mode = "Works in Object Mode"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        return (yield from self.make(context, wanted_levels(chosen(context), self), as_levels))


def wanted_levels(objects: Sequence[bpy.types.Object], holder: Any) -> Wanted:
    """The levels of detail to make of objects, by the settings of an operator or a scene. Raises ComputeError, naming
    every object that cannot have any."""
    step = shortest_decimal(holder.step)
    if not 1 <= holder.count <= MOST_LEVELS:
        raise ComputeError(f"There can be 1 to {MOST_LEVELS} levels of detail, not {holder.count}")
    if not 1 < step <= LARGEST_STEP:
        raise ComputeError(f"The step must be more than 1, and at most {LARGEST_STEP:g}; it is {step:g}")
    refuse(objects, lambda each: _fault(each, holder))
    return {Level(number, step): {each: each for each in objects} for number in range(holder.count)}


def _fault(blender_object: bpy.types.Object, holder: Any) -> str | None:
    if result_record.is_adaptive(blender_object):
        return "it was made by subdivision already; select the object it came from"
    return hidden_fault(blender_object) or making_fault(blender_object, blender_object, holder)
