# SPDX-License-Identifier: GPL-3.0-or-later
"""Update Result, at the press of its button or after an edit of a source."""

from collections.abc import Collection
from typing import ClassVar

import bpy

from ..exchange.evaluated import is_placed
from ..exchange.modifiers import sculpted
from ..state import out_of_date, result_record
from ..state.chosen import chosen
from ..state.properties import Settings
from ..tasks.adaptive_task import Level
from ..tasks.surfaces import NOT_PLACED, ComputeError
from ..ui.lengths import printable_lines
from .adaptive_operator import MakingOperator, making_fault
from .mesh_operators import NAVIGATION_EVENTS, Steps
from .place_results import in_results
from .refusals import LINKED, refuse

NO_SIZE = f"{NOT_PLACED}, so its size in the scene is not known; show it first"


class UpdatingOperator(MakingOperator):
    """An operator that makes results anew from their sources."""

    def updated(self, context: bpy.types.Context, chosen: list[bpy.types.Object]) -> Steps[set[str]]:
        """Make results anew, together with the results of known scale that share their meshes. Raises ComputeError."""
        shared = {result.data for result in chosen}
        sharing = [each for each in bpy.data.objects if each.data in shared and result_record.is_result(each)]
        layer = context.view_layer
        results = list(dict.fromkeys([*chosen, *(each for each in sharing if is_placed(layer, each))]))
        refuse(chosen, lambda each: None if is_placed(layer, each) else NO_SIZE)
        refuse(results, lambda each: self._fault(each, results))
        wanted: dict[Level, dict[bpy.types.Object, bpy.types.Object]] = {}
        for each in results:
            wanted.setdefault(result_record.level_of(each), {})[each] = result_record.control_object(each)
        return (yield from self.make(context, wanted, in_results))

    def _fault(self, result: bpy.types.Object, together: Collection[bpy.types.Object]) -> str | None:
        if not result.is_editable:
            return LINKED
        if result.override_library is not None:
            return "the object is a library override; make it local first"
        if sculpted(result):
            return "the sculpting of its Multiresolution modifier would be lost; apply or remove the modifier first"
        source = result_record.control_object(result)
        return _source_fault(result, together, self.use_modifiers) or making_fault(result, source, self)


class CCDEPTH_OT_update(UpdatingOperator):
    """Make the selected results of Apply Adaptive Subdivision anew from their sources, with the present settings.
    Everything but the mesh stays as it is"""

    bl_idname = "ccdepth.update"
    bl_label = "Update Result"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        selected = chosen(context)
        results = [each for each in selected if result_record.is_result(each)]
        if any(map(result_record.source_of, results)) or any(map(out_of_date.has_results, selected)):
            return None
        if results:
            return "The source of the result has been removed"
        return "Select a result of Apply Adaptive Subdivision, or the object it came from"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        """Make the selected results anew, levels of detail with all of their set, and the results of other selected
        objects."""
        selected = chosen(context)
        results = [
            each for one in selected if result_record.is_result(one) for each in result_record.levels_beside(one)
        ]
        of_sources = [
            result
            for each in selected
            if out_of_date.has_results(each) and not result_record.is_result(each)
            for result in result_record.results_of(each)
            if is_placed(context.view_layer, result)
        ]
        if not results and not of_sources:
            raise ComputeError(f"{selected[0].name}: none of its results is shown here, not even hidden by the eye")
        return (yield from self.updated(context, list(dict.fromkeys([*results, *of_sources]))))


class CCDEPTH_OT_update_kept(UpdatingOperator):
    """Make results with Keep Updated anew after edits of their sources, with the settings of each result"""

    bl_idname = "ccdepth.update_kept"
    bl_label = "Keep Updated"
    bl_options: ClassVar[set[str]] = {"UNDO", "INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and bool(_due_in(context))

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        """Make one result after the other anew."""
        due = _due_in(context)
        # Whatever comes of it, the next try follows only the next edit of a source.
        out_of_date.none_due()
        status = {"CANCELLED"}
        for each in due:
            # It may have been edited meanwhile.
            if not result_record.is_edited(each):
                for name, value in Settings.of(each.ccdepth, result_record.SETTINGS).values.items():
                    setattr(self, name, value)
                status = yield from self.updated(context, [each])
        return status

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.value == "PRESS" and event.type not in {"ESC", *NAVIGATION_EVENTS}:
            # Someone goes on working, and comes first: the results stay out of date.
            self.cancel(context)
            return {"CANCELLED", "PASS_THROUGH"}
        status = super().modal(context, event)
        return {"PASS_THROUGH"} if status == {"RUNNING_MODAL"} else status

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        """Report a refusal without a message in the way, as nobody has pressed a button."""
        self._end()
        self.report({"WARNING"}, f"Not kept updated: {printable_lines(str(fault))}")
        return {"CANCELLED"}


def _source_fault(result: bpy.types.Object, together: Collection[bpy.types.Object], use_modifiers: bool) -> str | None:
    """The reason why a result cannot be made anew from its source, or None. together: all results made anew."""
    source = result_record.source_of(result)
    if source is None:
        return "its source has been removed from the file"
    called = f"its source “{source.name}”"
    if source.type != "MESH":
        return f"{called} is not a mesh any more"
    if source.data == result.data:
        return f"{called} has the same mesh; make that mesh a single-user one first"
    if source in together:
        return f"{called} is a result as well; update the source first, and then this result"
    if source.data.ccdepth.subdivision and not result.ccdepth.source_is_adaptive:
        return f"{called} was subdivided in place since; undo that, or apply anew with Subdivide Results on"
    return result_record.modifier_fault(result, source, use_modifiers=use_modifiers)


def _due_in(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The results in the view layer to be made anew after edits of their sources."""
    present = {*context.view_layer.objects}
    return [each for each in out_of_date.due_results() if each.is_editable and each in present]


def start_keeping_updated() -> None:
    """Make due results anew in the first window with any of them in its view layer; while other work goes on there they
    stay out of date."""
    manager = bpy.context.window_manager
    is_due = bool(out_of_date.due_results()) and not bpy.app.background
    for window in manager.windows if manager and is_due else ():
        area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
        region = next((region for region in area.regions if region.type == "WINDOW"), None) if area else None
        with bpy.context.temp_override(window=window, area=area, region=region):
            is_free = not window.modal_operators and not bpy.app.is_job_running("RENDER")
            if is_free and bpy.ops.ccdepth.update_kept.poll():
                bpy.ops.ccdepth.update_kept("INVOKE_DEFAULT", True)
                break
    if is_due:
        out_of_date.none_due()
