# SPDX-License-Identifier: GPL-3.0-or-later
"""Before / After: sources shown in place of their results, or the other way round."""

import bpy

from ..state import out_of_date, result_record
from ..state.chosen import chosen
from ..tasks.surfaces import ComputeError
from .scene_objects import can_be_shown, hide, in_local_view, link_beside, show, show_in_local_view
from .selected_meshes import QuickOperator, count_text, refuse

# Objects to be hidden, each with the objects to be shown in its place.
Swapped = dict[bpy.types.Object, list[bpy.types.Object]]


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
        if not _to_hide(context) and not _left_hidden(context):
            cls.poll_message_set("Select a result of Apply Adaptive Subdivision, or the object it came from")
            return False
        return True

    def act(self, context: bpy.types.Context) -> set[str]:
        hidden, active = _to_hide(context), context.view_layer.objects.active
        swapped = {each: _counterparts(each) for each in hidden}
        shown = list(dict.fromkeys(other for others in swapped.values() for other in others))
        shown = shown if hidden else _left_hidden(context)
        _swap(context, swapped, shown)
        context.view_layer.objects.active = swapped[active][0] if active in swapped else shown[0]
        if len(shown) > 1:
            self.report({"INFO"}, count_text(len(shown), "object", "objects"))
        return {"FINISHED"}


def _to_hide(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected results, or without any the selected sources of results."""
    selected = chosen(context)
    results = [each for each in selected if result_record.is_result(each)]
    return results or [each for each in selected if out_of_date.has_results(each)]


def _left_hidden(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The hidden results of deleted sources, where no mesh is selected."""
    return [] if chosen(context) else result_record.left_hidden(context)


def _counterparts(blender_object: bpy.types.Object) -> list[bpy.types.Object]:
    """The source of a result; for any other object, its results in scenes. Raises ComputeError if none is left."""
    if not result_record.is_result(blender_object):
        results = [each for each in result_record.results_of(blender_object) if each.users_scene]
        if not results:
            raise ComputeError(f"{blender_object.name}: its results have been removed")
        return results
    source = result_record.source_of(blender_object)
    if source is None:
        raise ComputeError(f"{blender_object.name}: its source has been removed from the file")
    return [source]


def _swap(context: bpy.types.Context, swapped: Swapped, shown: list[bpy.types.Object]) -> None:
    """Hide some objects, from the render as well, and show and select others. Raises ComputeError, with nothing
    changed, when one of these cannot be shown."""
    layer, hidden = context.view_layer, list(swapped)
    for each in shown:
        if not each.users_scene and each.library is None:
            # The object was deleted, and is in the file only because its result needs it.
            link_beside(context, hidden[0], each)
    layer.update()
    refuse(shown, lambda each: _showing_fault(context, each))
    for each in shown:
        show(each)
        show_in_local_view(context, each)
    for each in shown:
        each.select_set(True)
    for each in hidden:
        if each not in shown:
            hide(each)


def _showing_fault(context: bpy.types.Context, blender_object: bpy.types.Object) -> str | None:
    """The reason why an object cannot be shown in the view layer, or None."""
    if context.view_layer.objects.get(blender_object.name) != blender_object:
        scenes = [scene.name for scene in blender_object.users_scene if scene != context.scene]
        where = f"is in the scene “{scenes[0]}”" if scenes else "is not in this view layer"
        return f"it {where}, and cannot be shown here"
    with in_local_view(context, blender_object):
        if can_be_shown(blender_object):
            return None
    return "it is in a hidden collection, or disabled in viewports; show that first"
