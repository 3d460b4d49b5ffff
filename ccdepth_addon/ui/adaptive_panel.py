# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel Make: settings of adaptive meshes, their number of faces, and the result."""

from typing import ClassVar

import bpy

from ..exchange.modifiers import counted_modifiers
from ..state import known, out_of_date, result_record
from ..state.chosen import chosen
from .facts import angles_fact, count_fact, counts_of, draw_facts, facts_of, made_objects, short_count
from .panels import UP_TO_DATE, draw_main_button, draw_object_rows, draw_state_line, result_line
from .sidebar import SidebarPanel, draw_alert, draw_button, settings_column
from .variation import draw_variation


class CCDEPTH_PT_make(SidebarPanel, bpy.types.Panel):
    bl_label = "Make"
    bl_parent_id = "CCDEPTH_PT_settings"

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings, active = context.scene.ccdepth, context.active_object
        made = made_objects(context)
        results = [each for each in made if result_record.is_result(each)]
        is_applied = not results or settings.subdivide_results
        if results or (active is not None and out_of_date.has_results(active)):
            draw_main_button(layout, "ccdepth.update", "FILE_REFRESH")
        if len(made) == 1:
            _draw_made(layout, context, made[0])
        elif made:
            draw_object_rows(layout, made, lambda each: result_line(settings, each))
        if is_applied:
            draw_main_button(layout, "ccdepth.subdivide", "MOD_MULTIRES")
            _draw_applied(layout, context)
        layout.operator("ccdepth.export_within", icon="EXPORT")
        column = settings_column(layout)
        if is_applied:
            column.prop(settings, "output")
        column.prop(settings, "shading_angle")
        column.prop(settings, "facet_angle")
        draw_variation(column, context)
        column.prop(settings, "reduce")
        budget = column.row(align=True)
        # What Reduce saves is known once it has run.
        budget.prop(settings, "face_budget", text="Before Reduce" if settings.reduce else "Budget")
        budget.operator("ccdepth.find_tolerance", text="", icon="VIEWZOOM")
        # Of results that are up to date, the number is told already.
        if is_applied or any(result_line(settings, each) for each in results):
            _draw_face_count(layout, context)


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
        column.prop(settings, "longest_edge")
        column.prop(settings, "max_faces")
        column.prop(settings, "subdivide_results")
        made = made_objects(context)
        if len(made) == 1 and result_record.source_of(made[0]) is not None:
            column.prop(made[0].ccdepth, "keep_updated")
        if any(each.data.has_custom_normals for each in made):
            self.layout.operator("ccdepth.remove_normals", icon="NORMALS_VERTEX_FACE")


def _draw_made(layout: bpy.types.UILayout, context: bpy.types.Context, made: bpy.types.Object) -> None:
    """The state of an adaptive mesh, its source, and its facts."""
    settings, source = context.scene.ccdepth, result_record.source_of(made)
    if result_record.is_result(made) and source is None:
        draw_state_line(layout, "Its source has been removed")
    else:
        up_to_date = UP_TO_DATE if source is None else f"{UP_TO_DATE} with {source.name}"
        draw_state_line(layout, result_line(settings, made), up_to_date)
    if made.data.ccdepth.has_result:
        faces, *others = facts_of(context.scene, made.data.ccdepth)
        draw_facts(layout, [faces, *counts_of(made.data, None if source is None else source.data), *others], "make")


def _draw_applied(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The modifiers of the active object that Apply Adaptive Subdivision applies."""
    active, use_modifiers = context.active_object, context.scene.ccdepth.use_modifiers
    if active is not None and active.type == "MESH":
        applied = counted_modifiers(active, use_modifiers=use_modifiers)
        names = ["the pose" if each.type == "ARMATURE" else each.name for each in applied]
        if names:
            layout.label(text=f"Applies {', '.join(names)}", icon="MODIFIER", translate=False)


def _draw_face_count(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings = context.scene.ccdepth
    count = known.count_to_make(chosen(context), settings)
    if count is None:
        draw_button(layout, "ccdepth.count_faces", "LINENUMBERS_ON")
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
