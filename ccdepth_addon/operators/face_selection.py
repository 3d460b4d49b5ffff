# SPDX-License-Identifier: GPL-3.0-or-later
"""Select faces by depth or by number, in Object Mode and in Edit Mode."""

from __future__ import annotations

from operator import eq, ge, le

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import BoolArray, IndexArray
from ..exchange.bulk_reading import read_values
from ..exchange.result_attributes import DEPTH
from ..state import chosen_faces

COMPARISONS = {"EQUAL": eq, "AT_LEAST": ge, "AT_MOST": le}

# Where Blender keeps what is selected in Object Mode, by domain.
SELECTIONS = {"POINT": ".select_vert", "EDGE": ".select_edge", "FACE": ".select_poly"}


def selection_fault(mesh: bpy.types.Mesh) -> str | None:
    """Why the faces of a mesh cannot be selected: another attribute has the name of Blender's selection.

    Writing a selection over it crashes Blender; Edit Mode keeps its selection elsewhere.
    """
    for domain, name in SELECTIONS.items():
        attribute = None if mesh.is_editmode else mesh.attributes.get(name)
        if attribute is not None and (attribute.data_type, attribute.domain) != ("BOOLEAN", domain):
            return f"the mesh has an attribute called “{name}” that is not a selection; remove it first"
    return None


def choose_face_mode(context: bpy.types.Context) -> None:
    """Set the select mode of Edit Mode, while it is on: with vertices or edges selected instead, faces between the
    wanted ones would be selected as well."""
    if context.mode == "EDIT_MESH":
        context.tool_settings.mesh_select_mode = (False, False, True)


def select_faces(mesh: bpy.types.Mesh, depth: int, comparison: str, *, extend: bool) -> int:
    """Select the visible faces whose depth compares so with ``depth``; returns how many there are."""
    if mesh.is_editmode:
        return _select_while_editing(mesh, depth, comparison, extend)
    depths = read_values(mesh.attributes[DEPTH].data, "value", np.int32)
    visible = ~read_values(mesh.polygons, "hide", np.bool_)
    wanted = COMPARISONS[comparison](depths, depth) & visible
    faces = wanted | (read_values(mesh.polygons, "select", np.bool_) & extend)
    _select_only(mesh, faces)
    return int(np.count_nonzero(wanted))


def _select_only(mesh: bpy.types.Mesh, faces: BoolArray) -> None:
    """Select these faces with their vertices and edges, and nothing else."""
    sizes = np.diff(read_values(mesh.polygons, "loop_start", np.int32), append=len(mesh.loops))
    corners = np.repeat(faces, sizes)
    for name, elements, attribute in (
        ("vertices", mesh.vertices, ".corner_vert"),
        ("edges", mesh.edges, ".corner_edge"),
    ):
        touched = np.zeros(len(elements), dtype=np.bool_)
        touched[read_values(mesh.attributes[attribute].data, "value", np.int32)[corners]] = True
        getattr(mesh, name).foreach_set("select", touched)
    mesh.polygons.foreach_set("select", faces)
    chosen_faces.note(mesh)
    mesh.update()


def _select_while_editing(mesh: bpy.types.Mesh, depth: int, comparison: str, extend: bool) -> int:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    compare = COMPARISONS[comparison]
    layer = edited.faces.layers.int[DEPTH]
    edited.select_mode = {"FACE"}
    if not extend:
        for face in edited.faces:
            face.select_set(False)
    wanted = [face for face in edited.faces if not face.hide and compare(face[layer], depth)]
    for face in wanted:
        face.select_set(True)
    edited.select_flush_mode()
    bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
    return len(wanted)


def select_these(mesh: bpy.types.Mesh, faces: IndexArray) -> int:
    """Select the visible ones of these faces (N,) and nothing else, and make the first of them the active one; returns
    how many there are. When all are hidden everything stays as it was."""
    if mesh.is_editmode:
        return _select_these_while_editing(mesh, faces)
    visible = faces[~read_values(mesh.polygons, "hide", np.bool_)[faces]]
    if len(visible):
        chosen = np.zeros(len(mesh.polygons), dtype=np.bool_)
        chosen[visible] = True
        _select_only(mesh, chosen)
        mesh.polygons.active = int(visible[0])
    return len(visible)


def _select_these_while_editing(mesh: bpy.types.Mesh, faces: IndexArray) -> int:
    import bmesh

    edited = bmesh.from_edit_mesh(mesh)
    edited.faces.ensure_lookup_table()
    visible = [edited.faces[face] for face in faces.tolist() if not edited.faces[face].hide]
    if visible:
        edited.select_mode = {"FACE"}
        for other in edited.faces:
            other.select_set(False)
        for face in visible:
            face.select_set(True)
        edited.faces.active = visible[0]
        edited.select_flush_mode()
        bmesh.update_edit_mesh(mesh, loop_triangles=False, destructive=False)
    return len(visible)


def face_points(mesh: bpy.types.Mesh, face: int) -> NDArray[np.float64]:
    """(n, 3): the corners of a face in object space."""
    if mesh.is_editmode:
        import bmesh

        edited = bmesh.from_edit_mesh(mesh)
        edited.faces.ensure_lookup_table()
        return np.array([corner.co for corner in edited.faces[face].verts])
    return np.array([mesh.vertices[vertex].co for vertex in mesh.polygons[face].vertices])
