# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's panel Levels of Detail: their settings, and when to switch to each."""

from typing import ClassVar

import bpy

from ..exchange.mesh_arrays import mesh_face_count
from ..exchange.switch_distances import Switch
from ..state import result_record
from .facts import made_objects
from .lengths import Rounding, length_text
from .sidebar import SidebarPanel, settings_column

# Significant digits of lengths, for which there is room.
DIGITS = 2

# The headings of the columns, and their widths in proportion.
HEADINGS = {"LOD": 2.2, "Faces": 2.7, "Within": 4.1, "From": 2.8, "Size": 2.5}


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
    """A row for each level of detail of a set, and a column for each of its numbers."""
    rows = [switch_texts(scene, each, switch) for each in levels if (switch := Switch.read(each))]
    table = layout.box().row()
    for (heading, width), *texts in zip(HEADINGS.items(), *rows, strict=True):
        column = table.column(align=True)
        column.ui_units_x = width
        for text in (heading, *texts):
            cell = column.row()
            cell.active, cell.alignment = text != heading, "RIGHT"
            cell.label(text=text)


def switch_texts(scene: bpy.types.Scene, level: bpy.types.Object, switch: Switch) -> tuple[str, ...]:
    """The texts of a row: lengths are rounded up, and the size of the level in the view down, so that they hold."""
    lengths = (length_text(scene, length, Rounding.UP, DIGITS) for length in (switch.error, switch.distance))
    percent = 100 * switch.screen_size
    size = f"{int(percent)}" if percent >= 10 else f"{int(10 * percent) / 10:.1f}"
    return (str(switch.level), f"{mesh_face_count(level.data):,}", *lengths, f"{size} %")


register, unregister = bpy.utils.register_classes_factory((CCDEPTH_PT_levels,))
