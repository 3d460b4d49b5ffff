# SPDX-License-Identifier: GPL-3.0-or-later
"""Before / After: sources shown in place of their results, or the other way round."""

import bpy

from ..state import out_of_date, result_record
from ..state.chosen import chosen
from ..tasks.surfaces import ComputeError
from ..ui.lengths import count_text
from .mesh_operators import QuickOperator
from .refusals import refuse
from .scene_objects import can_be_shown, hide, show


class CCDEPTH_OT_before_after(QuickOperator):
    """Show the sources of the selected results of Apply Adaptive Subdivision in place of the results; or of selected
    sources, the results"""

    bl_idname = "ccdepth.before_after"
    bl_label = "Before / After"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Works in Object Mode")
            return False
        if not _to_hide(context):
            cls.poll_message_set("Select a result of Apply Adaptive Subdivision, or the object it came from")
            return False
        return True

    def act(self, context: bpy.types.Context) -> set[str]:
        hidden, active = _to_hide(context), context.view_layer.objects.active
        counterparts = {each: _counterparts(each) for each in hidden}
        shown = list(dict.fromkeys(other for others in counterparts.values() for other in others))
        refuse(shown, lambda each: _showing_fault(context, each))
        for each in shown:
            results = [each] if result_record.is_result(each) else result_record.results_of(each)
            show(each, results)
            each.select_set(True)
        for each in hidden:
            if each not in shown:
                hide(each, each if result_record.is_result(each) else counterparts[each][0])
        context.view_layer.objects.active = counterparts[active][0] if active in counterparts else shown[0]
        if len(shown) > 1:
            self.report({"INFO"}, count_text(len(shown), "object", "objects"))
        return {"FINISHED"}


def _to_hide(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected results, or without any the selected sources of results."""
    selected = chosen(context)
    results = [each for each in selected if result_record.is_result(each)]
    return results or [each for each in selected if out_of_date.has_results(each)]


def _counterparts(blender_object: bpy.types.Object) -> list[bpy.types.Object]:
    """The source of a result; for any other object, its finest results in scenes. Raises ComputeError without any."""
    if not result_record.is_result(blender_object):
        results = [each for each in result_record.results_of(blender_object) if each.users_scene]
        if not results:
            raise ComputeError(f"{blender_object.name}: its results have been removed")
        return list(dict.fromkeys(result_record.levels_beside(each)[0] for each in results))
    source = result_record.source_of(blender_object)
    if source is None:
        raise ComputeError(f"{blender_object.name}: its source has been removed from the file")
    return [source]


def _showing_fault(context: bpy.types.Context, blender_object: bpy.types.Object) -> str | None:
    """The reason why an object cannot be shown in the view layer, or None."""
    if blender_object not in {*context.view_layer.objects}:
        return "it is not in this view layer"
    if not can_be_shown(blender_object):
        return "it is in a hidden collection, outside the local view, or disabled in viewports; show that first"
    return None
