# SPDX-License-Identifier: GPL-3.0-or-later
"""Selection of faces, in Object Mode and in Edit Mode."""

from __future__ import annotations

from typing import Any

import bmesh
import bpy
import numpy as np

from ..core import BoolArray, IndexArray
from ..exchange.blender_arrays import face_sizes, find_attribute, read_values
from ..exchange.mesh_arrays import mesh_face_count
from ..state import known

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
