# SPDX-License-Identifier: GPL-3.0-or-later
"""The manual that comes with the extension: the button that opens it, and its entries for Blender's Online Manual."""

from __future__ import annotations

from pathlib import Path

import bpy

PAGE = Path(__file__).resolve().parent.parent / "manual" / "index.html"

# Operators and settings, as Blender names them in lower case, and the headings they are told of under. The first holds.
SECTIONS = (
    ("bpy.ops.ccdepth.compute", "compute-depth"),
    ("bpy.ops.ccdepth.select_invalid", "invalid-faces"),
    ("bpy.ops.ccdepth.repair", "invalid-faces"),
    ("bpy.ops.ccdepth.measure", "measure-deviation"),
    ("bpy.ops.ccdepth.select_worst", "measure-deviation"),
    ("bpy.ops.ccdepth.select", "compute-depth"),
    ("bpy.ops.ccdepth.set_levels", "compute-depth"),
    ("bpy.ops.ccdepth.clear", "compute-depth"),
    ("bpy.ops.ccdepth.update", "results"),
    ("bpy.ops.ccdepth.before_after", "results"),
    ("bpy.ops.ccdepth.tolerance_preset_add", "tolerance"),
    ("bpy.ops.ccdepth.open_manual", "install"),
    ("bpy.ops.ccdepth.*", "adaptive-subdivision"),
    ("bpy.types.scenesettings.*tolerance*", "tolerance"),
    ("bpy.types.scenesettings.use_modifiers", "tolerance"),
    ("bpy.types.scenesettings.method", "compute-depth"),
    ("bpy.types.scenesettings.vertices", "compute-depth"),
    ("bpy.types.scenesettings.frame*", "frames"),
    ("bpy.types.scenesettings.accuracy", "measure-deviation"),
    ("bpy.types.scenesettings.time_limit", "measure-deviation"),
    ("bpy.types.scenesettings.show_*", "heat-map-and-legend"),
    ("bpy.types.scenesettings.distance_*", "heat-map-and-legend"),
    ("bpy.types.scenesettings.*", "adaptive-subdivision"),
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


def register() -> None:
    bpy.utils.register_class(CCDEPTH_AP_preferences)
    bpy.utils.register_manual_map(manual_map)


def unregister() -> None:
    bpy.utils.unregister_manual_map(manual_map)
    bpy.utils.unregister_class(CCDEPTH_AP_preferences)
