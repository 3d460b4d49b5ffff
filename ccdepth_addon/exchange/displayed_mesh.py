# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender object → its mesh in the viewport, with the modifiers that show there: triangles for measuring; triangles and
edges with a value for each face for the overlay."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import FloatArray, IndexArray, InvalidMeshError
from .blender_arrays import face_sizes, products, read_built_in, read_values
from .control_mesh import ControlMeshError
from .evaluated import evaluated
from .face_values import AttributeKind, has_values
from .mesh_arrays import own_mesh
from .modifiers import SIMULATIONS, is_evaluated, shown_modifiers


@dataclass(frozen=True)
class Triangles:
    """Triangles of an object. positions: (V, 3) float64, of vertices with triangles. corners: (T, 3) intp, the vertices
    of each triangle. faces: (T,) intp, the origin of each triangle among the faces of the object's own mesh, or
    ``NO_ORIGIN``. normals: (T, 3, 3), the normals that corners are shaded with, if known."""

    positions: FloatArray
    corners: IndexArray
    faces: IndexArray
    normals: FloatArray | None = None


@dataclass(frozen=True)
class ShownMesh:
    """The mesh an object shows. triangles: in object space. linear, location: (3, 3), (3,) float64, of its matrix."""

    triangles: Triangles
    linear: FloatArray
    location: FloatArray

    def positions_from(self, origin: FloatArray) -> FloatArray:
        """(V, 3): the positions in the scene, relative to a point."""
        return products(self.triangles.positions, self.linear) + (self.location - origin)

    def normals(self) -> FloatArray | None:
        """(T, 3, 3): unit normals at the corners of the triangles in the scene, if known."""
        if self.triangles.normals is None:
            return None
        # Normals go by the cofactors, which turn them over where the matrix mirrors, as the triangles are turned over.
        cofactors = np.cross(self.linear[[1, 2, 0]], self.linear[[2, 0, 1]])
        normals = self.triangles.normals @ cofactors.T
        lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
        return np.divide(normals, lengths, out=normals, where=lengths > 0)

    def rounding_from(self, origin: FloatArray) -> float:
        """The largest rounding error of positions from ``positions_from``.

        Each coordinate is a sum of four terms: at most six roundings of u = 2⁻⁵³ each, of the sum of the terms'
        absolute values; three coordinates make √3 of that, and so 16u is enough.
        """
        largest = np.abs(self.triangles.positions).max(axis=0, initial=0.0)
        terms = np.abs(self.linear) @ largest + np.abs(self.location) + np.abs(origin)
        return float(16 * 2.0**-53 * terms.max())


def read_shown_mesh(context: bpy.types.Context, blender_object: bpy.types.Object) -> ShownMesh:
    """The mesh that the object shows now; in Edit Mode, the edited mesh.

    The file is not changed. Raises ControlMeshError for a mesh made by a simulation, and InvalidMeshError for a mesh
    without faces, or with vertices at no finite position.
    """
    matrix = np.array(blender_object.evaluated_get(context.evaluated_depsgraph_get()).matrix_world, dtype=np.float64)
    if not np.isfinite(matrix).all():
        raise InvalidMeshError("the object is at no finite place")
    shown = shown_modifiers(blender_object)
    for modifier in shown:
        if modifier.type in SIMULATIONS:
            raise ControlMeshError(
                f"the modifier “{modifier.name}” is a simulation, which cannot be measured: apply it, or hide it"
            )
    if is_evaluated(blender_object, shown):
        with evaluated(context, {blender_object: shown}) as copies:
            triangles = _triangles(*copies.made(blender_object))
    else:
        with own_mesh(blender_object) as own:
            triangles = _triangles(own, np.arange(len(own.polygons)))
    return ShownMesh(triangles, matrix[:3, :3], matrix[:3, 3])


def _triangles(mesh: bpy.types.Mesh, face_origins: IndexArray) -> Triangles:
    """The triangles that Blender draws of a mesh, given the origins of its faces."""
    mesh.calc_loop_triangles()
    corners = read_values(mesh.loop_triangles, "loops", np.int32, 3)
    if not len(corners):
        raise InvalidMeshError("the object shows no faces")
    faces = read_values(mesh.loop_triangles, "polygon_index", np.int32)
    vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)[corners]
    positions = read_built_in(mesh.attributes, "position", "vector", np.float32, 3).astype(np.float64)
    used = np.zeros(len(positions), dtype=bool)
    used[vertices] = True
    nowhere = int(np.count_nonzero(~np.isfinite(positions[used]).all(axis=1)))
    if nowhere:
        raise InvalidMeshError(f"it shows {nowhere:,} {'vertex' if nowhere == 1 else 'vertices'} at no finite position")
    normals = read_values(mesh.corner_normals, "vector", np.float32, 3).astype(np.float64)[corners]
    return Triangles(positions[used], (np.cumsum(used) - 1)[vertices], face_origins[faces], normals)


# Edges of larger meshes are too many to be seen, and take long to draw.
MOST_EDGES = 400_000


@dataclass(frozen=True)
class DisplayedMesh:
    """A mesh to draw. corners: (C, 3) float32, the place of each corner of a face. values: (C,), the value of the
    corner's face. triangles: (T, 3) int32, of corners. chosen: (S, 3), the triangles of selected faces, if wanted.
    edges: (E, 2, 3) float32, the ends of edges with faces; none of a very large mesh."""

    corners: NDArray[np.float32]
    values: NDArray[np.int32] | NDArray[np.float32]
    triangles: NDArray[np.int32]
    chosen: NDArray[np.int32]
    edges: NDArray[np.float32]


def read_displayed_mesh(
    mesh: bpy.types.Mesh, kind: AttributeKind, *, with_hidden: bool, with_chosen: bool
) -> DisplayedMesh | None:
    """The faces and values that a viewport draws of an evaluated mesh; None without such values.

    with_hidden: whether hidden faces are drawn as well, as in Object Mode. with_chosen: whether selected faces are
    drawn differently.
    """
    face_count, corner_count = len(mesh.polygons), len(mesh.loops)
    if not has_values(mesh, kind) or not 0 < face_count == len(mesh.attributes[kind.name].data):
        return None
    positions = read_built_in(mesh.attributes, "position", "vector", np.float32, 3)
    corner_vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)
    sizes = face_sizes(mesh)
    values = np.repeat(read_values(mesh.attributes[kind.name].data, "value", kind.values.dtype), sizes)
    # The viewport's own diagonals: others would cross the surface it draws of a bent quad.
    mesh.calc_loop_triangles()
    triangles = read_values(mesh.loop_triangles, "loops", np.int32, 3)
    shown = np.ones(corner_count, dtype=np.bool_)
    if not with_hidden and ".hide_poly" in mesh.attributes:
        shown = np.repeat(~read_values(mesh.polygons, "hide", np.bool_), sizes)
        triangles = np.ascontiguousarray(triangles[shown[triangles[:, 0]]])
    chosen = triangles[:0]
    if with_chosen:
        selected = np.repeat(read_values(mesh.polygons, "select", np.bool_), sizes)
        chosen = np.ascontiguousarray(triangles[selected[triangles[:, 0]]])
    edges = np.empty((0, 2, 3), dtype=np.float32)
    if len(mesh.edges) <= MOST_EDGES:
        of_faces = np.zeros(len(mesh.edges), dtype=np.bool_)
        of_faces[read_built_in(mesh.attributes, ".corner_edge", "value", np.int32)[shown]] = True
        ends = read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2)[of_faces]
        edges = positions[ends]
    return DisplayedMesh(positions[corner_vertices], values, triangles, chosen, edges)
