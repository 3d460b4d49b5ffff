# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel Levels of Detail: their settings, and when to switch to each."""

from typing import ClassVar

import bpy

from ..exchange.mesh_arrays import mesh_face_count
from ..state import result_record, switch_distances
from ..state.switch_distances import Switch
from .facts import made_objects
from .lengths import Rounding, length_text
from .sidebar import SidebarPanel, settings_column

HEADINGS = ("Level", "Faces", "Distance", "Pixel From", "Size")


class CCDEPTH_PT_levels(SidebarPanel, bpy.types.Panel):
    bl_label = "Levels of Detail"
    bl_parent_id = "CCDEPTH_PT_make"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings = self.layout, context.scene.ccdepth
        levels = [each for each in made_objects(context) if result_record.is_level(each)]
        if not levels:
            layout.operator("ccdepth.lods", icon="MOD_DECIM")
        column = settings_column(layout)
        making = column.column(align=True)
        making.active = not levels
        making.prop(settings, "count")
        making.prop(settings, "step")
        view = column.column(align=True)
        view.prop(settings, "view_angle")
        view.prop(settings, "view_height")
        if levels:
            _draw_table(layout, context.scene, result_record.levels_beside(levels[0]))


def _draw_table(layout: bpy.types.UILayout, scene: bpy.types.Scene, levels: list[bpy.types.Object]) -> None:
    """A row for each level of detail of a set."""
    column = layout.box().column(align=True)
    _draw_row(column, HEADINGS).active = False
    for each in levels:
        switch = switch_distances.read(each)
        if switch is not None:
            _draw_row(column, switch_texts(scene, each, switch))


def switch_texts(scene: bpy.types.Scene, level: bpy.types.Object, switch: Switch) -> tuple[str, ...]:
    """The texts of a row: lengths are rounded up, and the size of the level in the view down, so that they hold."""
    lengths = (length_text(scene, length, Rounding.UP, 3) for length in (switch.error, switch.distance))
    size = f"{int(switch.screen_size * 1000) / 10:.1f} %"
    return (str(switch.level), f"{mesh_face_count(level.data):,}", *lengths, size)


def _draw_row(layout: bpy.types.UILayout, texts: tuple[str, ...]) -> bpy.types.UILayout:
    row = layout.row()
    for text in texts:
        cell = row.row()
        cell.alignment = "RIGHT"
        cell.label(text=text)
    return row


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_levels,))
