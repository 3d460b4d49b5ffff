# SPDX-License-Identifier: GPL-3.0-or-later
"""The manual that comes with the extension, with its entries for Blender's Online Manual; and the CC Depth menu in the
menus Object and Mesh, by which Blender's search finds the operators, and the entry of File › Export."""

from __future__ import annotations

from pathlib import Path

import bpy

PAGE = Path(__file__).resolve().parent.parent / "manual" / "index.html"

# The headings of the manual that operators and settings are under; the first that fits holds.
OPERATORS = (
    ("invalid-faces", "select_invalid repair"),
    ("measure-deviation", "measure select_worst"),
    ("compute-depth", "compute select set_levels clear"),
    ("heat-map-and-legend", "bake_colors"),
    ("results", "update before_after"),
    ("export-within-tolerance", "export_within"),
    ("levels-of-detail", "lods"),
    ("tolerance", "tolerance_preset_add"),
    ("install", "open_manual"),
    ("adaptive-subdivision", "*"),
)
SETTINGS = (
    ("tolerance", "*tolerance* use_modifiers"),
    ("compute-depth", "method vertices effort"),
    ("frames", "frame*"),
    ("measure-deviation", "*accuracy time_limit"),
    ("heat-map-and-legend", "heat_map* show_* distance_*"),
    ("levels-of-detail", "count step view_*"),
    ("adaptive-subdivision", "*"),
)
SECTIONS = (
    *((f"bpy.ops.ccdepth.{name}", heading) for heading, names in OPERATORS for name in names.split()),
    *((f"bpy.types.scenesettings.{name}", heading) for heading, names in SETTINGS for name in names.split()),
    ("bpy.types.resultrecord.*", "results"),
)


class CCDEPTH_AP_preferences(bpy.types.AddonPreferences):
    # The package that Blender enables: that of the extension, or this one in a checkout.
    bl_idname = __package__.removesuffix(".ui").removesuffix(".ccdepth_addon")

    def draw(self, _context: bpy.types.Context) -> None:
        row = self.layout.row()
        row.label(text="In the 3D View's sidebar, and in the menus Object and Mesh")
        draw_manual_button(row)


def draw_manual_button(layout: bpy.types.UILayout, *, text: str = "Manual", emboss: bool = True) -> None:
    """A button that opens the manual in a browser."""
    layout.operator("ccdepth.open_manual", text=text, icon="HELP", emboss=emboss)


def manual_map() -> tuple[str, tuple[tuple[str, str], ...]]:
    """The manual's entries for Online Manual in the context menus of buttons."""
    return f"{PAGE.as_uri()}#", SECTIONS


# The entries of the menu; None is a line between.
ENTRIES = (
    ("ccdepth.compute", "MOD_SUBSURF"),
    ("ccdepth.set_levels", "MODIFIER"),
    ("ccdepth.clear", "X"),
    ("ccdepth.bake_colors", "GROUP_VCOL"),
    None,
    ("ccdepth.subdivide", "MOD_MULTIRES"),
    ("ccdepth.count_faces", "LINENUMBERS_ON"),
    ("ccdepth.find_tolerance", "VIEWZOOM"),
    ("ccdepth.lods", "MOD_DECIM"),
    ("ccdepth.update", "FILE_REFRESH"),
    ("ccdepth.before_after", "FILE_PARENT"),
    ("ccdepth.remove_normals", "NORMALS_VERTEX_FACE"),
    ("ccdepth.export_within", "EXPORT"),
    None,
    ("ccdepth.measure", "DRIVER_DISTANCE"),
    None,
    ("ccdepth.select", "RESTRICT_SELECT_OFF"),
    ("ccdepth.select_worst", "FACESEL"),
    ("ccdepth.select_invalid", "ERROR"),
    ("ccdepth.repair", "TOOL_SETTINGS"),
)


class CCDEPTH_MT_menu(bpy.types.Menu):
    """Catmull-Clark levels that faces need, and meshes within a tolerance of the limit surface"""

    bl_idname = "CCDEPTH_MT_menu"
    bl_label = "CC Depth"

    def draw(self, _context: bpy.types.Context) -> None:
        for entry in ENTRIES:
            if entry is None:
                self.layout.separator()
            else:
                self.layout.operator(entry[0], icon=entry[1])
        self.layout.separator()
        draw_manual_button(self.layout, text="CC Depth Manual")


def _draw_menu(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.separator()
    self.layout.menu(CCDEPTH_MT_menu.bl_idname)


def _draw_export(self: bpy.types.Menu, _context: bpy.types.Context) -> None:
    self.layout.operator("ccdepth.export_within", text="CC Depth: Within Tolerance")


def register() -> None:
    bpy.utils.register_class(CCDEPTH_AP_preferences)
    bpy.utils.register_manual_map(manual_map)
    bpy.utils.register_class(CCDEPTH_MT_menu)
    bpy.types.VIEW3D_MT_object.append(_draw_menu)
    bpy.types.VIEW3D_MT_edit_mesh.append(_draw_menu)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)
    bpy.types.VIEW3D_MT_edit_mesh.remove(_draw_menu)
    bpy.types.VIEW3D_MT_object.remove(_draw_menu)
    bpy.utils.unregister_class(CCDEPTH_MT_menu)
    bpy.utils.unregister_manual_map(manual_map)
    bpy.utils.unregister_class(CCDEPTH_AP_preferences)
