# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's CC Depth tab: the settings of all buttons, and the panel Analyse with depths and levels."""

from collections.abc import Callable
from typing import ClassVar

import bpy
import bpy.utils.previews
import numpy as np

from ..core import FloatArray
from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.modifiers import OF_OBJECT
from ..state import known, out_of_date, result_record
from ..state.chosen import chosen
from ..state.colors import depth_colors
from ..state.mesh_values import too_deep
from ..state.properties import Settings
from ..tasks.frames import chosen_frames
from .facts import count_fact, draw_facts, faces_by_depth, facts_of, refused_objects, share_text, totals, with_depths
from .lengths import count_text
from .manual import draw_manual_button
from .sidebar import NAME_PART, SidebarPanel, draw_alert, draw_button, settings_column
from .tolerances import MOST_OBJECTS, CCDEPTH_PT_tolerance_presets, tolerance_text
from .variation import draw_tolerance, draw_variation

SWATCH_SIZE = 16

# The line for a result of Apply Adaptive Subdivision with another mesh than the one made.
RESULT_EDITED = "Result edited; Update keeps your version"

# The line for values that depend on data which may have changed before the file was opened.
NOT_CHECKED = "Not checked since opening"

UP_TO_DATE = "Up to date"

_swatches: bpy.utils.previews.ImagePreviewCollection | None = None


class CCDEPTH_PT_settings(SidebarPanel, bpy.types.Panel):
    bl_label = "CC Depth"

    def draw_header_preset(self, context: bpy.types.Context) -> None:
        # In a narrow sidebar it would stand over the title.
        if context.region.width > 200 * context.preferences.system.ui_scale:
            draw_manual_button(self.layout, text="", emboss=False)
        CCDEPTH_PT_tolerance_presets.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        settings = context.scene.ccdepth
        # The settings of all buttons are above them.
        column = settings_column(layout)
        _draw_objects(column, context)
        column.prop(settings, "use_modifiers")
        column.prop(settings, "shown_tolerance_mode", text="Tolerance")
        draw_tolerance(column, context.scene)
        # Its room is there when it has nothing to say.
        split = column.split(factor=NAME_PART)
        split.label(text="")
        split.label(text=tolerance_text(context))
        row = column.row(align=True)
        row.prop(settings, "heat_map")
        row.popover("CCDEPTH_PT_heat_map", text="", icon="OVERLAY")
        # Above all results, so that it stays under the mouse whatever they are.
        if any(result_record.is_result(each) or out_of_date.has_results(each) for each in chosen(context)):
            layout.operator("ccdepth.before_after", icon="LOOP_BACK")


class CCDEPTH_PT_heat_map(bpy.types.Panel):
    """How the heat map is shown"""

    bl_label = "Heat Map"
    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"
    bl_ui_units_x = 12

    def draw(self, context: bpy.types.Context) -> None:
        column, settings = settings_column(self.layout), context.scene.ccdepth
        column.prop(settings, "heat_map_opacity")
        column.prop(settings, "distance_range")
        if settings.distance_range == "FIXED":
            column.prop(settings, "distance_top")
        column.prop(settings, "show_legend")
        column.prop(settings, "heat_map_playing")
        self.layout.operator("ccdepth.bake_colors", icon="GROUP_VCOL")
        self.layout.operator("ccdepth.clear", icon="X")


class CCDEPTH_PT_analyse(SidebarPanel, bpy.types.Panel):
    bl_label = "Analyse"
    bl_parent_id = "CCDEPTH_PT_settings"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ccdepth
        draw_main_button(layout, "ccdepth.compute", "MOD_SUBSURF")
        _draw_refusal(layout, context)
        objects = with_depths(context)
        if len(objects) == 1:
            draw_state_line(layout, stale_line(settings, objects[0].data, objects[0]))
            draw_facts(layout, facts_of(context.scene, objects[0].data.ccdepth), "analyse")
        elif objects:
            draw_facts(layout, totals(context.scene, objects), "analyse")
            draw_object_rows(layout, objects, lambda each: stale_line(settings, each.data, each))
        if objects:
            _draw_histogram(layout, objects)
            layout.operator("ccdepth.select", icon="RESTRICT_SELECT_OFF")
            layout.operator("ccdepth.set_levels", icon="MODIFIER")
            _draw_too_deep(layout, settings, objects)


class CCDEPTH_PT_advanced(SidebarPanel, bpy.types.Panel):
    """Further settings of Compute Depth."""

    bl_label = "Advanced"
    bl_parent_id = "CCDEPTH_PT_analyse"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column, settings = settings_column(self.layout), context.scene.ccdepth
        column.prop(settings, "method")
        column.prop(settings, "vertices")
        effort = column.row()
        effort.active = settings.method == "DISTANCE"
        effort.prop(settings, "effort")
        draw_variation(column, context)
        column.prop(settings, "frames")
        if settings.frames == "CUSTOM":
            column.prop(settings, "frame_list", text="")


def _draw_objects(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The objects that the buttons work on."""
    objects = chosen(context)
    if not objects:
        layout.label(text="No mesh is selected", icon="INFO")
    elif len(objects) > 1:
        layout.label(text=f"{len(objects):,} objects", icon="OBJECT_DATA")
    elif objects[0].select_get() or context.mode == "EDIT_MESH":
        layout.label(text=objects[0].name, icon="OBJECT_DATA", translate=False)
    else:
        layout.label(text=f"Not selected: {objects[0].name}", icon="INFO", translate=False)


def _draw_refusal(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The number of faces at fault in the last run, and buttons that select and remove these faces."""
    faces = sum(known.faces_at_fault(mesh) for mesh in {each.data for each in refused_objects(context)})
    if faces:
        column = layout.column(align=True)
        draw_alert(column, count_text(faces, "invalid face", "invalid faces"))
        column.operator("ccdepth.select_invalid", icon="RESTRICT_SELECT_OFF")
        column.operator("ccdepth.repair", icon="TOOL_SETTINGS")


def _draw_too_deep(
    layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, objects: list[bpy.types.Object]
) -> None:
    """The number of faces that need more levels than can be set, with buttons to select these faces and to divide the
    others less."""
    deep = [found for each in objects if (found := too_deep(each.data.ccdepth, settings.max_faces))]
    fitting = min((each.fitting for each in deep), default=0)
    faces = sum(faces for depth, faces in faces_by_depth(objects).items() if depth > fitting) if deep else 0
    if faces:
        column = layout.column(align=True)
        needing = count_text(faces, "face needs", "faces need")
        draw_alert(column, f"{needing} more than {count_text(fitting, 'level', 'levels')}")
        select = column.operator("ccdepth.select", text="Select These Faces", icon="RESTRICT_SELECT_OFF")
        select.depth, select.comparison = fitting + 1, "AT_LEAST"
        column.operator("ccdepth.subdivide", icon="MOD_MULTIRES")
        if count := known.count_to_make(objects, settings):
            draw_facts(column, [count_fact(count.faces)])


def stale_line(settings: bpy.types.PropertyGroup, mesh: bpy.types.Mesh, holder: bpy.types.Object | None = None) -> str:
    """The reason why the depths are out of date, or do not hold for an object that uses the mesh; empty where they
    hold."""
    record = mesh.ccdepth
    note, is_uncovered = out_of_date.noted(mesh), holder is not None and out_of_date.noted(holder).is_uncovered
    if note.is_stale:
        has_source = record.subdivision and holder is not None and result_record.source_of(holder) is not None
        return RESULT_EDITED if has_source and not is_uncovered else f"Out of date: mesh “{mesh.name}” changed"
    if is_uncovered:
        return "Not computed for this object"
    if note.is_unchecked:
        return NOT_CHECKED
    if record.subdivision:
        return "" if holder is None else _changed_since_made(settings, holder)
    frames = chosen_frames(settings.id_data, settings.frames, settings.frame_list)
    # Depths by another method hold, and so do depths for named vertices if the scene names none.
    vertices = record.vertices if settings.vertices == OF_OBJECT else settings.vertices
    is_same = (vertices, frames) == (record.vertices, record.frames) and Settings.of(settings) == Settings.of(record)
    return "" if is_same else "Out of date: settings changed"


def result_line(settings: bpy.types.PropertyGroup, result: bpy.types.Object) -> str:
    """The reason why Update Result would change a result of Apply Adaptive Subdivision; empty without a reason. Depths
    of the result itself, computed or cleared, do not matter."""
    if result.data.ccdepth.subdivision and (line := stale_line(settings, result.data, result)):
        return line
    return _changed_since_made(settings, result)


def _changed_since_made(settings: bpy.types.PropertyGroup, result: bpy.types.Object) -> str:
    """The reason in the source or the settings; a result without a source holds for its own settings."""
    if result_record.source_of(result) is None:
        return ""
    note = out_of_date.noted(result)
    if note.is_stale:
        return f"Out of date: “{result.ccdepth.source.name}” changed"
    if note.is_unchecked:
        return NOT_CHECKED
    return "Out of date: settings changed" if result_record.settings_have_changed(result, settings) else ""


def draw_main_button(layout: bpy.types.UILayout, operator: str, icon: str) -> None:
    """The main button of a panel."""
    button = layout.column()
    button.scale_y = 1.4
    draw_button(button, operator, icon)


def draw_state_line(layout: bpy.types.UILayout, stale: str, up_to_date: str = UP_TO_DATE) -> None:
    """The reason why something is out of date, or that it is up to date: a line either way, so that nothing below
    moves; two lines for a text of two parts."""
    column = layout.column(align=True)
    column.alert = bool(stale)
    first, *others = stale.split("; ") if stale else [up_to_date]
    column.label(text=first, icon="ERROR" if stale else "CHECKMARK", translate=False)
    for other in others:
        column.label(text=other, icon="BLANK1")


def draw_object_rows(
    layout: bpy.types.UILayout, objects: list[bpy.types.Object], line_of: Callable[[bpy.types.Object], str]
) -> None:
    """A row for each of several objects, with the reason if something is out of date."""
    column = layout.box().column(align=True)
    _draw_object_row(column, "Object", "Faces", "Depth").active = False
    for each in objects[:MOST_OBJECTS]:
        line, record = line_of(each), each.data.ccdepth
        deepest = str(record.deepest) if record.has_result else ""
        _draw_object_row(column, each.name, f"{mesh_face_count(each.data):,}", deepest, "OBJECT_DATA")
        if line:
            # A short text, as there is less room.
            text = line.removeprefix("Out of date: ").partition("; ")[0]
            draw_alert(column, f"{text[0].upper()}{text[1:]}")
    if len(objects) > MOST_OBJECTS:
        column.label(text=f"{len(objects) - MOST_OBJECTS:,} more")


def _draw_object_row(
    layout: bpy.types.UILayout, name: str, faces: str, depth: str, icon: str = "NONE"
) -> bpy.types.UILayout:
    """A row of the list of objects, or of its headings."""
    row = layout.split(factor=0.55)
    row.label(text=name, icon=icon)
    numbers = row.split(factor=0.6)
    for number in (faces, depth):
        cell = numbers.row()
        cell.alignment = "RIGHT"
        cell.label(text=number)
    return row


def _draw_histogram(layout: bpy.types.UILayout, objects: list[bpy.types.Object]) -> None:
    counts = faces_by_depth(objects)
    total = sum(counts.values())
    box = layout.box().column(align=True)
    for depth in sorted(counts, reverse=True):
        value = box.row(align=True)
        key = value.row(align=True)
        # Room for two digits, however narrow the panel is.
        key.ui_units_x = 2.5
        key.label(text=str(depth), icon_value=_swatch(depth_colors([depth])[0]))
        value.progress(text=share_text(counts[depth], total), factor=counts[depth] / total)
        button = value.operator("ccdepth.select", text="", icon="RESTRICT_SELECT_OFF", emboss=False)
        button.depth, button.comparison = depth, "EQUAL"


def _swatch(color: FloatArray) -> int:
    """The icon of a colour, made once, of a few hundred bytes."""
    assert _swatches is not None
    name = repr(color.tolist())
    if name not in _swatches:
        icon = _swatches.new(name)
        icon.icon_size = (SWATCH_SIZE, SWATCH_SIZE)
        icon.icon_pixels_float = np.tile(np.array((*color, 1.0), dtype=np.float32), SWATCH_SIZE**2)
    return _swatches[name].icon_id


_register_classes, _unregister_classes = bpy.utils.register_classes_factory(
    (CCDEPTH_PT_settings, CCDEPTH_PT_heat_map, CCDEPTH_PT_analyse, CCDEPTH_PT_advanced)
)


def register() -> None:
    global _swatches
    _swatches = bpy.utils.previews.new()
    _register_classes()


def unregister() -> None:
    global _swatches
    _unregister_classes()
    bpy.utils.previews.remove(_swatches)
    _swatches = None
