# SPDX-License-Identifier: GPL-3.0-or-later
"""Catmull-Clark subdivision with sharp features: one step, and where its vertices end up.

The rules are those of OpenSubdiv as Blender's Subdivision Surface modifier uses it (Catmark scheme, uniform creasing,
smooth triangles off), after

- Catmull and Clark, *Recursively generated B-spline surfaces on arbitrary topological meshes*, 1978;
- DeRose, Kass and Truong, *Subdivision surfaces in character animation*, 1998, for semi-sharp creases;
- OpenSubdiv's documentation and its ``sdc``, ``far`` and ``vtr`` libraries, and Blender's converter to them, for what
  happens where several features meet.

Sharpness counts levels: an edge or vertex of sharpness s > 0 follows its sharp rule for s levels, loses 1 at each of
them, and in the level where it drops to 0 the sharp and the smooth rule are blended.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import INFINITELY_SHARP, PolygonMesh
from ..mesh.submesh import corners_of_faces, submesh

# From this sharpness on a feature never softens (OpenSubdiv's convention).
LARGEST_SEMI_SHARPNESS = 10.0


class VertexRule(IntEnum):
    """Which rule a vertex follows. The first three are numbered by their number of sharp edges."""

    SMOOTH = 0
    DART = 1
    CREASE = 2
    CORNER = 3


@dataclass(frozen=True)
class Subdivision:
    """The mesh one step down, and the face of the mesh before that each of its faces came from, (F1,) intp."""

    mesh: PolygonMesh
    parent_faces: IndexArray


def crease_to_sharpness(crease: NDArray[np.floating]) -> FloatArray:
    """Blender's crease, 0 to 1, of edges or vertices as a sharpness: 10 crease², infinite for a crease of 1.

    Computed in single precision, as Blender does: whether a sharpness is above or at a whole number decides in which
    level it runs out, and where several features meet the result depends on that. What is no number stays none.
    """
    single = np.asarray(crease, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        return _capped((single * single * np.float32(LARGEST_SEMI_SHARPNESS)).astype(np.float64))


def apply_boundary_rule(mesh: PolygonMesh, *, smooth_corners: bool) -> PolygonMesh:
    """The mesh with the sharpness that follows from its topology made explicit, as Blender's modifier does.

    - Edges with one face, with more than two, or with two that run the same way along it, are infinitely sharp.
    - A vertex is infinitely sharp when it touches an edge without faces; when its faces are not one fan or one ring
      (edges of the kind above included), unless it lies inside a non-manifold crease: two such edges, no boundary, and
      more faces than edges; and, without ``smooth_corners``, when it has one face only.
    - A vertex of two edges is as sharp as its own sharpness and the duller edge's together.
    - A sharpness of 10 or more is infinite. Vertices without faces stay where they are.

    smooth_corners: the modifier's Boundary Smooth, True for All, False for Keep Corners.
    A mesh whose sharpness is explicit already (this function's result, refined meshes, and parts of them) is returned
    as it is.
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


def subdivide(mesh: PolygonMesh) -> Subdivision:
    """One Catmull-Clark step of a mesh whose sharpness is explicit (``apply_boundary_rule``).

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
    softer = _decremented(mesh.edge_sharpness)
    smooth_count = mesh.edge_count + mesh.face_count
    refined = PolygonMesh(
        positions=np.concatenate(_refined_points(mesh)),
        face_starts=np.arange(0, 4 * mesh.corner_count + 1, 4),
        corner_vertices=quads.reshape(-1),
        corner_edges=quad_edges.reshape(-1),
        edge_vertices=np.concatenate([halves.reshape(-1, 2), inner_ends]),
        edge_sharpness=np.concatenate([np.repeat(softer, 2), np.zeros(mesh.corner_count)]),
        vertex_sharpness=np.concatenate([_decremented(mesh.vertex_sharpness), np.zeros(smooth_count)]),
        sharpness_is_explicit=mesh.sharpness_is_explicit,
    )
    return Subdivision(refined, mesh.corner_faces)


def limit_positions(mesh: PolygonMesh, wanted: BoolArray | None = None) -> FloatArray:
    """(V, 3) float64, where each vertex of a mesh with explicit sharpness goes on the limit surface.

    wanted: (V,) bool, the vertices for which it has to be right; all when left out.

    With n, V, E and F the valence, the vertex, edge and face points after one step (which makes the formulas hold
    around faces of any size), a smooth vertex goes to (n²V + 4ΣE + ΣF) / (n(n + 5)) (Halstead, Kass and DeRose,
    *Efficient, fair interpolation using Catmull-Clark surfaces*, 1993), a crease vertex to (4V + E₁ + E₂) / 6 with the
    edge points on the crease, and a corner stays. Where a sharpness has more than one level left the mesh is refined
    first, around such vertices only. Valence 2 is no exception here, and a dart vertex goes to its true limit too,
    where OpenSubdiv takes the vertex itself for the one and the smooth formula for the other.
    """
    return _limit_positions(mesh, np.ones(mesh.vertex_count, dtype=bool) if wanted is None else wanted)


def vertex_rules(mesh: PolygonMesh) -> NDArray[np.int8]:
    """(V,) int8 of ``VertexRule``: the rule each vertex follows, its sharpness and its sharp edges being explicit."""
    return _rules(mesh, mesh.edge_sharpness > 0, mesh.vertex_sharpness > 0)


def has_semi_sharp(mesh: PolygonMesh) -> BoolArray:
    """(V,) bool, whether a vertex or one of its edges is semi-sharp, so that its rule changes in some later level."""
    return _has_finite_sharpness_above(mesh, 0.0)


def _capped(sharpness: FloatArray) -> FloatArray:
    return np.where(sharpness >= LARGEST_SEMI_SHARPNESS, INFINITELY_SHARP, sharpness)


def _decremented(sharpness: FloatArray) -> FloatArray:
    return np.maximum(sharpness - 1.0, 0.0)


def _sum_by(index: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """(count, 3), for each of 0 … count - 1 the sum of the rows of ``values`` whose ``index`` it is."""
    return np.stack([np.bincount(index, weights=column, minlength=count) for column in values.T], axis=1)


# Topology


def _edges_at_vertices(mesh: PolygonMesh, chosen: BoolArray) -> IndexArray:
    """(V,) how many of the chosen edges end at each vertex."""
    ends = mesh.edge_vertices if np.all(chosen) else mesh.edge_vertices[chosen]
    return np.bincount(ends.reshape(-1), minlength=mesh.vertex_count)


def _is_single_fan(mesh: PolygonMesh) -> BoolArray:
    """(V,) whether one walk from face to face reaches all the faces at a vertex, False without faces.

    All the vertices walk at once, one face per turn. The answer is meant for vertices of manifold edges only.
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
    """(V,) the vertices' own sharpness, and at a vertex of two edges the duller edge's added to it.

    Blender does so that a lone quad with all edges creased keeps its corners. Only the creases set on the edges count,
    not their being boundaries. Single precision, as there.
    """
    own = _capped(mesh.vertex_sharpness)
    added = np.zeros(mesh.vertex_count)
    creased = creases > 0
    if np.any(creased):
        duller = np.full(mesh.vertex_count, INFINITELY_SHARP)
        np.minimum.at(duller, mesh.edge_vertices[creased].reshape(-1), np.repeat(creases[creased], 2))
        # Where one of the two edges is smooth it is the duller one, and adds nothing.
        both = (edge_counts == 2) & (_edges_at_vertices(mesh, creased) == 2)
        added[both] = duller[both]
    total = own.astype(np.float32) + added.astype(np.float32)
    return np.where(np.isinf(own), own, _capped(total.astype(np.float64)))


def _half_edges_at_corners(mesh: PolygonMesh) -> tuple[IndexArray, IndexArray]:
    """(C,) twice: the refined edges that leave and enter the vertex of each corner along its face's border."""
    before = mesh.previous_corner
    starts_at_second = mesh.edge_vertices[mesh.corner_edges, 1] == mesh.corner_vertices
    outgoing = 2 * mesh.corner_edges + starts_at_second
    incoming = 2 * mesh.corner_edges[before] + ~starts_at_second[before]
    return outgoing, incoming


# One step


def _refined_points(mesh: PolygonMesh) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The vertex points (V, 3), edge points (E, 3) and face points (F, 3) of one step."""
    face_points = np.add.reduceat(mesh.positions[mesh.corner_vertices], mesh.face_starts[:-1])
    face_points /= mesh.face_sizes[:, None]
    corner_face_points = face_points[mesh.corner_faces]
    return _vertex_points(mesh, corner_face_points), _edge_points(mesh, corner_face_points), face_points


def _edge_points(mesh: PolygonMesh, corner_face_points: FloatArray) -> FloatArray:
    midpoints = 0.5 * (mesh.positions[mesh.edge_vertices[:, 0]] + mesh.positions[mesh.edge_vertices[:, 1]])
    sums = _sum_by(mesh.corner_edges, corner_face_points, mesh.edge_count)
    face_points = sums / np.maximum(mesh.edge_face_counts, 1)[:, None]
    smoothness = 0.5 * (1.0 - np.minimum(mesh.edge_sharpness, 1.0))
    return midpoints + smoothness[:, None] * (face_points - midpoints)


def _vertex_points(mesh: PolygonMesh, corner_face_points: FloatArray) -> FloatArray:
    """The vertex points, blended from the rules before and after the step where a sharpness runs out in it."""
    faces = np.maximum(mesh.vertex_face_counts, 1)[:, None].astype(np.float64)
    neighbours = _edge_end_sums(mesh, mesh.edge_face_counts > 0)
    face_points = _sum_by(mesh.corner_vertices, corner_face_points, mesh.vertex_count)
    smooth = ((faces - 2.0) * mesh.positions + (neighbours + face_points) / faces) / faces
    parent = _by_rule(mesh, smooth, mesh.edge_sharpness > 0, mesh.vertex_sharpness > 0)
    if not has_semi_sharp(mesh).any():
        return parent
    child = _by_rule(mesh, smooth, mesh.edge_sharpness > 1, mesh.vertex_sharpness > 1)
    return child + _parent_weights(mesh)[:, None] * (parent - child)


def _rules(mesh: PolygonMesh, sharp_edges: BoolArray, sharp_vertices: BoolArray) -> NDArray[np.int8]:
    rules = np.minimum(_edges_at_vertices(mesh, sharp_edges), VertexRule.CORNER).astype(np.int8)
    rules[sharp_vertices] = VertexRule.CORNER
    return rules


def _by_rule(mesh: PolygonMesh, smooth: FloatArray, sharp_edges: BoolArray, sharp_vertices: BoolArray) -> FloatArray:
    """The vertex points that follow from these sharp edges and vertices; smooth and dart vertices as in ``smooth``."""
    rules = _rules(mesh, sharp_edges, sharp_vertices)
    points = smooth.copy()
    corners = rules == VertexRule.CORNER
    points[corners] = mesh.positions[corners]
    creases = rules == VertexRule.CREASE
    if creases.any():
        points[creases] = 0.75 * mesh.positions[creases] + 0.125 * _edge_end_sums(mesh, sharp_edges)[creases]
    return points


def _edge_end_sums(mesh: PolygonMesh, chosen: BoolArray) -> FloatArray:
    """(V, 3) for each vertex the sum of the other ends of the chosen edges at it."""
    ends = mesh.edge_vertices[chosen]
    sums = _sum_by(ends[:, 0], mesh.positions[ends[:, 1]], mesh.vertex_count)
    return sums + _sum_by(ends[:, 1], mesh.positions[ends[:, 0]], mesh.vertex_count)


def _parent_weights(mesh: PolygonMesh) -> FloatArray:
    """(V,) how much of the rule before the step remains: the mean of the sharpnesses that run out in it.

    Where none does, the rules before and after agree and the weight is of no consequence.
    """
    ending = (mesh.edge_sharpness > 0) & (mesh.edge_sharpness <= 1)
    own = (mesh.vertex_sharpness > 0) & (mesh.vertex_sharpness <= 1)
    at = np.concatenate([mesh.edge_vertices[ending].reshape(-1), np.flatnonzero(own)])
    values = np.concatenate([np.repeat(mesh.edge_sharpness[ending], 2), mesh.vertex_sharpness[own]])
    sums = np.bincount(at, weights=values, minlength=mesh.vertex_count)
    counts = np.bincount(at, minlength=mesh.vertex_count)
    return sums / np.maximum(counts, 1)


# The limit


def _has_finite_sharpness_above(mesh: PolygonMesh, level: float) -> BoolArray:
    """(V,) whether a vertex or one of its edges has a sharpness above ``level`` that is not infinite."""
    edges = (mesh.edge_sharpness > level) & np.isfinite(mesh.edge_sharpness)
    vertices = (mesh.vertex_sharpness > level) & np.isfinite(mesh.vertex_sharpness)
    vertices[mesh.edge_vertices[edges].reshape(-1)] = True
    return vertices


def _limit_positions(mesh: PolygonMesh, wanted: BoolArray) -> FloatArray:
    """(V, 3) the limit positions, right at the wanted vertices only."""
    limits = _limits_after_one_step(mesh, wanted)
    undecided = wanted & _has_finite_sharpness_above(mesh, 1.0) & (mesh.vertex_face_counts > 0)
    if not undecided.any():
        return limits
    at_undecided = np.zeros(mesh.face_count, dtype=bool)
    at_undecided[mesh.corner_faces[undecided[mesh.corner_vertices]]] = True
    part, faces = submesh(mesh, np.flatnonzero(at_undecided))
    # Vertex points come first among the vertices of a step, and go where the vertices go.
    vertices = np.zeros(part.vertex_count, dtype=np.intp)
    vertices[part.corner_vertices] = mesh.corner_vertices[corners_of_faces(mesh, faces)]
    refined = subdivide(part).mesh
    wanted_points = np.zeros(refined.vertex_count, dtype=bool)
    wanted_points[: part.vertex_count] = undecided[vertices]
    found = _limit_positions(refined, wanted_points)
    limits[vertices[undecided[vertices]]] = found[wanted_points]
    return limits


def _limits_after_one_step(mesh: PolygonMesh, wanted: BoolArray) -> FloatArray:
    """(V, 3) the limit positions from the points of one step, right where no sharpness remains after it or all.

    Dart vertices, which take long, have theirs only where wanted.
    """
    vertex_points, edge_points, face_points = _refined_points(mesh)
    sharp_edges = mesh.edge_sharpness > 1
    rules = _rules(mesh, sharp_edges, mesh.vertex_sharpness > 1)
    valences = np.maximum(mesh.vertex_face_counts, 1)[:, None].astype(np.float64)
    edge_sums = _point_sums_at_ends(mesh, edge_points, mesh.edge_face_counts > 0)
    face_sums = _sum_by(mesh.corner_vertices, face_points[mesh.corner_faces], mesh.vertex_count)
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
    """(V, 3) for each vertex the sum of the edge points of the chosen edges at it."""
    ends = mesh.edge_vertices[chosen].reshape(-1)
    return _sum_by(ends, np.repeat(edge_points[chosen], 2, axis=0), mesh.vertex_count)


def _dart_limits(
    mesh: PolygonMesh, darts: IndexArray, vertex_points: FloatArray, edge_points: FloatArray, face_points: FloatArray
) -> FloatArray:
    """(len(darts), 3) the limits of dart vertices, from the points of one step.

    Positions are taken relative to the dart's, so that rounding stays small with the ring.
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


@lru_cache(maxsize=64)
def dart_weights(valence: int) -> FloatArray:
    """(2n,) the weights with which the ring of a dart vertex enters into its limit; what they lack to 1 is its own.

    The ring: the ends of its spokes, beginning with the sharp one, each before the point across the quad that follows.
    The sharp edge breaks the symmetry that has a closed formula; but a step maps the vertex and its ring to themselves,
    so the weights are the step's left eigenvector to the eigenvalue 1.
    """
    ends, across = 1 + 2 * np.arange(valence), 2 + 2 * np.arange(valence)
    following, before = np.roll(ends, -1), np.roll(across, 1)
    step = np.zeros((2 * valence + 1, 2 * valence + 1))
    for points in (0, ends, following, across):
        step[across, points] += 0.25
    step[0, 0] = (valence - 2) / valence
    step[0, ends] = 1 / valence**2
    step[0] += step[across].sum(axis=0) / valence**2
    step[ends, 0] += 0.5
    step[ends, ends] += 0.5
    smooth = ends[1:]
    step[smooth] *= 0.5
    step[smooth] += 0.25 * (step[across] + step[before])[1:]
    # The eigenvector's sum is 1, in place of an equation that follows from the others.
    equations = step.T - np.eye(len(step))
    equations[0] = 1.0
    return np.linalg.solve(equations, np.eye(len(step))[0])[1:]
