# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel about adaptive subdivision: settings, and how many faces the adaptive mesh of the active object
would have."""

import bpy
import numpy as np

from ..exchange.control_mesh import has_own_keys
from ..state import result_record, sources
from ..state.face_counts import known_count
from ..state.properties import tolerance_name
from ..tasks.adaptive_task import adaptive_settings
from .lengths import length_text
from .panels import draw_rows, sidebar_count, stale_line


class CCDEPTH_PT_subdivision(bpy.types.Panel):
    bl_label = "Adaptive Subdivision"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CC Depth"
    bl_parent_id = "CCDEPTH_PT_settings"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings, active = context.scene.ccdepth, context.active_object
        is_result = active is not None and result_record.is_result(active)
        if is_result:
            _draw_result(layout, settings, active)
        if not is_result or settings.subdivide_results:
            _draw_button(layout, "ccdepth.subdivide", "MOD_MULTIRES")
        if active is not None and sources.has_results(active):
            row = layout.row(align=True)
            row.operator("ccdepth.update", icon="FILE_REFRESH")
            row.operator("ccdepth.show_result", icon="HIDE_OFF")
        _draw_face_count(layout, context)
        row = layout.row(align=True)
        row.prop(settings, "face_budget")
        row.operator("ccdepth.find_tolerance", icon="VIEWZOOM")
        layout.use_property_split = True
        layout.use_property_decorate = False
        column = layout.column()
        column.prop(settings, "reduce")
        _draw_keys_line(column, context)
        # Triangles that are merged show nothing of how faces were divided.
        division = column.column()
        division.active = not settings.reduce
        division.prop(settings, "mode")
        division.prop(settings, "transitions")
        output = column.column()
        output.active = not is_result or settings.subdivide_results
        output.prop(settings, "output")
        column.prop(settings, "exact_normals")
        column.prop(settings, "max_faces")
        if active is not None and active.type == "MESH" and result_record.is_adaptive(active):
            column.prop(settings, "subdivide_results")


def _draw_button(layout: bpy.types.UILayout, operator: str, icon: str) -> None:
    button = layout.column()
    button.scale_y = 1.4
    button.operator(operator, icon=icon)


def _draw_result(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, result: bpy.types.Object) -> None:
    """What can be done with a result, whether there is a need to, and where it came from."""
    _draw_button(layout, "ccdepth.update", "FILE_REFRESH")
    line = stale_line(settings, result.data, result)
    row = layout.row()
    row.alert = bool(line)
    source = result_record.source_of(result)
    if source is None:
        row.alert = True
        row.label(text=f"“{result.ccdepth.source_name}” has been removed", icon="ERROR")
        return
    row.label(text=line or "Up to date", icon="ERROR" if line else "CHECKMARK")
    row = layout.row()
    row.label(text=source.name, icon="OUTLINER_OB_MESH")
    row.operator("ccdepth.show_source", icon="HIDE_OFF")
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    column.prop(result.ccdepth, "keep_updated")


def _draw_keys_line(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings, active = context.scene.ccdepth, context.active_object
    if not settings.reduce or active is None or active.type != "MESH":
        return
    if has_own_keys(active, use_modifiers=settings.use_modifiers):
        row = layout.row()
        row.alert = True
        row.label(text="Reduce cannot keep shape keys", icon="ERROR")


def _draw_face_count(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings, active = context.scene.ccdepth, context.active_object
    tolerance = getattr(settings, tolerance_name(settings.tolerance_mode))
    current = adaptive_settings(settings, tolerance)
    count = None if active is None else known_count(active, current)
    if count is None:
        layout.operator("ccdepth.count_faces", icon="FACESEL")
        return
    if count.fitting is None:
        draw_rows(layout, [("Before Reduce" if settings.reduce else "Faces to Make", f"{count.faces:,}")])
        return
    # In one row, like the button that was there: nothing below it moves.
    split = layout.split(factor=0.55, align=True)
    number = split.row()
    number.alert = True
    number.label(text=f"{sidebar_count(count.faces)} faces", icon="ERROR")
    if not np.isfinite(count.fitting):
        split.label(text="No tolerance fits")
        return
    relative = settings.tolerance_mode == "RELATIVE"
    fitting = f"{count.fitting:.2g}" if relative else length_text(context.scene, count.fitting)
    split.operator("ccdepth.use_tolerance", text=f"Use {fitting}").tolerance = count.fitting


def register() -> None:
    bpy.utils.register_class(CCDEPTH_PT_subdivision)


def unregister() -> None:
    bpy.utils.unregister_class(CCDEPTH_PT_subdivision)
