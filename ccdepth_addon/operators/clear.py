# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear."""

import bpy

from ..exchange.data_blocks import is_writable
from ..state import mesh_values, still_holds, watch
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
            still_holds.forget_measured(mesh)
        watch.redraw(context)
        return {"FINISHED"}
