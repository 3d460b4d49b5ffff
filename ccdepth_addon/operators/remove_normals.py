# SPDX-License-Identifier: GPL-3.0-or-later
"""Remove Exact Normals."""

import bpy

from ..exchange.custom_normals import remove_normals
from ..state import mesh_values, result_record, watch
from ..state.chosen import chosen
from .selected_meshes import QuickOperator, refuse_what_cannot_be_written


class CCDEPTH_OT_remove_normals(QuickOperator):
    """Remove the stored normals of adaptive meshes, to go on editing: stored normals do not follow most edits. Angles
    of shading are then not proved any more"""

    bl_idname = "ccdepth.remove_normals"
    bl_label = "Remove Exact Normals"
    not_in_edit_mode = "Works in Object Mode"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        return None if _with_normals(context) else "Select an adaptive mesh with exact normals"

    def act(self, context: bpy.types.Context) -> set[str]:
        holders = _with_normals(context)
        refuse_what_cannot_be_written(holders)
        for mesh in {each.data for each in holders}:
            remove_normals(mesh)
            if mesh.ccdepth.shading_angle:
                mesh_values.forget_angles(mesh)
        watch.redraw(context)
        return {"FINISHED"}


def _with_normals(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if result_record.is_adaptive(each) and each.data.has_custom_normals]
