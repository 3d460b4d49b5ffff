# SPDX-License-Identifier: GPL-3.0-or-later
"""Select Invalid Faces and Repair Mesh."""

from __future__ import annotations

import bpy
import numpy as np

from ..core import IndexArray, InvalidMeshError, validate
from ..exchange.blender_arrays import read_built_in, write_values
from ..exchange.control_mesh import read_control_mesh
from ..exchange.evaluated import NO_ORIGIN
from ..state import known
from ..state.chosen import chosen
from ..tasks.surfaces import Faults
from . import face_selection
from .selected_meshes import QuickOperator, count_text, mesh_fault, refuse


class CCDEPTH_OT_select_invalid(QuickOperator):
    """Select the faces without a limit surface: faces that visit a vertex twice, or have a vertex at no finite
    position"""

    bl_idname = "ccdepth.select_invalid"
    bl_label = "Select Invalid Faces"

    def act(self, context: bpy.types.Context) -> set[str]:
        invalid = _invalid_faces(context)
        refuse(invalid, face_selection.selection_fault)
        if not invalid:
            known.note_refused({})
            self.report({"INFO"}, "No face is invalid")
            return {"CANCELLED"}
        found = sum(map(len, invalid.values()))
        selected = sum(face_selection.select_these(mesh, faces) for mesh, faces in invalid.items())
        if selected < found:
            self.report({"WARNING"}, f"{count_text(found - selected, 'invalid face is', 'invalid faces are')} hidden")
        if not selected:
            return {"CANCELLED"}
        face_selection.choose_face_mode(context)
        self.report({"INFO"}, f"{count_text(selected, 'invalid face', 'invalid faces')} selected")
        return {"FINISHED"}


class CCDEPTH_OT_repair(QuickOperator):
    """Remove invalid faces and duplicate faces from the selected meshes, and move vertices at no finite position to
    the origin"""

    bl_idname = "ccdepth.repair"
    bl_label = "Repair Mesh"
    not_in_edit_mode = "Works in Object Mode; in Edit Mode, delete the faces"

    def act(self, context: bpy.types.Context) -> set[str]:
        meshes = list(_invalid_faces(context))
        refuse(meshes, mesh_fault)
        before = sum(len(mesh.polygons) for mesh in meshes)
        moved = sum(map(_move_to_origin, meshes))
        # Edit Mode is no way to do it: Blender 5 does not come back from there with triangles that are none.
        repaired = [mesh for mesh in meshes if mesh.validate(clean_customdata=False)]
        known.note_refused({})
        if not (moved or repaired):
            self.report({"INFO"}, "There is nothing that Blender can repair")
            return {"CANCELLED"}
        removed = before - sum(len(mesh.polygons) for mesh in meshes)
        to_origin = f", {count_text(moved, 'vertex', 'vertices')} moved to the origin" if moved else ""
        self.report({"INFO"}, f"{count_text(removed, 'face', 'faces')} removed{to_origin}")
        return {"FINISHED"}


def _move_to_origin(mesh: bpy.types.Mesh) -> int:
    """Move the vertices at no finite position to the origin; returns their number. Before version 5.2 Blender sets
    their single coordinates that are not finite to 0, and does not say so."""
    positions = read_built_in(mesh.attributes, "position", "vector", np.float32, 3)
    is_nowhere = ~np.isfinite(positions).all(axis=1)
    if is_nowhere.any():
        positions[is_nowhere] = 0.0
        write_values(mesh.attributes["position"].data, "vector", positions)
    return int(np.count_nonzero(is_nowhere))


def _invalid_faces(context: bpy.types.Context) -> dict[bpy.types.Mesh, IndexArray]:
    """The faces at fault, ascending, of each mesh with any. Raises ComputeError, naming the objects, if only meshes as
    a whole are at fault."""
    objects = chosen(context)
    faults = Faults(objects)
    found: dict[bpy.types.Mesh, IndexArray] = {}
    for each in objects:
        with faults.of(each.session_uid):
            faces = _own_faces_at_fault(context, each)
            if len(faces):
                found[each.data] = np.union1d(found.get(each.data, faces), faces)
    if not found:
        faults.refuse()
    return found


def _own_faces_at_fault(context: bpy.types.Context, blender_object: bpy.types.Object) -> IndexArray:
    """The invalid faces of the object's own mesh. Raises InvalidMeshError if only faces of modifiers, or no faces, are
    at fault."""
    control = read_control_mesh(context, blender_object, use_modifiers=context.scene.ccdepth.use_modifiers)
    try:
        validate(control.mesh)
    except InvalidMeshError as fault:
        faces = fault.faces if control.base_faces is None else control.base_faces[fault.faces]
        own = np.unique(faces[faces != NO_ORIGIN])
        if not len(own):
            raise
        return own
    return np.zeros(0, dtype=np.intp)
