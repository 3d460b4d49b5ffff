# SPDX-License-Identifier: GPL-3.0-or-later
"""Show Source and Show Result: one hidden, the other shown in its stead."""

from typing import ClassVar

import bpy

from ..state import result_record, sources
from ..tasks.surfaces import ComputeError
from .quick_operator import QuickOperator
from .scene_objects import hide, link_beside, show_in_local_view
from .selected_meshes import count_text, refuse, selected_meshes


class _SwappingOperator(QuickOperator):
    """Hides selected objects, and shows and selects what belongs to them."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if context.mode != "OBJECT":
            cls.poll_message_set("Works in Object Mode")
            return False
        if not any(cls.has_counterparts(each) for each in selected_meshes(context)):
            cls.poll_message_set(cls.NOTHING_TO_SWAP)
            return False
        return True

    def act(self, context: bpy.types.Context) -> set[str]:
        active = context.view_layer.objects.active
        hidden = [each for each in selected_meshes(context) if self.has_counterparts(each)]
        swapped = {each: self.counterparts(each) for each in hidden}
        shown = list(dict.fromkeys(other for others in swapped.values() for other in others))
        _swap(context, hidden, shown)
        context.view_layer.objects.active = swapped[active][0] if active in swapped else shown[0]
        if len(shown) > 1:
            self.report({"INFO"}, count_text(len(shown), "object", "objects"))
        return {"FINISHED"}


def _source(result: bpy.types.Object) -> list[bpy.types.Object]:
    """What a result came from. Raises ComputeError when it is no longer in the file."""
    source = result_record.source_of(result)
    if source is None:
        name = result.ccdepth.source_name
        raise ComputeError(f"{result.name}: “{name}”, which it came from, has been removed from the file")
    return [source]


def _results(source: bpy.types.Object) -> list[bpy.types.Object]:
    """What came from an object. Raises ComputeError when nothing of that is in a scene any more."""
    results = [each for each in result_record.results_of(source) if each.users_scene]
    if not results:
        raise ComputeError(f"{source.name}: its results have been removed")
    return results


class CCDEPTH_OT_show_source(_SwappingOperator):
    """Hide the selected results of Apply Adaptive Subdivision, and show and select the objects they came from"""

    bl_idname = "ccdepth.show_source"
    bl_label = "Show Source"
    NOTHING_TO_SWAP = "Select a result of Apply Adaptive Subdivision"
    has_counterparts = staticmethod(result_record.is_result)
    counterparts = staticmethod(_source)


class CCDEPTH_OT_show_result(_SwappingOperator):
    """Hide the selected objects, and show and select the results of Apply Adaptive Subdivision that came from them"""

    bl_idname = "ccdepth.show_result"
    bl_label = "Show Result"
    NOTHING_TO_SWAP = "Select an object that results of Apply Adaptive Subdivision came from"
    has_counterparts = staticmethod(sources.has_results)
    counterparts = staticmethod(_results)


def _swap(context: bpy.types.Context, hidden: list[bpy.types.Object], shown: list[bpy.types.Object]) -> None:
    """Hide some objects, from the render as well, and show and select others. Raises ComputeError, with nothing
    changed, when one of these cannot be shown."""
    layer = context.view_layer
    for each in shown:
        if not each.users_scene and each.library is None:
            # It was deleted, and is in the file because its result needs it.
            link_beside(context, hidden[0], each)
    layer.update()
    refuse(shown, lambda each: _showing_fault(context, each))
    for each in shown:
        each.hide_set(False)
        each.hide_render = False
        show_in_local_view(context, each)
    for each in shown:
        each.select_set(True)
    for each in hidden:
        if each not in shown:
            hide(each)


def _showing_fault(context: bpy.types.Context, blender_object: bpy.types.Object) -> str | None:
    """Why an object cannot be shown in the view layer."""
    if context.view_layer.objects.get(blender_object.name) != blender_object:
        scenes = [scene.name for scene in blender_object.users_scene if scene != context.scene]
        where = f"is in the scene “{scenes[0]}”" if scenes else "is not in this view layer"
        return f"it {where}, and cannot be shown here"
    was_hidden = blender_object.hide_get()
    blender_object.hide_set(False)
    is_shown = blender_object.visible_get()
    blender_object.hide_set(was_hidden)
    return None if is_shown else "it is in a hidden collection, or disabled in viewports; show that first"
