# SPDX-License-Identifier: GPL-3.0-or-later
"""Bake to Colour Attribute."""

from __future__ import annotations

import bpy

from ..exchange.face_values import COLOR
from ..state import heat_map
from ..state.chosen import chosen
from ..state.heat_map import Shown
from ..tasks.surfaces import naming
from . import edit_mode
from .selected_meshes import QuickOperator, refuse_what_cannot_be_written


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
        with edit_mode.left(context):
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
