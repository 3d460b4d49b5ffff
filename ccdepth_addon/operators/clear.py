# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear."""

import bpy

from ..exchange.data_blocks import is_writable
from ..state import mesh_values, viewports
from ..state.chosen import chosen
from .selected_meshes import QuickOperator


class CCDEPTH_OT_clear(QuickOperator):
    """Remove depths, deviations and colours made of them from the mesh"""

    bl_idname = "ccdepth.clear"
    bl_label = "Clear"

    def act(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in chosen(context) if is_writable(obj.data)}
        cleared = [mesh for mesh in meshes if mesh_values.has_traces(mesh)]
        if not cleared:
            self.report({"INFO"}, "There is nothing to clear")
            return {"CANCELLED"}
        for mesh in cleared:
            mesh_values.clear(mesh)
        for each in chosen(context):
            if each.data in cleared and each.is_editable:
                each.ccdepth.measured_against = None
        viewports.redraw(context)
        return {"FINISHED"}
