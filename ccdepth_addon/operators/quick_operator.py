# SPDX-License-Identifier: GPL-3.0-or-later
"""What operators share that are done at once."""

import bpy

from ..tasks.surfaces import ComputeError
from ..ui.printable import printable_lines
from .selected_meshes import poll_meshes


class QuickOperator(bpy.types.Operator):
    """An operator that works on meshes without a pause, and reports what it refuses."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return poll_meshes(cls, context)

    def act(self, context: bpy.types.Context) -> set[str]:
        """Do the work; returns what ``execute`` returns. Raises ComputeError, with nothing changed."""
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            return self.act(context)
        except ComputeError as fault:
            self.report({"ERROR"}, printable_lines(str(fault)))
            return {"CANCELLED"}
