# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Operators of the interface alone: tolerances at the press of a button, values in panels, and the manual."""

from typing import ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bpy.props import EnumProperty, FloatProperty, StringProperty

from ..state import properties
from ..tasks.surfaces import ComputeError, refuse_bad_angles, refuse_bad_tolerance
from ..ui.manual import PAGE


class CCDEPTH_OT_use_tolerance(bpy.types.Operator):
    """Set the tolerance, and the angles of the preset"""

    bl_idname = "ccdepth.use_tolerance"
    bl_label = "Use Tolerance"
    bl_options: ClassVar[set[str]] = {"UNDO", "INTERNAL"}

    tolerance_mode: EnumProperty(
        name="Tolerance Mode",
        description="How the tolerance is given; as the scene has it where it is not set",
        items=properties.TOLERANCE_MODES,
        options={"SKIP_SAVE"},
    )
    tolerance: FloatProperty(
        name="Tolerance",
        description="A part of the diagonal, a distance in the scene, or a number of pixels",
        default=properties.DEFAULT_RELATIVE_TOLERANCE,
        options={"SKIP_SAVE"},
    )
    shading_angle: FloatProperty(
        name="Shading Angle", description="As the scene has it where it is not set", options={"SKIP_SAVE"}
    )
    facet_angle: FloatProperty(
        name="Facet Angle", description="As the scene has it where it is not set", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            refuse_bad_tolerance(self.tolerance)
            refuse_bad_angles(self.shading_angle, self.facet_angle)
        except ComputeError as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        settings = context.scene.ccdepth
        for name in ("tolerance_mode", "shading_angle", "facet_angle"):
            if self.properties.is_property_set(name):
                setattr(settings, name, getattr(self, name))
        properties.set_scene_tolerance(settings, self.tolerance)
        return {"FINISHED"}


class CCDEPTH_OT_tolerance_preset_add(AddPresetBase, bpy.types.Operator):
    """Add the tolerance and the angles to the presets, or remove a preset"""

    bl_idname = "ccdepth.tolerance_preset_add"
    bl_label = "Add Tolerance Preset"
    preset_menu = "CCDEPTH_PT_tolerance_presets"
    preset_subdir = properties.TOLERANCE_PRESETS
    # In full, as Blender 4.3 with Python 3.13 does not find the names of ``preset_defines``.
    preset_values: ClassVar[list[str]] = [
        "bpy.context.scene.ccdepth.tolerance_mode",
        "bpy.context.scene.ccdepth.relative_tolerance",
        "bpy.context.scene.ccdepth.tolerance",
        "bpy.context.scene.ccdepth.pixels",
        "bpy.context.scene.ccdepth.shading_angle",
        "bpy.context.scene.ccdepth.facet_angle",
    ]


class CCDEPTH_OT_copy_value(bpy.types.Operator):
    """Copy the value to the clipboard"""

    bl_idname = "ccdepth.copy_value"
    bl_label = "Copy Value"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    value: StringProperty(name="Value", description="The text to copy", options={"SKIP_SAVE"})
    meaning: StringProperty(name="Meaning", description="What the value is, for its tooltip", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{properties.meaning}.\nClick to copy it" if properties.meaning else ""

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.window_manager.clipboard = self.value
        self.report({"INFO"}, f"Copied {self.value}")
        return {"FINISHED"}


class CCDEPTH_OT_open_manual(bpy.types.Operator):
    """Open the manual of CC Depth in a web browser"""

    bl_idname = "ccdepth.open_manual"
    bl_label = "CC Depth Manual"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return bpy.ops.wm.url_open(url=PAGE.as_uri())
