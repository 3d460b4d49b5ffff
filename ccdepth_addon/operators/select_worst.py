# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Select Worst Face."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.props import BoolProperty

from ..exchange.mesh_arrays import mesh_face_count
from ..state import mesh_values
from ..state.chosen import chosen
from ..state.still_holds import measured_to_show
from ..tasks.surfaces import ComputeError
from ..ui.printable import printable
from . import face_selection
from .selected_meshes import QuickOperator, refuse


class CCDEPTH_OT_select_worst(QuickOperator):
    """Select the face with the largest deviation in the measurement shown"""

    bl_idname = "ccdepth.select_worst"
    bl_label = "Select Worst Face"

    # Without SKIP_SAVE the plain button would frame as well, once the one beside was pressed.
    frame: BoolProperty(name="Frame", description="Move the 3D View to the face", default=False, options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{cls.__doc__}, and move the 3D View to the face" if properties.frame else ""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        return None if _measured_objects(context) else "Measure Deviation first"

    def act(self, context: bpy.types.Context) -> set[str]:
        worst = _worst(context)
        mesh, found = worst.data, worst.data.ccdepth.measurement
        if self.frame:
            _frame(context, worst)
        if found.worst_face < 0:
            self.report(
                {"WARNING"},
                f"{printable(worst.name)}: the largest deviation is on a face that modifiers added",
            )
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        if mesh_face_count(mesh) != found.faces:
            raise ComputeError(f"{worst.name}: the mesh has changed; measure it again")
        refuse([mesh], face_selection.selection_fault)
        if not face_selection.select_these(mesh, np.array([found.worst_face])):
            self.report({"WARNING"}, f"{printable(worst.name)}: the face with the largest deviation is hidden")
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        face_selection.choose_face_mode(context)
        self.report({"INFO"}, f"{printable(worst.name)}: face {found.worst_face} selected")
        return {"FINISHED"}


def _measured_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if mesh_values.has_deviation(each.data)]


def _worst(context: bpy.types.Context) -> bpy.types.Object:
    """The object whose deviation panel and label show; without one, the worst."""
    measured, shown = _measured_objects(context), measured_to_show(context)
    if shown is not None and shown in measured:
        return shown
    return max(measured, key=lambda each: each.data.ccdepth.deviation_reached)


def _frame(context: bpy.types.Context, worst: bpy.types.Object) -> None:
    """Move the operator's 3D View, or else all 3D Views, to the worst place of an object."""
    for region in _regions(context):
        region.view_location = worst.data.ccdepth.measurement.worst_point
        if region.view_perspective == "CAMERA":
            region.view_perspective = "PERSP"


def _regions(context: bpy.types.Context) -> list[bpy.types.RegionView3D]:
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        return [space.region_3d]
    screens = [window.screen for window in context.window_manager.windows]
    return [area.spaces.active.region_3d for screen in screens for area in screen.areas if area.type == "VIEW_3D"]
