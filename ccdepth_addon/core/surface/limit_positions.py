# SPDX-License-Identifier: GPL-3.0-or-later
"""The places of the vertices of a mesh on its limit surface."""

from __future__ import annotations

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import sums_by_index
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces, faces_alone
from .catmull_clark import refined_points, subdivide
from .sharpness import VertexRule, has_finite_sharpness_above, rules_of


def limit_positions(mesh: PolygonMesh, wanted: BoolArray | None = None) -> FloatArray:
    """(V, 3) float64: the limit position of each vertex of a mesh with explicit sharpness.

    wanted: (V,) bool, the vertices that need right positions; all by default.

    With n, V, E and F the valence and the vertex, edge and face points after one step (so the formulas hold around
    faces of any size), the limit is (n²V + 4ΣE + ΣF) / (n(n + 5)) at a smooth vertex (Halstead, Kass and DeRose,
    *Efficient, fair interpolation using Catmull-Clark surfaces*, 1993), (4V + E₁ + E₂) / 6 with the edge points on the
    crease at a crease vertex, and V at a corner. Where a sharpness lasts more than one level, the mesh is first refined
    around such vertices. Vertices of valence 2 and darts have their true limits too; OpenSubdiv uses the vertex itself
    for the former and the smooth formula for the latter.
    """
    wanted = np.ones(mesh.vertex_count, dtype=bool) if wanted is None else wanted
    limits = _limits_after_one_step(mesh, wanted)
    undecided = wanted & has_finite_sharpness_above(mesh, 1.0) & (mesh.vertex_face_counts > 0)
    if not undecided.any():
        return limits
    at_undecided = mask(mesh.face_count, mesh.corner_faces[undecided[mesh.corner_vertices]])
    faces = np.flatnonzero(at_undecided)
    part = faces_alone(mesh, faces)
    vertices = np.zeros(part.vertex_count, dtype=np.intp)
    vertices[part.corner_vertices] = mesh.corner_vertices[corners_of_faces(mesh, faces)]
    own = undecided[vertices]
    # A step makes a face of each corner. Of those at undecided vertices the vertex points come first among the
    # vertices, and have the limits of their vertices.
    around = faces_alone(subdivide(part), np.flatnonzero(own[part.corner_vertices]))
    is_own_point = np.arange(around.vertex_count) < np.count_nonzero(own)
    limits[vertices[own]] = limit_positions(around, is_own_point)[is_own_point]
    return limits


def _limits_after_one_step(mesh: PolygonMesh, wanted: BoolArray) -> FloatArray:
    """(V, 3): limit positions from the points of one step, right where no finite sharpness remains after it.

    Dart vertices, which take long, are computed only where wanted.
    """
    vertex_points, edge_points, face_points = refined_points(mesh)
    sharp_edges = mesh.edge_sharpness > 1
    rules = rules_of(mesh, sharp_edges, mesh.vertex_sharpness > 1)
    valences = np.maximum(mesh.vertex_face_counts, 1)[:, None].astype(np.float64)
    edge_sums = _point_sums_at_ends(mesh, edge_points, mesh.edge_face_counts > 0)
    face_sums = sums_by_index(mesh.corner_vertices, face_points[mesh.corner_faces], mesh.vertex_count)
    weighted = valences**2 * vertex_points + 4.0 * edge_sums + face_sums
    limits = weighted / (valences * (valences + 5.0))
    corners = rules == VertexRule.CORNER
    limits[corners] = vertex_points[corners]
    creases = rules == VertexRule.CREASE
    crease_sums = _point_sums_at_ends(mesh, edge_points, sharp_edges)
    limits[creases] = (4.0 * vertex_points[creases] + crease_sums[creases]) / 6.0
    darts = np.flatnonzero((rules == VertexRule.DART) & wanted)
    if len(darts):
        limits[darts] = _dart_limits(mesh, darts, vertex_points, edge_points, face_points)
    return limits


def _point_sums_at_ends(mesh: PolygonMesh, edge_points: FloatArray, chosen: BoolArray) -> FloatArray:
    """(V, 3): for each vertex the sum of the edge points of the chosen edges at it."""
    ends = mesh.edge_vertices[chosen].reshape(-1)
    return sums_by_index(ends, np.repeat(edge_points[chosen], 2, axis=0), mesh.vertex_count)


def _dart_limits(
    mesh: PolygonMesh, darts: IndexArray, vertex_points: FloatArray, edge_points: FloatArray, face_points: FloatArray
) -> FloatArray:
    """(len(darts), 3): the limits of dart vertices, from the points of one step.

    Positions are relative to the dart's, so that rounding shrinks with the ring.
    """
    limits = vertex_points[darts]
    first = np.zeros(mesh.vertex_count, dtype=np.intp)
    sharp = np.flatnonzero(mesh.edge_sharpness[mesh.corner_edges] > 1)
    first[mesh.corner_vertices[sharp]] = sharp
    valences = mesh.vertex_face_counts[darts]
    for valence in np.unique(valences).tolist():
        chosen = np.flatnonzero(valences == valence)
        origins, total, spokes = limits[chosen], 0.0, first[darts[chosen]]
        for end_weight, across_weight in dart_weights(valence).reshape(-1, 2).tolist():
            ends = edge_points[mesh.corner_edges[spokes]] - origins
            across = face_points[mesh.corner_faces[spokes]] - origins
            total = total + end_weight * ends + across_weight * across
            spokes = mesh.twin[mesh.previous_corner[spokes]]
        limits[chosen] = origins + total
    return limits


def dart_weights(valence: int) -> FloatArray:
    """(2n,): the weights of a dart vertex's ring in its limit; the vertex's own weight is 1 minus their sum.

    The ring: the ends of the spokes, from the sharp one on, each followed by the point across the next quad. A step
    maps the vertex and its ring to themselves, so the weights are the step's left eigenvector for the eigenvalue 1.
    With weight 1 for the vertex, e_i for the ends, e_0 for the sharp one, and a_i for the points across, it says

        a_i = 1/(3n²) + (e_i + e_i+1)/12,   7 e_i - e_i-1 - e_i+1 = 20/n²   for 0 < i < n, with 0 for e_0 and e_n,
        e_0 = 3/n² + (a_0 + a_n-1)/2 + (e_1 + e_n-1)/8,

    as the sharp end depends on the vertex and itself alone. The solution is 4/n² less a sum of powers of the root
    r = (7 - 3√5)/2 of r + 1/r = 7.
    """
    root, squared = (7 - 3 * 5**0.5) / 2, valence**2
    powers = root ** np.arange(valence + 1)
    ends = 4 / squared * (1 - (powers + powers[::-1]) / (1 + powers[-1]))
    ends[[0, -1]] = 0.0
    across = 1 / (3 * squared) + (ends[:-1] + ends[1:]) / 12
    ends[0] = 3 / squared + (across[0] + across[-1]) / 2 + (ends[1] + ends[-2]) / 8
    weights = np.stack([ends[:-1], across], axis=1).reshape(-1)
    return weights / (1 + weights.sum())
