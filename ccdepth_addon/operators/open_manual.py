# SPDX-License-Identifier: GPL-3.0-or-later
"""Open Manual."""

from typing import ClassVar

import bpy

from ..ui.manual import PAGE


class CCDEPTH_OT_open_manual(bpy.types.Operator):
    """Open the manual of CC Depth in a web browser"""

    bl_idname = "ccdepth.open_manual"
    bl_label = "CC Depth Manual"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    def execute(self, _context: bpy.types.Context) -> set[str]:
        return bpy.ops.wm.url_open(url=PAGE.as_uri())
