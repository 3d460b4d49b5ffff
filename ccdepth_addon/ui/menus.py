# SPDX-License-Identifier: GPL-3.0-or-later
"""The CC Depth menu in the menus Object and Mesh, by which Blender's search finds the operators."""

import bpy

from .manual import draw_manual_button

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
    ("ccdepth.update", "FILE_REFRESH"),
    ("ccdepth.before_after", "FILE_PARENT"),
    ("ccdepth.remove_normals", "NORMALS_VERTEX_FACE"),
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


def register() -> None:
    bpy.utils.register_class(CCDEPTH_MT_menu)
    bpy.types.VIEW3D_MT_object.append(_draw_menu)
    bpy.types.VIEW3D_MT_edit_mesh.append(_draw_menu)


def unregister() -> None:
    bpy.types.VIEW3D_MT_edit_mesh.remove(_draw_menu)
    bpy.types.VIEW3D_MT_object.remove(_draw_menu)
    bpy.utils.unregister_class(CCDEPTH_MT_menu)
