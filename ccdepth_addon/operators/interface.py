# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Operators of the interface alone: presets of settings, values in panels, and the manual."""

from typing import ClassVar

import bpy
from bl_operators.presets import AddPresetBase
from bpy.props import StringProperty

from ..state import properties
from ..tasks.surfaces import ComputeError, refuse_bad_angles, refuse_bad_tolerance
from ..ui.lengths import printable
from ..ui.manual import PAGE
from ..ui.sidebar import running
from ..ui.tolerances import preset_by_name


class CCDEPTH_OT_use_preset(bpy.types.Operator):
    """Set the settings of the preset"""

    bl_idname = "ccdepth.use_preset"
    bl_label = "Use Preset"
    bl_options: ClassVar[set[str]] = {"UNDO", "INTERNAL"}

    name: StringProperty(name="Name", description="The name of the preset", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        found = preset_by_name(context.scene, properties.name)
        return "" if found is None else found.told(context.scene)

    def execute(self, context: bpy.types.Context) -> set[str]:
        preset = preset_by_name(context.scene, self.name)
        try:
            if preset is None:
                raise ComputeError(f"There is no preset “{printable(self.name)}”")
            refuse_bad_tolerance(preset.tolerance)
            refuse_bad_angles(*(preset.values.get(name, 0.0) for name in ("shading_angle", "facet_angle")))
        except ComputeError as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        for name, value in preset.values.items():
            setattr(context.scene.ccdepth, name, value)
        return {"FINISHED"}


class CCDEPTH_OT_tolerance_preset_add(AddPresetBase, bpy.types.Operator):
    """Add the tolerance, the angles and Reduce as they are to the presets, or remove a preset"""

    bl_idname = "ccdepth.tolerance_preset_add"
    bl_label = "Add Preset"
    preset_menu = "CCDEPTH_PT_tolerance_presets"
    preset_subdir = properties.PRESETS
    # In full, as Blender 4.3 with Python 3.13 does not find the names of ``preset_defines``.
    preset_values: ClassVar[list[str]] = [f"bpy.context.scene.ccdepth.{name}" for name in properties.PRESET_SETTINGS]


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


class CCDEPTH_OT_cancel(bpy.types.Operator):
    """End the run, and change nothing"""

    bl_idname = "ccdepth.cancel"
    bl_label = "Cancel"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        run = running()
        if run is not None:
            run.is_cancelled = True
        return {"FINISHED"}


class CCDEPTH_OT_open_manual(bpy.types.Operator):
    """Open the manual of CC Depth in a web browser"""

    bl_idname = "ccdepth.open_manual"
    bl_label = "CC Depth Manual"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return bpy.ops.wm.url_open(url=PAGE.as_uri())
