# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Select by Depth."""

from operator import eq, ge, le

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..exchange.face_values import DEPTH_KIND, read_face_values
from ..state import mesh_values
from ..state.chosen import chosen
from . import face_selection
from .selected_meshes import QuickOperator, count_text, mesh_fault, refuse

COMPARISONS = {"EQUAL": eq, "AT_LEAST": ge, "AT_MOST": le}


class CCDEPTH_OT_select(QuickOperator):
    """Select the faces of a depth"""

    bl_idname = "ccdepth.select"
    bl_label = "Select by Depth"

    # Without SKIP_SAVE a button would take what it does not set from the last press of another one.
    depth: IntProperty(
        name="Depth",
        description="The depth to look for; the deepest when left out",
        default=0,
        min=0,
        options={"SKIP_SAVE"},
    )
    comparison: EnumProperty(
        name="Comparison",
        description="Which depths to select",
        items=(
            ("EQUAL", "Equal To", "Faces of exactly this depth"),
            ("AT_LEAST", "At Least", "Faces of this depth and deeper ones"),
            ("AT_MOST", "At Most", "Faces of this depth and less deep ones"),
        ),
        default="EQUAL",
        options={"SKIP_SAVE"},
    )
    edit: BoolProperty(
        name="Edit",
        description="Enter Edit Mode with the selected faces, as from the window",
        default=False,
        options={"SKIP_SAVE", "HIDDEN"},
    )
    extend: BoolProperty(name="Extend", description="Add to the selection", default=False, options={"SKIP_SAVE"})

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        has_any = any(mesh_values.has_depths(obj.data) for obj in chosen(context))
        return None if has_any else "Compute Depth first"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        active = context.active_object
        can_edit = active in chosen(context) and mesh_fault(active.data) is None
        self.edit = context.mode == "OBJECT" and can_edit
        return self.execute(context)

    def act(self, context: bpy.types.Context) -> set[str]:
        meshes = dict.fromkeys(obj.data for obj in chosen(context) if mesh_values.has_depths(obj.data))
        refuse(meshes, face_selection.selection_fault)
        if not self.properties.is_property_set("depth"):
            self.depth = max(mesh.ccdepth.deepest for mesh in meshes)
        selected = 0
        for mesh in meshes:
            wanted = COMPARISONS[self.comparison](read_face_values(mesh, DEPTH_KIND), self.depth)
            selected += face_selection.select_faces(mesh, wanted, extend=self.extend)
        if self.edit:
            context.scene.tool_settings.mesh_select_mode = (False, False, True)
            bpy.ops.object.mode_set(mode="EDIT")
        face_selection.choose_face_mode(context)
        self.report({"INFO"}, f"{count_text(selected, 'face', 'faces')} selected")
        return {"FINISHED"}
