# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpness: Blender's creases and boundaries as sharpnesses, and the rule that each vertex follows.

The rules are those of OpenSubdiv as Blender's Subdivision Surface modifier uses it (Catmark scheme, uniform creasing,
smooth triangles off): DeRose, Kass and Truong 1998 for semi-sharp creases; OpenSubdiv's documentation, its ``sdc``,
``far`` and ``vtr`` libraries, and Blender's converter to them for vertices where several features meet.

A sharpness counts levels: an edge or vertex of sharpness s > 0 follows its sharp rule for s levels and loses 1 at each.
In the level where it reaches 0 the sharp and the smooth rule are blended (``catmull_clark``).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import INFINITELY_SHARP, PolygonMesh

# A feature of this sharpness or more stays infinitely sharp (OpenSubdiv's convention).
LARGEST_SEMI_SHARPNESS = 10.0


class VertexRule(IntEnum):
    """The rule a vertex follows; the first three are numbered by the vertex's sharp edges."""

    SMOOTH = 0
    DART = 1
    CREASE = 2
    CORNER = 3


def crease_to_sharpness(crease: NDArray[np.floating]) -> FloatArray:
    """The sharpness of edges or vertices with Blender's crease from 0 to 1: 10 crease², infinite for a crease of 1.

    The sharpness is computed in single precision, as in Blender, because a sharpness just above a whole number ends a
    level later than the whole number itself. NaN stays NaN.
    """
    single = np.asarray(crease, dtype=np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        return _capped((single * single * np.float32(LARGEST_SEMI_SHARPNESS)).astype(np.float64))


def apply_boundary_rule(mesh: PolygonMesh, *, smooth_corners: bool) -> PolygonMesh:
    """The mesh with explicit sharpness: sharpness from the topology included, as in Blender's modifier.

    - An edge is infinitely sharp with one face, with more than two, or with two that run the same way along the edge.
    - A vertex is infinitely sharp when it touches an edge without faces; when its faces are not one fan or one ring
      (edges of the kind above included), unless it lies inside a non-manifold crease: two such edges, no boundary, and
      more faces than edges; and, without ``smooth_corners``, when it has one face only.
    - A vertex of two edges is as sharp as its own sharpness and the duller edge's together.
    - A sharpness of 10 or more is infinite. Vertices without faces stay where they are.

    smooth_corners: the modifier's Boundary Smooth, True for All, False for Keep Corners.
    A mesh with sharpness already explicit (a result of this function, a refined mesh, a submesh) is returned unchanged.
    """
    if mesh.sharpness_is_explicit:
        return mesh
    has_faces = mesh.edge_face_counts > 0
    boundary = mesh.edge_face_counts == 1
    non_manifold = (mesh.edge_face_counts > 1) & ~mesh.edge_has_twins
    creases = np.where(has_faces, _capped(mesh.edge_sharpness), 0.0)
    edge_sharpness = np.where(boundary | non_manifold, INFINITELY_SHARP, creases)

    edge_counts = _edges_at_vertices(mesh, has_faces)
    non_manifold_counts = _edges_at_vertices(mesh, non_manifold)
    inside_non_manifold_crease = (
        (non_manifold_counts == 2) & (_edges_at_vertices(mesh, boundary) == 0) & (mesh.vertex_face_counts > edge_counts)
    )
    single_fan = (non_manifold_counts == 0) & _is_single_fan(mesh)
    sharp = ~single_fan & ~inside_non_manifold_crease
    sharp |= _edges_at_vertices(mesh, ~has_faces) > 0
    if not smooth_corners:
        sharp |= (mesh.vertex_face_counts == 1) & (edge_counts == 2)
    with_edges = _sharpened_between_two_edges(mesh, creases, edge_counts)
    return mesh.changed(
        edge_sharpness=edge_sharpness,
        vertex_sharpness=np.where(sharp, INFINITELY_SHARP, with_edges),
        sharpness_is_explicit=True,
    )


def vertex_rules(mesh: PolygonMesh) -> NDArray[np.int8]:
    """(V,) int8 of ``VertexRule``: the rule of each vertex of a mesh with explicit sharpness."""
    return rules_of(mesh, mesh.edge_sharpness > 0, mesh.vertex_sharpness > 0)


def rules_of(mesh: PolygonMesh, sharp_edges: BoolArray, sharp_vertices: BoolArray) -> NDArray[np.int8]:
    rules = np.minimum(_edges_at_vertices(mesh, sharp_edges), VertexRule.CORNER).astype(np.int8)
    rules[sharp_vertices] = VertexRule.CORNER
    return rules


def has_semi_sharp(mesh: PolygonMesh) -> BoolArray:
    """(V,) bool: whether a vertex or one of its edges is semi-sharp, so that its rule changes at a later level."""
    return has_finite_sharpness_above(mesh, 0.0)


def has_finite_sharpness_above(mesh: PolygonMesh, level: float) -> BoolArray:
    """(V,) bool: whether a vertex or one of its edges has a finite sharpness above ``level``."""
    edges = (mesh.edge_sharpness > level) & np.isfinite(mesh.edge_sharpness)
    vertices = (mesh.vertex_sharpness > level) & np.isfinite(mesh.vertex_sharpness)
    vertices[mesh.edge_vertices[edges].reshape(-1)] = True
    return vertices


def decremented(sharpness: FloatArray) -> FloatArray:
    return np.maximum(sharpness - 1.0, 0.0)


def _capped(sharpness: FloatArray) -> FloatArray:
    return np.where(sharpness >= LARGEST_SEMI_SHARPNESS, INFINITELY_SHARP, sharpness)


def _edges_at_vertices(mesh: PolygonMesh, chosen: BoolArray) -> IndexArray:
    """(V,) intp: how many of the chosen edges end at each vertex."""
    ends = mesh.edge_vertices if np.all(chosen) else mesh.edge_vertices[chosen]
    return np.bincount(ends.reshape(-1), minlength=mesh.vertex_count)


def _is_single_fan(mesh: PolygonMesh) -> BoolArray:
    """(V,) bool: whether one walk from face to face reaches all the faces at a vertex; False without faces.

    All vertices walk together, one face per turn. Valid at vertices of manifold edges only.
    """
    corners = np.arange(mesh.corner_count)
    leaves_boundary = mesh.twin == corners
    first = np.zeros(mesh.vertex_count, dtype=np.intp)
    first[mesh.corner_vertices] = corners
    first[mesh.corner_vertices[leaves_boundary]] = corners[leaves_boundary]
    reached = np.zeros(mesh.vertex_count, dtype=np.intp)
    walking = np.flatnonzero(mesh.vertex_face_counts)
    start = current = first[walking]
    turns = 0
    while len(walking):
        turns += 1
        arriving = mesh.previous_corner.take(current)
        current = mesh.twin.take(arriving)
        # The walk ends at the other boundary, or where it began.
        ends = (current == arriving) | (current == start)
        if np.any(ends):
            reached[walking[ends]] = turns
            goes_on = np.flatnonzero(~ends)
            walking, start, current = walking[goes_on], start[goes_on], current[goes_on]
    return (reached > 0) & (reached == mesh.vertex_face_counts)


def _sharpened_between_two_edges(mesh: PolygonMesh, creases: FloatArray, edge_counts: IndexArray) -> FloatArray:
    """(V,) float64: the vertices' own sharpness, plus the duller edge's at vertices of two edges.

    So a lone quad with all edges creased keeps its corners in Blender. Only creases set on the edges count, not that
    they are boundaries. Single precision, as in Blender.
    """
    own = _capped(mesh.vertex_sharpness)
    added = np.zeros(mesh.vertex_count)
    creased = creases > 0
    if np.any(creased):
        duller = np.full(mesh.vertex_count, INFINITELY_SHARP)
        np.minimum.at(duller, mesh.edge_vertices[creased].reshape(-1), np.repeat(creases[creased], 2))
        # A smooth edge is the duller one, and adds nothing.
        both = (edge_counts == 2) & (_edges_at_vertices(mesh, creased) == 2)
        added[both] = duller[both]
    total = own.astype(np.float32) + added.astype(np.float32)
    return np.where(np.isinf(own), own, _capped(total.astype(np.float64)))
