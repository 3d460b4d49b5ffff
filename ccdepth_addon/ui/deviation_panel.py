# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel about deviations: settings, and what was measured on the active object or against it."""

from __future__ import annotations

import bpy

from ..state import deviation_results, results, staleness
from ..state.properties import scene_tolerance
from ..tasks.surfaces import as_typed
from .facts import draw_facts, facts_of_measurement
from .panels import ORDER_OF_DEVIATION, draw_main_button, draw_selecting, draw_state_line
from .selected_results import selected_results
from .sidebar import SidebarPanel, settings_column

# How a verdict is shown: icon and text.
VERDICTS = {
    "MET": ("CHECKMARK", "Within the Tolerance"),
    "NOT_MET": ("CANCEL", "Not Within the Tolerance"),
    "UNDECIDED": ("QUESTION", "Not Decided"),
}


class CCDEPTH_PT_deviation(SidebarPanel, bpy.types.Panel):
    bl_label = "Deviation"
    bl_parent_id = "CCDEPTH_PT_settings"
    bl_order = ORDER_OF_DEVIATION

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ccdepth
        draw_main_button(layout, "ccdepth.measure", "DRIVER_DISTANCE")
        column = settings_column(layout)
        column.prop(settings, "accuracy")
        column.prop(settings, "time_limit")
        measured = deviation_results.shown_object(context) or context.active_object
        if measured is not None and measured.type == "MESH" and results.has_deviation(measured.data):
            _draw_measurement(layout, context, measured)


def _draw_measurement(layout: bpy.types.UILayout, context: bpy.types.Context, measured: bpy.types.Object) -> None:
    settings, mesh = context.scene.ccdepth, measured.data
    found = mesh.ccdepth.measurement
    box = layout.box().column()
    draw_state_line(box, stale_line(settings, mesh))
    icon, text = VERDICTS[found.verdict]
    row = box.row()
    row.alert = found.verdict == "NOT_MET"
    row.label(text=text, icon=icon)
    draw_facts(box, facts_of_measurement(context.scene, measured))
    if not found.accuracy_met:
        box.label(text="Accuracy not reached", icon="TIME")
    row = draw_selecting(layout, context, "ccdepth.select_worst", "FACESEL")
    row.operator("ccdepth.select_worst", text="", icon="ZOOM_SELECTED").frame = True
    # Where there are depths, the button is beside those.
    if not selected_results(context):
        layout.operator("ccdepth.clear", icon="X")


def stale_line(settings: bpy.types.PropertyGroup, mesh: bpy.types.Mesh) -> str:
    """Why the measurement is out of date; empty when it is not."""
    if staleness.is_deviation_stale(mesh):
        return "Out of date: objects changed"
    found = mesh.ccdepth.measurement
    current = (scene_tolerance(settings), settings.tolerance_mode, as_typed(settings.accuracy), settings.use_modifiers)
    measured = (as_typed(found.tolerance), found.tolerance_mode, as_typed(found.accuracy), found.use_modifiers)
    return "" if current == measured else "Out of date: settings changed"


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_deviation,))
