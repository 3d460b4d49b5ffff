# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Tolerances at the press of a button: the tolerance for the Face Limit, and presets."""

from typing import ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bpy.props import EnumProperty, FloatProperty

from ..state import properties
from ..tasks.surfaces import ComputeError, refuse_bad_angles, refuse_bad_tolerance


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
        description="A part of the diagonal, or a distance in the scene",
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
        "bpy.context.scene.ccdepth.shading_angle",
        "bpy.context.scene.ccdepth.facet_angle",
    ]
