# SPDX-License-Identifier: GPL-3.0-or-later
"""Unit normals of the limit surface at given points."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import cross_products, lengths, sums_by_index, units
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from .catmull_clark import subdivide
from .evaluation import evaluate, spline_sums, spline_weights
from .patches import ring_index
from .sharpness import VertexRule, has_semi_sharp, vertex_rules
from .stencils import valence_of
from .surface_points import SurfacePoints

# Tangents whose cross product is less than this share of their lengths' product are parallel up to rounding.
NO_AREA = 1e-12

# Steps after which the spokes around a vertex at sharp edges point along the tangents.
RING_STEPS = 60


def limit_normals(mesh: PolygonMesh, points: SurfacePoints) -> FloatArray:
    """(N, 3) float64: unit normals of the limit surface of a mesh with explicit sharpness, oriented as its faces are.

    Exact up to rounding on spline patches, at smooth vertices of any valence above 2, and at the corner of a single
    face between sharp edges. At a crease the normal belongs to the side of the point's own face. In other sectors at
    sharp edges without a spline patch, the normal is taken from the face's two spokes after ``RING_STEPS`` steps: the
    error shrinks by a factor each step, except for two faces between sharp edges at a fixed vertex, with an error of
    about one part in ``RING_STEPS`` of the sector's bend. At fixed vertices a sector of several faces has no tangent
    plane, and each face has its own normal. Rounding: a point at parameters of size h from an irregular vertex lies on
    a patch of that size, exact in shape to some units in the last place of the positions. Where the surface has no
    normal (tangents parallel or zero), the face's normal is used; for a face without area, the z axis.
    """
    normals = evaluate(mesh, points, _Normals(), 3)
    missing = np.flatnonzero(~normals.any(axis=1))
    if len(missing):
        normals[missing] = _area_normals(mesh)[mesh.corner_faces[points.corners[missing]]]
    return normals


class _Normals:
    """Unit normals, zero where there are none."""

    def on_splines(self, nets: FloatArray, which: IndexArray, parameters: FloatArray) -> FloatArray:
        along, across = spline_weights(parameters[:, 0]), spline_weights(parameters[:, 1])
        first = spline_sums(nets, which, _derivative_weights(parameters[:, 0]), across)
        second = spline_sums(nets, which, along, _derivative_weights(parameters[:, 1]))
        return _unit_normals(first, second)

    def at_extraordinary_vertices(self, nets: FloatArray) -> FloatArray:
        valence = valence_of(nets)
        # Stam's order runs clockwise.
        spokes = [ring_index(valence, 6 - 2 * i) for i in range(valence)]
        diagonals = [ring_index(valence, 5 - 2 * i) for i in range(valence)]
        return _smooth_normals(nets[spokes], nets[diagonals])

    def at_vertices(self, mesh: PolygonMesh, corners: IndexArray) -> FloatArray:
        mesh, corners = _settled(mesh, corners)
        smooth = vertex_rules(mesh)[mesh.corner_vertices[corners]] == VertexRule.SMOOTH
        normals = np.empty((len(corners), 3))
        normals[~smooth] = _sector_normals(mesh, corners[~smooth])
        valences = np.where(smooth, mesh.vertex_face_counts[mesh.corner_vertices[corners]], 0)
        for valence in np.unique(valences[smooth]).tolist():
            of_valence = np.flatnonzero(valences == valence)
            spokes, diagonals = _rings(mesh, corners[of_valence], valence)
            normals[of_valence] = _smooth_normals(mesh.positions[spokes], mesh.positions[diagonals])
        return normals


def _derivative_weights(parameters: FloatArray) -> FloatArray:
    """(4, P): the derivatives of ``spline_weights``."""
    t, s = parameters, 1 - parameters
    return np.stack([-s * s, t * (3 * t - 4), s * (1 + 3 * t), t * t]) / 2


def _smooth_normals(spokes: FloatArray, diagonals: FloatArray) -> FloatArray:
    """(P, 3): at smooth vertices among quads, from the ends of their spokes (n, P, 3), in the order in which faces
    visit their corners, and the points (n, P, 3) across the faces after each spoke.

    The limit tangents are the left eigenvectors of the largest eigenvalue below 1 (Halstead, Kass and DeRose 1993). At
    valence 2 the tangents are the differences of opposite points, with eigenvalue 1/4; but bending has -1/4, and does
    not vanish beside the tangents. The normal is then the vector about which the surrounding normals alternate.
    """
    valence = len(spokes)
    if valence == 2:
        return _unit_normals(spokes[0] - spokes[1], diagonals[0] - diagonals[1])
    turn = 2 * np.pi / valence
    angles: FloatArray = turn * np.arange(valence, dtype=np.float64)
    weight = 1 + np.cos(turn) + np.cos(turn / 2) * np.sqrt(2 * (9 + np.cos(turn)))
    waves = np.stack([np.cos(angles), np.sin(angles)])
    first, second = np.tensordot(weight * waves, spokes, 1) + np.tensordot(
        waves + np.roll(waves, -1, axis=1), diagonals, 1
    )
    return _unit_normals(first, second)


def _settled(mesh: PolygonMesh, corners: IndexArray) -> tuple[PolygonMesh, IndexArray]:
    """The mesh around the corners' vertices after one step or more, until none of them is semi-sharp; the corners."""
    while True:
        mesh = subdivide(mesh)
        # A corner's quarter is the child of its number.
        faces, which = np.unique(corners, return_inverse=True)
        corners = 4 * faces[which]
        if not has_semi_sharp(mesh)[mesh.corner_vertices[corners]].any():
            return mesh, corners
        mesh, _ = submesh(mesh, faces)
        corners = 4 * which


def _rings(mesh: PolygonMesh, corners: IndexArray, valence: int) -> tuple[IndexArray, IndexArray]:
    """(n, P) each: the vertices at the spokes' ends and across the faces around smooth vertices, from corners on."""
    turned = np.empty((valence, len(corners)), dtype=np.intp)
    for step in range(valence):
        turned[step] = corners
        corners = mesh.twin[mesh.previous_corner[corners]]
    following = mesh.next_corner[turned]
    return mesh.corner_vertices[following], mesh.corner_vertices[mesh.next_corner[following]]


def _sector_normals(mesh: PolygonMesh, corners: IndexArray) -> FloatArray:
    """(P, 3): at corners of darts, creases and fixed vertices, no two of which share an edge of the mesh of quads.

    Only the rings of faces at the vertices are refined. Positions are relative to the vertex after every step, so that
    rounding shrinks with them. No step turns the normal of a face that is alone in its sector.
    """
    rules = vertex_rules(mesh)
    vertices = np.unique(mesh.corner_vertices[corners])
    ring_of = np.full(mesh.vertex_count, -1, dtype=np.intp)
    ring_of[vertices] = np.arange(len(vertices))
    around = np.flatnonzero(ring_of[mesh.corner_vertices] >= 0)
    ring = ring_of[mesh.corner_vertices[around]]
    before, after = mesh.previous_corner[around], mesh.next_corner[around]
    spokes, places = np.unique(mesh.corner_edges[np.concatenate([around, before])], return_inverse=True)
    leaving, entering = places.reshape(2, -1)
    spoke_ring = ring_of[mesh.edge_vertices[spokes]].max(axis=1)
    sharp = mesh.edge_sharpness[spokes] > 0

    centres = mesh.positions[vertices]
    ends = mesh.positions[mesh.edge_vertices[spokes]].sum(axis=1) - 2 * centres[spoke_ring]
    across = mesh.positions[mesh.corner_vertices[mesh.next_corner[after]]] - centres[ring]
    normals = _unit_normals(ends[leaving], ends[entering])

    # The vertex moves by these shares of its spokes and of its new face points.
    valence = np.bincount(ring, minlength=len(vertices))
    dart, crease = rules[vertices] == VertexRule.DART, rules[vertices] == VertexRule.CREASE
    by_faces = np.where(dart, 1 / valence**2, 0)[ring, None]
    by_spokes = np.where(dart[spoke_ring], 1 / valence[spoke_ring] ** 2, 0.125 * (crease[spoke_ring] & sharp))[:, None]
    for _ in range(RING_STEPS):
        across = 0.25 * (ends[leaving] + ends[entering] + across)
        move = sums_by_index(spoke_ring, by_spokes * ends, len(vertices))
        move += sums_by_index(ring, by_faces * across, len(vertices))
        beside = sums_by_index(leaving, across, len(spokes)) + sums_by_index(entering, across, len(spokes))
        ends = np.where(sharp[:, None], 0.5 * ends, 0.25 * (ends + beside)) - move[spoke_ring]
        across = across - move[ring]
    several = ~(sharp[leaving] & sharp[entering])
    normals[several] = _unit_normals(ends[leaving], ends[entering])[several]
    return normals[np.searchsorted(around, corners)]


def _area_normals(mesh: PolygonMesh) -> FloatArray:
    """(F, 3): unit normals of the faces, from their projected areas; the z axis for faces without area."""
    points = mesh.positions[mesh.corner_vertices]
    sizes = mesh.face_sizes[:, None]
    points = points - (np.add.reduceat(points, mesh.face_starts[:-1]) / sizes)[mesh.corner_faces]
    areas = np.add.reduceat(cross_products(points, points[mesh.next_corner]), mesh.face_starts[:-1])
    return np.where(lengths(areas)[:, None] > 0, units(areas), [0.0, 0.0, 1.0])


def _unit_normals(first: FloatArray, second: FloatArray) -> FloatArray:
    """(P, 3): unit vectors along the cross products of tangents (P, 3), zero where these are parallel or zero."""
    normals = cross_products(first, second)
    clear = lengths(normals) > NO_AREA * (lengths(first) * lengths(second))
    return np.where(clear[:, None], units(normals), 0.0)
