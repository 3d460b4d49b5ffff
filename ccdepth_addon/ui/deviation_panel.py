# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel Check: settings, and the measurement of the active object or against its limit surface."""

from __future__ import annotations

import bpy

from ..state import mesh_values, out_of_date
from ..state.chosen import chosen, to_measure
from ..state.properties import Settings, VariationProperties
from ..state.still_holds import UNCHECKED, is_own, measured_object, measured_to_show, target_of
from ..tasks.surfaces import ComputeError
from .facts import draw_facts, facts_of_measurement
from .panels import NOT_CHECKED, draw_main_button, draw_state_line
from .sidebar import SidebarPanel, closed_panel, settings_column

# The icon and the text of each verdict.
VERDICTS = {
    "MET": ("CHECKMARK", "Within"),
    "NOT_MET": ("CANCEL", "Beyond"),
    "UNDECIDED": ("QUESTION", "Not decided for"),
}


class CCDEPTH_PT_check(SidebarPanel, bpy.types.Panel):
    bl_label = "Check"
    bl_parent_id = "CCDEPTH_PT_settings"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        holder = _measured(context)
        if holder is None:
            return
        verdict, stale = holder.data.ccdepth.measurement.verdict, stale_line(context.scene.ccdepth, holder.data)
        icon = "ERROR" if stale else VERDICTS[verdict][0]
        row = self.layout.row()
        row.alert = icon in {"CANCEL", "ERROR"}
        # In a narrow panel a word would stand over the title.
        row.label(text="", icon=icon)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        draw_main_button(layout, "ccdepth.measure", "DRIVER_DISTANCE")
        measured = _measured(context)
        if measured is not None:
            _draw_measurement(layout, context, measured)
        else:
            _draw_pair(layout, *_plan(context))
        body = closed_panel(layout, "CCDEPTH_check_options", "Options")
        if body is not None:
            column = settings_column(body)
            column.prop(context.scene.ccdepth, "shown_accuracy")
            column.prop(context.scene.ccdepth, "time_limit")


def _measured(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object whose measurement the panel shows."""
    found = measured_to_show(context) or context.active_object
    return found if found is not None and found.type == "MESH" and mesh_values.has_deviation(found.data) else None


def _draw_pair(layout: bpy.types.UILayout, measured: str = "", against: str = "") -> None:
    """The measured object, unless it stands alone at the top of the tab, and the object with the limit surface, unless
    that is the same; in two lines, as names may be long."""
    column = layout.column(align=True)
    if measured and [each.name for each in chosen(bpy.context)] != [measured]:
        column.label(text=measured, icon="OBJECT_DATA", translate=False)
    if against:
        column.label(text=f"Against {against}", icon="OUTLINER_OB_MESH", translate=False)


def _plan(context: bpy.types.Context) -> tuple[str, ...]:
    """The measured objects and the object with the limit surface, as texts; none where Measure Deviation would
    refuse."""
    try:
        wanted = to_measure(context) if chosen(context) else {}
    except ComputeError:
        return ()
    measured = [each for group in wanted.values() for each in group]
    if not measured:
        return ()
    what = measured[0].name if len(measured) == 1 else f"{len(measured):,} objects"
    if len(wanted) > 1:
        return what, "their sources"
    [target] = wanted
    return (what,) if [target] == measured else (what, target.name)


def _pair(measured: bpy.types.Object) -> tuple[str, ...]:
    """The texts of a measurement that was made."""
    holder, target = measured_object(measured).name, target_of(measured)
    if is_own(measured.data):
        return (holder,)
    return holder, measured.data.ccdepth.measurement.against if target is None else target.name


def _draw_measurement(layout: bpy.types.UILayout, context: bpy.types.Context, measured: bpy.types.Object) -> None:
    settings, mesh = context.scene.ccdepth, measured.data
    found = mesh.ccdepth.measurement
    _draw_pair(layout, *_pair(measured))
    tolerance, facts = facts_of_measurement(context.scene, mesh.ccdepth)
    if stale := stale_line(settings, mesh):
        draw_state_line(layout, stale)
    else:
        icon, text = VERDICTS[found.verdict]
        verdict = layout.row()
        verdict.alert = icon == "CANCEL"
        verdict.label(text=f"{text} {tolerance}", icon=icon)
    draw_facts(layout, facts)
    if not found.accuracy_met:
        layout.label(text="Accuracy not reached", icon="TIME")
    row = layout.row(align=True)
    row.operator("ccdepth.select_worst", icon="FACESEL")
    row.operator("ccdepth.select_worst", text="", icon="ZOOM_SELECTED").frame = True


def stale_line(settings: bpy.types.PropertyGroup, mesh: bpy.types.Mesh) -> str:
    """The reason why the measurement is out of date; empty where the measurement holds."""
    if change := out_of_date.noted(mesh).change:
        return NOT_CHECKED if change == UNCHECKED else f"Out of date: {change}"
    found, names = mesh.ccdepth.measurement, ["accuracy", "tolerance_by"]
    if found.tolerance_by == "VERTEX_GROUP":
        names += VariationProperties.__annotations__
    is_same = Settings.of(settings, names) == Settings.of(found, names)
    return "" if is_same else "Out of date: settings changed"


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_check,))
