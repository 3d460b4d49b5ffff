# SPDX-License-Identifier: GPL-3.0-or-later
# mypy: disable-error-code="valid-type"
"""Select by Depth, Select Worst Face, Select Invalid Faces and Repair Mesh, in Object Mode and in Edit Mode."""

from __future__ import annotations

from operator import eq, ge, le
from typing import Any

import bmesh
import bpy
import numpy as np
from bpy.props import BoolProperty, EnumProperty, IntProperty

from ..core import BoolArray, IndexArray, InvalidMeshError, validate
from ..exchange.blender_arrays import face_sizes, find_attribute, read_built_in, read_values, write_values
from ..exchange.control_mesh import read_alone
from ..exchange.evaluated import NO_ORIGIN
from ..exchange.face_values import DEPTH_KIND, read_face_values
from ..exchange.mesh_arrays import mesh_face_count
from ..state import known, mesh_values
from ..state.chosen import chosen
from ..state.still_holds import measured_to_show
from ..tasks.surfaces import ComputeError, Faults
from ..ui.lengths import count_text, printable
from .mesh_operators import QuickOperator
from .refusals import mesh_fault, refuse

# The attributes of Blender's selection in Object Mode, by domain.
SELECTIONS = {"POINT": ".select_vert", "EDGE": ".select_edge", "FACE": ".select_poly"}


def selection_fault(mesh: bpy.types.Mesh) -> str | None:
    """The reason why the faces of a mesh cannot be selected, or None: another attribute has the name of Blender's
    selection.

    Writing a selection over it crashes Blender; Edit Mode keeps its selection elsewhere.
    """
    for domain, name in SELECTIONS.items():
        is_there = not mesh.is_editmode and name in mesh.attributes
        if is_there and find_attribute(mesh, name, "BOOLEAN", domain) is None:
            return (
                f"the mesh has an attribute called “{name}” that is not a selection; enter Edit Mode and leave it, "
                "which replaces the attribute"
            )
    return None


def choose_face_mode(context: bpy.types.Context) -> None:
    """Set face select mode, in Edit Mode: in vertex or edge select mode, faces between the wanted faces would be
    selected as well."""
    if context.mode == "EDIT_MESH":
        context.scene.tool_settings.mesh_select_mode = (False, False, True)


def select_faces(mesh: bpy.types.Mesh, wanted: BoolArray, *, extend: bool = False) -> int:
    """Select the visible faces among the wanted (F,), and unless ``extend`` nothing else; returns their number."""
    visible = wanted & ~_hidden(mesh)
    if mesh.is_editmode:
        _select_while_editing(mesh, visible, extend)
    else:
        _select_only(mesh, visible | (read_values(mesh.polygons, "select", np.bool_) & extend))
    return int(np.count_nonzero(visible))


def select_these(mesh: bpy.types.Mesh, faces: IndexArray) -> int:
    """Select the visible faces among these (N,) and nothing else, and make the first of them active; returns their
    number. If all are hidden, nothing changes."""
    visible = faces[~_hidden(mesh)[faces]]
    if len(visible):
        wanted = np.zeros(mesh_face_count(mesh), dtype=np.bool_)
        wanted[visible] = True
        select_faces(mesh, wanted)
        if mesh.is_editmode:
            edited = _edited(mesh)
            edited.faces.active = edited.faces[visible[0]]
        else:
            mesh.polygons.active = int(visible[0])
    return len(visible)


def _edited(mesh: bpy.types.Mesh) -> Any:
    """The edited mesh, with faces accessible by number."""
    edited = bmesh.from_edit_mesh(mesh)
    edited.faces.ensure_lookup_table()
    return edited


def _hidden(mesh: bpy.types.Mesh) -> BoolArray:
    """(F,): whether each face is hidden."""
    if mesh.is_editmode:
        return np.array([face.hide for face in _edited(mesh).faces], dtype=np.bool_)
    return read_values(mesh.polygons, "hide", np.bool_)


def _select_only(mesh: bpy.types.Mesh, faces: BoolArray) -> None:
    """Select these faces with their vertices and edges, and nothing else."""
    corners = np.repeat(faces, face_sizes(mesh))
    for name, elements, attribute in (
        ("vertices", mesh.vertices, ".corner_vert"),
        ("edges", mesh.edges, ".corner_edge"),
    ):
        touched = np.zeros(len(elements), dtype=np.bool_)
        touched[read_values(mesh.attributes[attribute].data, "value", np.int32)[corners]] = True
        getattr(mesh, name).foreach_set("select", touched)
    mesh.polygons.foreach_set("select", faces)
    known.note_selected(mesh)
    mesh.update()


def _select_while_editing(mesh: bpy.types.Mesh, faces: BoolArray, extend: bool) -> None:
    edited = _edited(mesh)
    edited.select_mode = {"FACE"}
    for face in edited.faces if not extend else ():
        face.select_set(False)
    for face in np.flatnonzero(faces).tolist():
        edited.faces[face].select_set(True)
    edited.select_flush_mode()
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)


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
        refuse(meshes, selection_fault)
        if not self.properties.is_property_set("depth"):
            self.depth = max(mesh.ccdepth.deepest for mesh in meshes)
        selected = 0
        for mesh in meshes:
            wanted = COMPARISONS[self.comparison](read_face_values(mesh, DEPTH_KIND), self.depth)
            selected += select_faces(mesh, wanted, extend=self.extend)
        if self.edit:
            context.scene.tool_settings.mesh_select_mode = (False, False, True)
            bpy.ops.object.mode_set(mode="EDIT")
        choose_face_mode(context)
        self.report({"INFO"}, f"{count_text(selected, 'face', 'faces')} selected")
        return {"FINISHED"}


class CCDEPTH_OT_select_worst(QuickOperator):
    """Select the face with the largest deviation in the measurement shown"""

    bl_idname = "ccdepth.select_worst"
    bl_label = "Select Worst Face"

    # Without SKIP_SAVE the plain button would frame as well, once the one beside was pressed.
    frame: BoolProperty(name="Frame", description="Move the 3D View to the face", default=False, options={"SKIP_SAVE"})

    @classmethod
    def description(cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties) -> str:
        return f"{cls.__doc__}, and move the 3D View to the face" if properties.frame else ""

    @classmethod
    def missing(cls, context: bpy.types.Context) -> str | None:
        return None if _measured_objects(context) else "Measure Deviation first"

    def act(self, context: bpy.types.Context) -> set[str]:
        worst = _worst(context)
        mesh, found = worst.data, worst.data.ccdepth.measurement
        if self.frame:
            _frame(context, worst)
        if found.worst_face < 0:
            self.report(
                {"WARNING"},
                f"{printable(worst.name)}: the largest deviation is on a face that modifiers added",
            )
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        if mesh_face_count(mesh) != found.faces:
            raise ComputeError(f"{worst.name}: the mesh has changed; measure it again")
        refuse([mesh], selection_fault)
        if not select_these(mesh, np.array([found.worst_face])):
            self.report({"WARNING"}, f"{printable(worst.name)}: the face with the largest deviation is hidden")
            return {"FINISHED"} if self.frame else {"CANCELLED"}
        choose_face_mode(context)
        self.report({"INFO"}, f"{printable(worst.name)}: face {found.worst_face} selected")
        return {"FINISHED"}


def _measured_objects(context: bpy.types.Context) -> list[bpy.types.Object]:
    return [each for each in chosen(context) if mesh_values.has_deviation(each.data)]


def _worst(context: bpy.types.Context) -> bpy.types.Object:
    """The object whose deviation panel and label show; without one, the worst."""
    measured, shown = _measured_objects(context), measured_to_show(context)
    if shown is not None and shown in measured:
        return shown
    return max(measured, key=lambda each: each.data.ccdepth.deviation_reached)


def _frame(context: bpy.types.Context, worst: bpy.types.Object) -> None:
    """Move the operator's 3D View, or else all 3D Views, to the worst place of an object."""
    for region in _regions(context):
        region.view_location = worst.data.ccdepth.measurement.worst_point
        if region.view_perspective == "CAMERA":
            region.view_perspective = "PERSP"


def _regions(context: bpy.types.Context) -> list[bpy.types.RegionView3D]:
    space = context.space_data
    if space is not None and space.type == "VIEW_3D":
        return [space.region_3d]
    screens = [window.screen for window in context.window_manager.windows]
    return [area.spaces.active.region_3d for screen in screens for area in screen.areas if area.type == "VIEW_3D"]


class CCDEPTH_OT_select_invalid(QuickOperator):
    """Select the faces without a limit surface: faces that visit a vertex twice, or have a vertex at no finite
    position"""

    bl_idname = "ccdepth.select_invalid"
    bl_label = "Select Invalid Faces"

    def act(self, context: bpy.types.Context) -> set[str]:
        invalid = _invalid_faces(context)
        refuse(invalid, selection_fault)
        if not invalid:
            known.note_refused({})
            self.report({"INFO"}, "No face is invalid")
            return {"CANCELLED"}
        found = sum(map(len, invalid.values()))
        selected = sum(select_these(mesh, faces) for mesh, faces in invalid.items())
        if selected < found:
            self.report({"WARNING"}, f"{count_text(found - selected, 'invalid face is', 'invalid faces are')} hidden")
        if not selected:
            return {"CANCELLED"}
        choose_face_mode(context)
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
    control = read_alone(context, blender_object, use_modifiers=context.scene.ccdepth.use_modifiers)
    try:
        validate(control.mesh)
    except InvalidMeshError as fault:
        faces = fault.faces if control.base_faces is None else control.base_faces[fault.faces]
        own = np.unique(faces[faces != NO_ORIGIN])
        if not len(own):
            raise
        return own
    return np.zeros(0, dtype=np.intp)
