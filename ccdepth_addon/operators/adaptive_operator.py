# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""What Apply Adaptive Subdivision and Count Faces have in common."""

from collections.abc import Generator
from typing import ClassVar

import bpy

from ..state import properties
from ..tasks.adaptive_task import AdaptiveSettings, AdaptiveTask, adaptive_settings, prepare_adaptive
from ..tasks.stepwise import Stage
from . import edit_mode
from .long_operator import LongOperator
from .selected_meshes import hidden_fault, name_fault, refuse, selected_meshes


class AdaptiveOperator(LongOperator):
    """An operator that makes adaptive meshes or counts their faces; it leaves Edit Mode while it runs."""

    SETTINGS: ClassVar[tuple[str, ...]] = ("tolerance_mode", "mode", "transitions", "use_modifiers", "max_faces")

    mode: properties.mode_property()
    transitions: properties.transitions_property()
    max_faces: properties.max_faces_property()

    def prepared(self, context: bpy.types.Context) -> Generator[Stage, None, list[AdaptiveTask]]:
        """Leave Edit Mode and read the objects: yields the stage, and returns the tasks. Raises ComputeError."""
        objects = selected_meshes(context)
        refuse(objects, lambda obj: hidden_fault(obj) or self.object_fault(obj) or name_fault(obj))
        self._goes_on_editing = context.mode == "EDIT_MESH"
        self._edited = edit_mode.leave(context)
        return (yield from prepare_adaptive(context, objects, self.settings()))

    def object_fault(self, blender_object: bpy.types.Object) -> str | None:
        """Why the object cannot have a result. Its mesh may be linked: nothing is written to it."""
        if not blender_object.is_editable:
            return "the object is linked from another file; make it local first"
        return None

    def leave(self, context: bpy.types.Context) -> None:
        edit_mode.enter(context, getattr(self, "_edited", ()))
        self._edited = []

    def settings(self) -> AdaptiveSettings:
        return adaptive_settings(self, self.tolerance)
