# SPDX-License-Identifier: GPL-3.0-or-later
"""Update Result, at the press of its button or because a source was edited."""

from collections.abc import Collection
from typing import ClassVar

import bpy

from ..state import out_of_date, result_record, watch
from ..tasks.surfaces import ComputeError
from ..ui.printable import printable, printable_lines
from .adaptive_operator import MakingOperator
from .long_operator import NAVIGATION_EVENTS
from .place_results import NewMesh, place_in_results
from .selected_meshes import LINKED, refuse, selected_meshes

# While one of these runs, results that are kept updated wait: their names begin so.
OPERATORS_WAITED_FOR = ("CCDEPTH_OT_", "TRANSFORM_OT_")

NOT_EVALUATED = "it is in no shown collection of this view layer, so its size in the scene is not known; show it first"


class UpdatingOperator(MakingOperator):
    """An operator that makes results anew from the objects they came from."""

    def source(self, blender_object: bpy.types.Object) -> bpy.types.Object:
        source = result_record.source_of(blender_object)
        assert source is not None
        return source

    def fault(self, blender_object: bpy.types.Object) -> str | None:
        if not blender_object.is_editable:
            return LINKED
        if blender_object.override_library is not None:
            return "the object is a library override; make it local first"
        return _source_fault(blender_object, self._results, self.use_modifiers) or super().fault(blender_object)

    def objects(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The results to make anew, and with them those that share their meshes where their scale is known."""
        chosen = self.chosen(context)
        shared = {result.data for result in chosen}
        sharing = [each for each in bpy.data.objects if each.data in shared and result_record.is_result(each)]
        depsgraph = context.evaluated_depsgraph_get()
        self._results = list(dict.fromkeys([*chosen, *(each for each in sharing if _is_evaluated(each, depsgraph))]))
        refuse(chosen, lambda each: None if _is_evaluated(each, depsgraph) else NOT_EVALUATED)
        return self._results

    def chosen(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        raise NotImplementedError

    def progress_text(self, progress: float) -> str:
        return f"Updating: {progress:,.0f} faces so far"

    def finish(self, context: bpy.types.Context, answer: list[NewMesh]) -> set[str]:
        notes = place_in_results(context, answer, result_record.made_with(self, self.tolerance))
        for note in notes:
            self.report({"WARNING"}, printable(note))
        self.report_made(answer, self._results)
        return {"FINISHED"}

    def leave(self, context: bpy.types.Context) -> None:
        super().leave(context)
        # Blender keeps operators that have run.
        self._results = []


class CCDEPTH_OT_update(UpdatingOperator):
    """Make the selected results of Apply Adaptive Subdivision anew from their sources, with the present settings.
    Everything but the mesh stays as it is"""

    bl_idname = "ccdepth.update"
    bl_label = "Update Result"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        if any(result_record.is_result(each) or out_of_date.has_results(each) for each in selected_meshes(context)):
            return None
        return "Select a result of Apply Adaptive Subdivision, or the object it came from"

    def chosen(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        """The selected results, and those of other selected objects."""
        selected = selected_meshes(context)
        results = [each for each in selected if result_record.is_result(each)]
        of_sources = [
            result
            for each in selected
            if out_of_date.has_results(each) and not result_record.is_result(each)
            for result in result_record.results_of(each)
            if _is_evaluated(result, context.evaluated_depsgraph_get())
        ]
        if not results and not of_sources:
            raise ComputeError(f"{selected[0].name}: none of its results is shown here, not even hidden by the eye")
        return list(dict.fromkeys([*results, *of_sources]))


class CCDEPTH_OT_update_kept(UpdatingOperator):
    """Make results with Keep Updated anew after edits of their sources, with the settings of each result"""

    bl_idname = "ccdepth.update_kept"
    bl_label = "Keep Updated"
    bl_options: ClassVar[set[str]] = {"UNDO", "INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and bool(_due_in(context))

    def _begin(self, context: bpy.types.Context, seconds: float) -> set[str] | None:
        """Take up those that were made with the same settings as the first; the others have their turn."""
        first, *others = _due_in(context)
        record = first.ccdepth
        settings = result_record.made_with(record, record.tolerance)
        alike = [each for each in others if result_record.made_with(each.ccdepth, each.ccdepth.tolerance) == settings]
        self._chosen = [first, *alike]
        # Whatever comes of it, it is not tried again before the source is edited again.
        out_of_date.no_longer_due(self._chosen)
        for name, value in settings.items():
            setattr(self, name, value)
        return super()._begin(context, seconds)

    def chosen(self, context: bpy.types.Context) -> list[bpy.types.Object]:
        return self._chosen

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.value == "PRESS" and event.type not in {"ESC", *NAVIGATION_EVENTS}:
            # Someone goes on working, and comes first.
            waiting = self._chosen
            self.cancel(context)
            out_of_date.due_again(waiting)
            return {"CANCELLED", "PASS_THROUGH"}
        status = super().modal(context, event)
        return {"PASS_THROUGH"} if status == {"RUNNING_MODAL"} else status

    def leave(self, context: bpy.types.Context) -> None:
        super().leave(context)
        self._chosen = []
        # Results with other settings have their turn.
        watch.examine_soon()

    def _refuse(self, context: bpy.types.Context, fault: ComputeError) -> set[str]:
        """Without a message in the way: nobody has pressed a button."""
        self._end(context)
        self.report({"WARNING"}, f"Not kept updated: {printable_lines(str(fault))}")
        return {"CANCELLED"}


def _source_fault(result: bpy.types.Object, together: Collection[bpy.types.Object], use_modifiers: bool) -> str | None:
    """Why a result cannot be made anew from its source. together: all those that are made anew."""
    source = result_record.source_of(result)
    called = f"its source “{result.ccdepth.source_name if source is None else source.name}”"
    if source is None:
        return f"{called} has been removed from the file"
    if source.type != "MESH":
        return f"{called} is not a mesh any more"
    if source.data == result.data:
        return f"{called} has the same mesh; make that mesh a single-user one first"
    if source in together:
        return f"{called} is a result as well; update the source first, and then this result"
    if source.data.ccdepth.subdivision and not result.ccdepth.source_is_adaptive:
        return f"{called} was subdivided in place since; undo that, or apply anew with Subdivide Results on"
    return result_record.modifier_fault(result, source, use_modifiers=use_modifiers)


def _is_evaluated(blender_object: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> bool:
    """Whether Blender knows where the object is in the scene; also of objects hidden in the view layer."""
    return bool(blender_object.evaluated_get(depsgraph).is_evaluated)


def _due_in(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The results in the view layer that are to be made anew because their sources were edited."""
    present = context.view_layer.objects
    return [each for each in out_of_date.due_results() if each.is_editable and present.get(each.name) == each]


def start_keeping_updated() -> None:
    """Make what is due anew, in the first window whose view layer has any of it; called while Blender is idle."""
    manager = bpy.context.window_manager
    for window in manager.windows if manager and not bpy.app.background else ():
        if any(each.bl_idname.startswith(OPERATORS_WAITED_FOR) for each in window.modal_operators):
            watch.examine_soon()
            return
        area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
        region = next((region for region in area.regions if region.type == "WINDOW"), None) if area else None
        with bpy.context.temp_override(window=window, area=area, region=region):
            if bpy.ops.ccdepth.update_kept.poll():
                bpy.ops.ccdepth.update_kept("INVOKE_DEFAULT", True)
                return
