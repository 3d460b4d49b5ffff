# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel Make: settings of adaptive meshes, their number of faces, and the result."""

from typing import ClassVar

import bpy

from ..exchange.modifiers import has_own_keys
from ..state import known, out_of_date, result_record
from ..state.chosen import chosen
from .facts import angles_fact, count_fact, draw_facts, facts_of, made_objects, short_count
from .panels import draw_main_button, draw_object_rows, draw_state_line, result_line
from .sidebar import SidebarPanel, draw_alert, settings_column
from .variation import draw_variation


class CCDEPTH_PT_make(SidebarPanel, bpy.types.Panel):
    bl_label = "Make"
    bl_parent_id = "CCDEPTH_PT_settings"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        if any(each.data.ccdepth.has_result for each in made_objects(context)):
            self.layout.operator("ccdepth.clear", icon="X", emboss=False)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings, active = context.scene.ccdepth, context.active_object
        made = made_objects(context)
        results = [each for each in made if result_record.is_result(each)]
        if results:
            draw_main_button(layout, "ccdepth.update", "FILE_REFRESH")
            layout.operator("ccdepth.before_after", icon="LOOP_BACK")
        if len(made) == 1:
            _draw_made(layout, context, made[0])
        elif made:
            draw_object_rows(layout, made, lambda each: result_line(settings, each))
        if not results or settings.subdivide_results:
            draw_main_button(layout, "ccdepth.subdivide", "MOD_MULTIRES")
        if not results and active is not None and out_of_date.has_results(active):
            # At the same place as with the result shown, so that the mouse stays.
            layout.operator("ccdepth.before_after", icon="LOOP_FORWARDS")
            layout.operator("ccdepth.update", icon="FILE_REFRESH")
        _draw_face_count(layout, context)
        budget = layout.column(align=True)
        # What Reduce saves is known once it has run.
        budget.prop(settings, "face_budget", text="Before Reduce" if settings.reduce else "Budget")
        budget.operator("ccdepth.find_tolerance", icon="VIEWZOOM")
        column = settings_column(layout)
        output = column.column()
        output.active = not results or settings.subdivide_results
        output.prop(settings, "output")
        column.prop(settings, "shading_angle")
        column.prop(settings, "facet_angle")
        draw_variation(column, context)
        column.prop(settings, "reduce")
        _draw_keys_line(column, context)
        if made:
            column.prop(settings, "subdivide_results")


class CCDEPTH_PT_make_options(SidebarPanel, bpy.types.Panel):
    bl_label = "Options"
    bl_parent_id = "CCDEPTH_PT_make"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column, settings = settings_column(self.layout), context.scene.ccdepth
        # Triangles that are merged show nothing of how faces were divided.
        division = column.column()
        division.active = not settings.reduce
        division.prop(settings, "mode")
        # The shading angle stores them.
        normals = column.column()
        normals.active = settings.shading_angle == 0
        normals.prop(settings, "exact_normals")
        column.prop(settings, "max_faces")


def _draw_made(layout: bpy.types.UILayout, context: bpy.types.Context, made: bpy.types.Object) -> None:
    """The state of an adaptive mesh, its source, and its facts."""
    settings, source = context.scene.ccdepth, result_record.source_of(made)
    if result_record.is_result(made) and source is None:
        draw_state_line(layout, "Its source has been removed")
    else:
        draw_state_line(layout, result_line(settings, made))
    if source is not None:
        row = layout.row()
        row.label(text=source.name, icon="OUTLINER_OB_MESH")
        row.prop(made.ccdepth, "keep_updated")
    if made.data.has_custom_normals:
        layout.operator("ccdepth.remove_normals", icon="NORMALS_VERTEX_FACE")
    if made.data.ccdepth.has_result:
        draw_facts(layout, facts_of(context.scene, made.data.ccdepth))


def _draw_keys_line(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings, active = context.scene.ccdepth, context.active_object
    if not settings.reduce or active is None or active.type != "MESH":
        return
    if has_own_keys(active, use_modifiers=settings.use_modifiers):
        draw_alert(layout, "Reduce cannot keep shape keys")


def _draw_face_count(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings = context.scene.ccdepth
    count = known.count_to_make(chosen(context), settings)
    if count is None:
        layout.operator("ccdepth.count_faces", icon="LINENUMBERS_ON")
        return
    if not count.are_too_many:
        facts = [count_fact(count.faces, reduced=settings.reduce)]
        if count.by_distance is not None:
            facts.append(angles_fact(count.faces, count.by_distance))
        draw_facts(layout, facts)
        return
    # In one row, like the button before, so that nothing below moves.
    split = layout.split(factor=0.55, align=True)
    draw_alert(split, f"{short_count(count.faces)} faces")
    split.operator("ccdepth.find_tolerance", icon="VIEWZOOM").face_budget = settings.max_faces


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_make, CCDEPTH_PT_make_options))
