# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit surface's own normals as custom normals; flat faces keep theirs."""

from __future__ import annotations

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import PolygonMesh, SubdividedMesh, at_corners, limit_normals
from .attributes import CUSTOM_NORMAL, FREE_NORMALS
from .blender_arrays import face_sizes, find_attribute, read_values, write_attribute
from .data_blocks import unused_name

# The prefix of temporary attributes for custom normals.
CARRIED_NORMAL = "ccdepth_normal"


def normals_of_surface(control: PolygonMesh, subdivided: SubdividedMesh) -> NDArray[np.floating]:
    """(C, 3): the normals of the limit surface at the corners, on both sides of every crease."""
    return at_corners(subdivided, lambda points: limit_normals(control, points))


def write_normals(mesh: bpy.types.Mesh, normals: NDArray[np.floating], *, deformable: bool) -> None:
    """Shade a new mesh, which has its positions, with normals (C, 3) at the corners of its smooth faces.

    deformable: whether the normals have to follow moving vertices, as only normals stored as angles do. Another
    attribute with their name gets a number.
    """
    if CUSTOM_NORMAL in mesh.attributes:
        mesh.attributes[CUSTOM_NORMAL].name = unused_name(CUSTOM_NORMAL, mesh.attributes)
    _store(mesh, normals, deformable=deformable)


def _store(mesh: bpy.types.Mesh, normals: NDArray[np.floating], *, deformable: bool) -> None:
    """Shade with normals (C, 3) at the corners of smooth faces. Flat faces store their own normals, as Blender draws
    stored vectors on them too."""
    mesh.update()
    is_smooth = smooth_faces(mesh)
    if not is_smooth.all():
        sizes = face_sizes(mesh)
        own = read_values(mesh.polygon_normals, "vector", np.float32, 3)
        normals = np.where(np.repeat(is_smooth, sizes)[:, None], normals, np.repeat(own, sizes, axis=0))
    if bpy.app.version >= FREE_NORMALS and not deformable:
        write_attribute(mesh, CUSTOM_NORMAL, "FLOAT_VECTOR", "CORNER", normals)
        return
    # A list of lists takes Blender a third of the time that an array does.
    mesh.normals_split_custom_set(normals.tolist())


def remove_normals(mesh: bpy.types.Mesh) -> None:
    """Remove the custom normals of a mesh, in Object Mode."""
    # Before Blender 4.5 they are no attribute.
    with bpy.context.temp_override(mesh=mesh):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()


def smooth_faces(mesh: bpy.types.Mesh) -> NDArray[np.bool_]:
    """(F,): whether faces are shaded smooth."""
    flat = find_attribute(mesh, "sharp_face", "BOOLEAN", "FACE")
    return np.ones(len(mesh.polygons), dtype=bool) if flat is None else ~read_values(flat.data, "value", np.bool_)


class CarriedNormals:
    """Custom normals carried through modifiers, which interpolate them as a plain attribute of corners."""

    def __init__(self, mesh: bpy.types.Mesh) -> None:
        """Write the attribute."""
        self._name = unused_name(CARRIED_NORMAL, mesh.attributes)
        normals = read_values(mesh.corner_normals, "vector", np.float32, 3)
        write_attribute(mesh, self._name, "FLOAT_VECTOR", "CORNER", normals)

    def put_back(self, mesh: bpy.types.Mesh, *, deformable: bool) -> None:
        """Turn the attribute of a mesh that modifiers made into custom normals."""
        carried = mesh.attributes[self._name]
        normals = read_values(carried.data, "vector", np.float32, 3)
        mesh.attributes.remove(carried)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        # Blender takes its own normal where one is zero.
        _store(mesh, np.divide(normals, lengths, out=normals, where=lengths > 0), deformable=deformable)
