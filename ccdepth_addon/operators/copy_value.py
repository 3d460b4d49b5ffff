# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""The values in panels: their meanings, as tooltips, and Copy Value."""

from typing import ClassVar

import bpy
from bpy.props import StringProperty


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
