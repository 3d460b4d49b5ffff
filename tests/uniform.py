# SPDX-License-Identifier: GPL-3.0-or-later
"""Every face subdivided as often as every other, as the Subdivision Surface modifier does, to compare with it."""

import numpy as np

from ccdepth_addon.core.adaptive.subdivided_mesh import SubdividedMesh
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests.brute_force import SQUARE, linear_children
from tests.nets import refined


def uniform(mesh: PolygonMesh, level: int) -> SubdividedMesh:
    """The mesh, with explicit sharpness and without loose parts, at a level from 1 up, on its limit surface."""
    fine = mesh
    base_edges = np.arange(mesh.edge_count)
    vertex_edges = np.full(mesh.vertex_count, -1)
    for _ in range(level):
        inner = np.full(fine.corner_count + fine.face_count, -1)
        vertex_edges = np.concatenate([vertex_edges, base_edges, inner[: fine.face_count]])
        base_edges = np.concatenate([np.repeat(base_edges, 2), inner[: fine.corner_count]])
        fine = subdivide(fine)
    points = uniform_points(mesh, level)
    _, first = np.unique(fine.corner_vertices, return_index=True)
    base_vertices = np.full(fine.vertex_count, -1)
    base_vertices[: mesh.vertex_count] = np.arange(mesh.vertex_count)
    return SubdividedMesh(
        find_vertex_points=lambda: points.at(first),
        positions=limit_positions(fine),
        face_starts=fine.face_starts,
        corner_vertices=fine.corner_vertices.astype(np.int32),
        corner_edges=fine.corner_edges.astype(np.int32),
        edge_vertices=fine.edge_vertices.astype(np.int32),
        find_corner_points=lambda: points,
        base_faces=mesh.corner_faces[points.corners[::4]].astype(np.int32),
        base_edges=base_edges.astype(np.int32),
        base_vertices=base_vertices.astype(np.int32),
        vertex_edges=vertex_edges.astype(np.int32),
    )


def uniform_points(mesh: PolygonMesh, level: int) -> SurfacePoints:
    """Where the corners of the mesh at that level lie, in their order."""
    corners = np.arange(mesh.corner_count)
    parameters = np.tile(SQUARE, (mesh.corner_count, 1))
    fine = subdivide(mesh)
    for _ in range(level - 1):
        parameters = linear_children(fine, parameters)
        fine = subdivide(fine)
    return SurfacePoints(np.repeat(corners, 4**level), parameters)


def refined_values(mesh: PolygonMesh, values: FloatArray, level: int, *, limit: bool) -> FloatArray:
    """(C, D): values (V, D) at the vertices after so many levels, or their limits there, at the fine corners."""
    return fine_values(mesh, values, level, limit=limit)[refined(mesh, level).corner_vertices]


def fine_values(mesh: PolygonMesh, values: FloatArray, level: int, *, limit: bool) -> FloatArray:
    """(fine V, D) the same at the fine vertices."""
    fine = refined(mesh.changed(positions=values), level)
    return limit_positions(fine) if limit else fine.positions
