# SPDX-License-Identifier: GPL-3.0-or-later
"""Clear, Bake to Color Attribute, and Remove Exact Normals."""

from __future__ import annotations

import bpy

from ..exchange.custom_normals import remove_normals
from ..exchange.data_blocks import is_writable
from ..exchange.face_values import COLOR
from ..registration import redraw
from ..state import heat_map, mesh_values, result_record, still_holds
from ..state.chosen import chosen
from ..state.heat_map import Shown
from ..tasks.surfaces import naming
from .mesh_operators import QuickOperator
from .refusals import refuse_what_cannot_be_written
from .scene_objects import edit_mode_left


class CCDEPTH_OT_clear(QuickOperator):
    """Remove depths, distances, deviations and colours made of them from the selected meshes; the meshes stay"""

    bl_idname = "ccdepth.clear"
    bl_label = "Clear Heat Map Values"

    def act(self, context: bpy.types.Context) -> set[str]:
        meshes = {obj.data for obj in chosen(context) if is_writable(obj.data)}
        cleared = [mesh for mesh in meshes if mesh_values.has_traces(mesh)]
        if not cleared:
            self.report({"INFO"}, "There is nothing to clear")
            return {"CANCELLED"}
        for mesh in cleared:
            mesh_values.clear(mesh)
            still_holds.forget_measured(mesh)
        redraw(context)
        return {"FINISHED"}


class CCDEPTH_OT_bake_colors(QuickOperator):
    """Make a colour attribute of the values in the heat map, for renders and other programs, and display the colours.
    The colours stay until they are baked again or cleared"""

    bl_idname = "ccdepth.bake_colors"
    bl_label = "Bake to Color Attribute"

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        has_any = any(_kind(each.data, context) for each in chosen(context))
        return None if has_any else "Compute Depth first"

    def act(self, context: bpy.types.Context) -> set[str]:
        holders = {each.data: each for each in chosen(context) if _kind(each.data, context)}
        refuse_what_cannot_be_written([*holders.values()])
        with edit_mode_left(context):
            for mesh, holder in holders.items():
                kind = _kind(mesh, context)
                assert kind is not None
                with naming(holder.name):
                    tolerance = heat_map.tolerance_of(mesh, kind)
                    heat_map.write_colors(mesh, kind, tolerance, context.scene.ccdepth)
        self.report({"INFO"}, f"Baked to “{COLOR}”")
        return {"FINISHED"}


def _kind(mesh: bpy.types.Mesh, context: bpy.types.Context) -> Shown | None:
    """The kind of values that the heat map shows of the mesh, or else the kind of its last values."""
    kind = heat_map.shown(context.scene.ccdepth)
    return kind if kind is not None and heat_map.has_shown(mesh, kind) else heat_map.last_kind(mesh)


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
        redraw(context)
        return {"FINISHED"}


def _with_normals(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if result_record.is_adaptive(each) and each.data.has_custom_normals]
