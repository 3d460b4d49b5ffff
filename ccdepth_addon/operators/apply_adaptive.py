# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision."""

import bpy

from ..exchange.modifiers import left_out_sculpting
from ..state import heat_map, out_of_date, properties, result_record
from ..state.chosen import chosen
from ..state.heat_map import Shown
from .adaptive_operator import MakingOperator
from .job import Steps
from .place_results import place_meshes
from .selected_meshes import hidden_fault, refuse


class CCDEPTH_OT_subdivide(properties.OutputProperties, MakingOperator):
    """Make a mesh with few faces, without cracks, and within the tolerance of the limit surface. The mesh takes the
    place of the Subdivision Surface modifier"""

    bl_idname = "ccdepth.subdivide"
    bl_label = "Apply Adaptive Subdivision"

    def steps(self, context: bpy.types.Context) -> Steps[set[str]]:
        objects = chosen(context)
        refuse(objects, self._fault)
        settings = properties.Settings.of(self, result_record.SETTINGS)
        in_place, is_editing = self.output == "IN_PLACE", context.mode == "EDIT_MESH"
        with self.in_object_mode(context, objects, objects) as edited:
            made, notes = yield from self.made(context, objects, objects, self._progress_text)
            placed = place_meshes(context, made, self.settings(), in_place=in_place)
            for made_object, source, read in placed:
                if in_place:
                    # It came from nothing any more.
                    result_record.forget(made_object)
                else:
                    out_of_date.remember_made(made_object, source, settings, made_object.data.materials, read)
            if is_editing:
                edited[:] = [made_object.session_uid for made_object, *_ in placed]
        heat_map.show(context, Shown.DISTANCE)
        self.report_skipped(context)
        self.report_made(made, notes, [made_object for made_object, *_ in placed])
        return {"FINISHED"}

    def _progress_text(self, faces: float) -> str:
        of_all = "faces so far" if self.counted is None else f"of {self.counted:,} faces"
        return f"Subdividing: {faces:,.0f} {of_all}"

    def _fault(self, blender_object: bpy.types.Object) -> str | None:
        if not self.subdivide_results and result_record.is_adaptive(blender_object):
            return _result_fault(blender_object)
        if self.output == "IN_PLACE" and (fault := self._replacing_fault(blender_object)):
            return fault
        return hidden_fault(blender_object) or self.making_fault(blender_object, blender_object)

    def _replacing_fault(self, blender_object: bpy.types.Object) -> str | None:
        """The reason why the object's mesh cannot be replaced, or None."""
        if blender_object.override_library is not None:
            return "the object is a library override; choose New Object, or make it local first"
        if left_out_sculpting(blender_object, use_modifiers=self.use_modifiers):
            return (
                "the sculpting of its Multiresolution modifier would be lost; turn Include Modifiers on and show the "
                "modifier, or choose New Object"
            )
        return None


def _result_fault(blender_object: bpy.types.Object) -> str:
    """The reason why a result is not subdivided."""
    if result_record.is_result(blender_object):
        return (
            f"it is a result already, made from “{blender_object.ccdepth.source_name}”; use Update Result to make it "
            "anew, or turn Subdivide Results on to subdivide it once more"
        )
    return "it was subdivided in place already, and has no source; turn Subdivide Results on to subdivide it once more"
