# SPDX-License-Identifier: GPL-3.0-or-later
"""A subdivision as arrays → a new Blender mesh, with all data of the base mesh."""

from __future__ import annotations

import bpy
import numpy as np

from ..core import FloatArray, PolygonMesh, SubdividedMesh
from .attributes import AttributeTransfer, choose_same
from .blender_arrays import write_values
from .custom_normals import normals_of_surface, smooth_faces, write_normals
from .data_blocks import held, own_copy, remove_shape_keys, removed_on_failure
from .shape_keys import basis_mesh, write_shape_keys
from .vertex_groups import write_groups

# The modifier's default.
UV_SMOOTH = "PRESERVE_BOUNDARIES"


def new_mesh(
    base: bpy.types.Mesh,
    control: PolygonMesh,
    subdivided: SubdividedMesh,
    *,
    uv_smooth: str = UV_SMOOTH,
    exact_normals: bool = False,
    normals: FloatArray | None = None,
) -> bpy.types.Mesh:
    """The subdivision as a mesh of its own, with the materials, attributes, groups, keys and settings of ``base``.

    base: in Object Mode. control: its control mesh, with the same vertices, edges, faces and corners, and explicit
    sharpness. uv_smooth: the modifier's UV Smooth. exact_normals: shade smooth faces with the normals of the limit
    surface. normals: (C, 3), to store in their place; with shape keys the normals are those of the basis.
    ``base`` is not changed. Vertices and edges without faces stay unchanged. Our own values are left out.
    """
    mesh = own_copy(base)
    with removed_on_failure() as made, held(mesh) as holder:
        made.append(mesh.session_uid)
        groups = [(group.name, group.lock_weight) for group in holder.vertex_groups]
        active = holder.vertex_groups.active_index
        remove_shape_keys(holder)
        mesh.clear_geometry()
        mesh.property_unset("ccdepth")
        _write_faces(mesh, subdivided)
        # A group and an attribute can share a name only if the attribute is made first.
        holder.vertex_groups.clear()
        AttributeTransfer(base, control, subdivided, uv_smooth).write(mesh)
        write_groups(holder, groups, base, control, subdivided)
        if groups:
            holder.vertex_groups.active_index = active
        choose_same(base, mesh)
        write_shape_keys(holder, base, control, subdivided)
        if exact_normals and smooth_faces(mesh).any():
            deformable = base.shape_keys is not None or bool(groups)
            if normals is None or base.shape_keys is not None:
                normals = normals_of_surface(basis_mesh(base, control), subdivided)
            write_normals(mesh, normals, deformable=deformable)
    mesh.update()
    return mesh


def _write_faces(mesh: bpy.types.Mesh, subdivided: SubdividedMesh) -> None:
    """Give an empty mesh its vertices, edges and faces."""
    mesh.vertices.add(len(subdivided.positions))
    mesh.edges.add(len(subdivided.edge_vertices))
    mesh.loops.add(len(subdivided.corner_vertices))
    mesh.polygons.add(len(subdivided.base_faces))
    data = mesh.attributes
    write_values(data["position"].data, "vector", subdivided.positions.astype(np.float32))
    write_values(data[".edge_verts"].data, "value", subdivided.edge_vertices)
    write_values(mesh.polygons, "loop_start", subdivided.face_starts[:-1].astype(np.int32))
    write_values(data[".corner_vert"].data, "value", subdivided.corner_vertices)
    write_values(data[".corner_edge"].data, "value", subdivided.corner_edges)
    # Blender selects new elements.
    for name in (".select_vert", ".select_edge", ".select_poly"):
        if name in data:
            data.remove(data[name])
