# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision."""

from itertools import chain
from typing import ClassVar

import bpy

from ..state import heat_map, out_of_date, properties, result_record
from ..state.heat_map import Shown
from .adaptive_operator import MakingOperator
from .place_results import NewMesh, place_meshes
from .selected_meshes import hidden_fault


class CCDEPTH_OT_subdivide(properties.OutputProperties, MakingOperator):
    """Make a mesh with few faces, without cracks, and within the tolerance of the limit surface. The mesh takes the
    place of the Subdivision Surface modifier"""

    bl_idname = "ccdepth.subdivide"
    bl_label = "Apply Adaptive Subdivision"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def fault(self, blender_object: bpy.types.Object) -> str | None:
        if not self.subdivide_results and result_record.is_adaptive(blender_object):
            return _result_fault(blender_object)
        if self.output == "IN_PLACE" and blender_object.override_library is not None:
            return "the object is a library override; choose New Object, or make it local first"
        return hidden_fault(blender_object) or super().fault(blender_object)

    def finish(self, context: bpy.types.Context, answer: list[NewMesh]) -> set[str]:
        in_place = self.output == "IN_PLACE"
        settings = result_record.made_with(self, self.tolerance)
        placed = [*chain(*place_meshes(context, answer, self.settings(), in_place=in_place))]
        for each in placed:
            # A result that was subdivided is the source of its copy, or came from nothing any more.
            result_record.forget(each.user)
            if not in_place:
                out_of_date.remember_made(each.user, each.source, settings, each.user.data.materials)
        if self._goes_on_editing:
            self._edited = [each.user.session_uid for each in placed]
        heat_map.show(context, Shown.DISTANCE)
        self.report_skipped(context)
        self.report_made(answer, [each.user for each in placed])
        return {"FINISHED"}


def _result_fault(blender_object: bpy.types.Object) -> str:
    """Why a result is not subdivided."""
    if result_record.is_result(blender_object):
        return (
            f"it is a result already, made from “{blender_object.ccdepth.source_name}”; use Update Result to make it "
            "anew, or turn Subdivide Results on to subdivide it once more"
        )
    return "it was subdivided in place already, and has no source; turn Subdivide Results on to subdivide it once more"
