# SPDX-License-Identifier: GPL-3.0-or-later
"""One Catmull-Clark step of a mesh with sharp features.

Smooth rules after Catmull and Clark, *Recursively generated B-spline surfaces on arbitrary topological meshes*, 1978;
sharp ones after the sources of ``sharpness``.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import sums_by_index
from ..mesh.polygon_mesh import PolygonMesh
from .sharpness import VertexRule, decremented, has_semi_sharp, rules_of


def subdivide(mesh: PolygonMesh) -> PolygonMesh:
    """The mesh after one Catmull-Clark step. Its sharpness has to be explicit (``apply_boundary_rule``).

    Every corner of the mesh becomes a quad, in the order of the corners: vertex point of the corner, edge point of
    the edge it leaves along, face point, edge point of the edge before. The new vertices are the vertex points 0 to
    V - 1, the edge points V to V + E - 1, then the face points; the new edges are the halves of each edge (2e at its
    first end, 2e + 1 at its second), then for each corner the one from its edge point to the face point.
    The halves of an edge and the vertex points keep their parent's sharpness less 1; all else is smooth.
    """
    before = mesh.previous_corner
    edge_points = mesh.vertex_count + np.arange(mesh.edge_count)
    face_points = mesh.vertex_count + mesh.edge_count + mesh.corner_faces
    inner_edges = 2 * mesh.edge_count + np.arange(mesh.corner_count)
    corner_edge_points = edge_points[mesh.corner_edges]
    quads = np.stack([mesh.corner_vertices, corner_edge_points, face_points, corner_edge_points[before]], axis=1)
    outgoing, incoming = _half_edges_at_corners(mesh)
    quad_edges = np.stack([outgoing, inner_edges, inner_edges[before], incoming], axis=1)
    halves = np.stack([mesh.edge_vertices, np.broadcast_to(edge_points[:, None], (mesh.edge_count, 2))], axis=2)
    inner_ends = np.stack([corner_edge_points, face_points], axis=1)
    softer = decremented(mesh.edge_sharpness)
    smooth_count = mesh.edge_count + mesh.face_count
    return PolygonMesh(
        positions=np.concatenate(refined_points(mesh)),
        face_starts=np.arange(0, 4 * mesh.corner_count + 1, 4),
        corner_vertices=quads.reshape(-1),
        corner_edges=quad_edges.reshape(-1),
        edge_vertices=np.concatenate([halves.reshape(-1, 2), inner_ends]),
        edge_sharpness=np.concatenate([np.repeat(softer, 2), np.zeros(mesh.corner_count)]),
        vertex_sharpness=np.concatenate([decremented(mesh.vertex_sharpness), np.zeros(smooth_count)]),
        sharpness_is_explicit=mesh.sharpness_is_explicit,
    )


def _half_edges_at_corners(mesh: PolygonMesh) -> tuple[IndexArray, IndexArray]:
    """(C,) intp twice: the refined edges that leave and enter the vertex of each corner along its face's border."""
    before = mesh.previous_corner
    starts_at_second = mesh.edge_vertices[mesh.corner_edges, 1] == mesh.corner_vertices
    outgoing = 2 * mesh.corner_edges + starts_at_second
    incoming = 2 * mesh.corner_edges[before] + ~starts_at_second[before]
    return outgoing, incoming


def refined_points(mesh: PolygonMesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The vertex points (V, 3), edge points (E, 3) and face points (F, 3) of one step."""
    face_points = np.add.reduceat(mesh.positions[mesh.corner_vertices], mesh.face_starts[:-1])
    face_points /= mesh.face_sizes[:, None]
    corner_face_points = face_points[mesh.corner_faces]
    return _vertex_points(mesh, corner_face_points), _edge_points(mesh, corner_face_points), face_points


def _edge_points(mesh: PolygonMesh, corner_face_points: FloatArray) -> FloatArray:
    midpoints = 0.5 * (mesh.positions[mesh.edge_vertices[:, 0]] + mesh.positions[mesh.edge_vertices[:, 1]])
    sums = sums_by_index(mesh.corner_edges, corner_face_points, mesh.edge_count)
    face_points = sums / np.maximum(mesh.edge_face_counts, 1)[:, None]
    smoothness = 0.5 * (1.0 - np.minimum(mesh.edge_sharpness, 1.0))
    return midpoints + smoothness[:, None] * (face_points - midpoints)


def _vertex_points(mesh: PolygonMesh, corner_face_points: FloatArray) -> FloatArray:
    """(V, 3): the vertex points; where a sharpness ends in this step, the rules before and after it are blended."""
    faces = np.maximum(mesh.vertex_face_counts, 1)[:, None].astype(np.float64)
    neighbours = _edge_end_sums(mesh, mesh.edge_face_counts > 0)
    face_points = sums_by_index(mesh.corner_vertices, corner_face_points, mesh.vertex_count)
    smooth = ((faces - 2.0) * mesh.positions + (neighbours + face_points) / faces) / faces
    parent = _by_rule(mesh, smooth, mesh.edge_sharpness > 0, mesh.vertex_sharpness > 0)
    if not has_semi_sharp(mesh).any():
        return parent
    child = _by_rule(mesh, smooth, mesh.edge_sharpness > 1, mesh.vertex_sharpness > 1)
    return child + _parent_weights(mesh)[:, None] * (parent - child)


def _by_rule(mesh: PolygonMesh, smooth: FloatArray, sharp_edges: BoolArray, sharp_vertices: BoolArray) -> FloatArray:
    """(V, 3): the vertex points for given sharp edges and vertices; ``smooth`` at smooth and dart vertices."""
    rules = rules_of(mesh, sharp_edges, sharp_vertices)
    points = smooth.copy()
    corners = rules == VertexRule.CORNER
    points[corners] = mesh.positions[corners]
    creases = rules == VertexRule.CREASE
    if creases.any():
        points[creases] = 0.75 * mesh.positions[creases] + 0.125 * _edge_end_sums(mesh, sharp_edges)[creases]
    return points


def _edge_end_sums(mesh: PolygonMesh, chosen: BoolArray) -> FloatArray:
    """(V, 3): for each vertex the sum of the other ends of the chosen edges at it."""
    ends = mesh.edge_vertices[chosen]
    sums = sums_by_index(ends[:, 0], mesh.positions[ends[:, 1]], mesh.vertex_count)
    return sums + sums_by_index(ends[:, 1], mesh.positions[ends[:, 0]], mesh.vertex_count)


def _parent_weights(mesh: PolygonMesh) -> FloatArray:
    """(V,): the weight of the rule before the step: the mean of the sharpnesses that end in the step.

    If none ends, both rules agree and the weight does not matter.
    """
    ending = (mesh.edge_sharpness > 0) & (mesh.edge_sharpness <= 1)
    own = (mesh.vertex_sharpness > 0) & (mesh.vertex_sharpness <= 1)
    at = np.concatenate([mesh.edge_vertices[ending].reshape(-1), np.flatnonzero(own)])
    values = np.concatenate([np.repeat(mesh.edge_sharpness[ending], 2), mesh.vertex_sharpness[own]])
    sums = np.bincount(at, weights=values, minlength=mesh.vertex_count)
    counts = np.bincount(at, minlength=mesh.vertex_count)
    return sums / np.maximum(counts, 1)
