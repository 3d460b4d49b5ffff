# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit surface's own normals as custom normals."""

from __future__ import annotations

import bpy

from ..core import PolygonMesh, SubdividedMesh, at_corners, limit_normals
from .attributes import CUSTOM_NORMAL, FREE_NORMALS, write_attribute
from .bulk_writing import WriteError


def write_limit_normals(
    mesh: bpy.types.Mesh, control: PolygonMesh, subdivided: SubdividedMesh, *, deformable: bool
) -> None:
    """Shade a new mesh, which has its positions, with the normals of the limit surface, on both sides of every crease.

    All faces become smooth ones: flat ones would not show them. deformable: whether the normals have to follow when
    the vertices move, which only those stored as angles do. Raises WriteError where another attribute has their name.
    """
    if CUSTOM_NORMAL in mesh.attributes:
        raise WriteError(
            f"the mesh has an attribute of its own called “{CUSTOM_NORMAL}”, where exact normals go; rename it"
        )
    normals = at_corners(subdivided, lambda points: limit_normals(control, points))
    flat = mesh.attributes.get("sharp_face")
    if flat is not None and (flat.data_type, flat.domain) == ("BOOLEAN", "FACE"):
        mesh.attributes.remove(flat)
    if bpy.app.version >= FREE_NORMALS and not deformable:
        write_attribute(mesh, CUSTOM_NORMAL, "FLOAT_VECTOR", "CORNER", normals)
        return
    mesh.update()
    # A list of lists takes Blender a third of the time that an array does.
    mesh.normals_split_custom_set(normals.tolist())
