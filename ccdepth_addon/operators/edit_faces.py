# SPDX-License-Identifier: GPL-3.0-or-later
"""Edit Selected Faces."""

import bpy

from .selected_meshes import QuickOperator, mesh_fault, refuse


class CCDEPTH_OT_edit_faces(QuickOperator):
    """Enter Edit Mode in face select mode, with the faces that were selected in Object Mode"""

    bl_idname = "ccdepth.edit_faces"
    bl_label = "Edit Selected Faces"
    not_in_edit_mode = "Works in Object Mode, with a mesh object active"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        active = context.active_object
        return None if active is not None and active.type == "MESH" else cls.not_in_edit_mode

    def act(self, context: bpy.types.Context) -> set[str]:
        refuse([context.active_object], lambda active: mesh_fault(active.data))
        # In vertex or edge select mode, faces between the wanted faces would be selected as well.
        context.scene.tool_settings.mesh_select_mode = (False, False, True)
        bpy.ops.object.mode_set(mode="EDIT")
        return {"FINISHED"}
