# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces → control nets.

A face whose surface patch is known in closed form is *regular* (a uniform bicubic B-spline patch with a 4×4 net) or
*extraordinary* (all regular but for one corner, an interior vertex of valence 3 or 5 and more; a net of 2n + 8 points
in Stam's order, as in Cheng, Chen and Yong 2006). Every other face is *irregular* and has to be refined first.

At a boundary edge or an infinitely sharp crease the surface is that of phantom points V₋₁ = 2V₀ - V₁ beyond it: with
them the B-spline step gives the edge points (V_a + V_b) / 2 and vertex points (1, 6, 1) / 8 of the crease rules, and
the phantom points of the next level again, so such a face is regular when its corners are. A fixed corner with one
face between its sharp edges extrapolates both ways, V₋₁₋₁ = 4V₀₀ - 2V₀₁ - 2V₁₀ + V₁₁, whose B-spline limit is V₀₀.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from .catmull_clark import VertexRule, has_semi_sharp, vertex_rules
from .mesh import FloatArray, IndexArray, PolygonMesh
from .norms import ring_index

BoolArray = NDArray[np.bool_]


class PatchKind(IntEnum):
    """What a face's patch is, see the module's docstring."""

    REGULAR = 0
    EXTRAORDINARY = 1
    IRREGULAR = 2


@dataclass(frozen=True)
class PatchKinds:
    """kinds: (F,) int8 of PatchKind; extraordinary_corners: (F,) intp, for the extraordinary faces only that corner."""

    kinds: NDArray[np.int8]
    extraordinary_corners: IndexArray


def classify_patches(mesh: PolygonMesh) -> PatchKinds:
    """The kind of every face's patch. The mesh's sharpness is explicit (``catmull_clark.apply_boundary_rule``).

    A face of a submesh is told rightly when all the faces around its corners are there.
    """
    regular, extraordinary = _classify_corners(mesh)
    quads = mesh.face_sizes == 4
    starts = mesh.face_starts[:-1]
    regular_corners = np.add.reduceat(regular.astype(np.intp), starts)
    spline_corners = np.add.reduceat((regular & _inside(mesh)).astype(np.intp), starts)
    extraordinary_corners = np.add.reduceat(extraordinary.astype(np.intp), starts)
    kinds = np.full(mesh.face_count, PatchKind.IRREGULAR, dtype=np.int8)
    kinds[quads & (regular_corners == 4)] = PatchKind.REGULAR
    kinds[quads & (spline_corners == 3) & (extraordinary_corners == 1)] = PatchKind.EXTRAORDINARY
    which = np.zeros(mesh.face_count, dtype=np.intp)
    found = np.flatnonzero(extraordinary)
    which[mesh.corner_faces[found]] = found
    return PatchKinds(kinds=kinds, extraordinary_corners=which)


def _inside(mesh: PolygonMesh) -> BoolArray:
    """Corners at smooth vertices, hence inside the surface: (C,) bool."""
    return (vertex_rules(mesh) == VertexRule.SMOOTH)[mesh.corner_vertices]


def _classify_corners(mesh: PolygonMesh) -> tuple[BoolArray, BoolArray]:
    """(C,) bool each: corners that a spline patch can have, and extraordinary ones.

    A regular corner has quads only around it (in its sector, between sharp edges) and is an interior vertex of
    valence 4, a crease vertex with two faces in the sector, or a fixed vertex with one.
    """
    rules = vertex_rules(mesh)[mesh.corner_vertices]
    settled = ~has_semi_sharp(mesh)[mesh.corner_vertices]
    valence = mesh.vertex_face_counts[mesh.corner_vertices]
    quads_only = ~_touches_other_than_quads(mesh)[mesh.corner_vertices]
    sharp_out = np.isinf(mesh.edge_sharpness)[mesh.corner_edges]
    sharp_in = sharp_out[mesh.previous_corner]

    smooth = settled & quads_only & (rules == VertexRule.SMOOTH)
    crease = settled & (rules == VertexRule.CREASE) & (sharp_out != sharp_in)
    crease[crease] = _next_sector_edge_sharp(mesh, np.flatnonzero(crease), sharp_out)
    fixed = settled & (rules == VertexRule.CORNER) & sharp_out & sharp_in
    regular = (smooth & (valence == 4)) | crease | fixed
    return regular, smooth & ((valence == 3) | (valence >= 5))


def _touches_other_than_quads(mesh: PolygonMesh) -> BoolArray:
    """Vertices of a face that is not a quad: (V,) bool."""
    touched = np.zeros(mesh.vertex_count, dtype=bool)
    touched[mesh.corner_vertices[mesh.face_sizes[mesh.corner_faces] != 4]] = True
    return touched


def _next_sector_edge_sharp(mesh: PolygonMesh, corners: IndexArray, sharp_out: BoolArray) -> BoolArray:
    """(corners,) bool: across the corner's one smooth edge lies a quad whose other edge at the vertex is sharp."""
    across_out = mesh.next_corner[mesh.twin[corners]]
    across_in = mesh.twin[mesh.previous_corner[corners]]
    neighbour = np.where(sharp_out[corners], across_in, across_out)
    other_edge = np.where(sharp_out[corners], mesh.previous_corner[neighbour], neighbour)
    return sharp_out[other_edge] & (mesh.face_sizes[mesh.corner_faces[neighbour]] == 4)


def regular_nets(mesh: PolygonMesh, faces: IndexArray) -> FloatArray:
    """(4, 4, P, 3) float64: the nets of regular faces, [i, j] with the face's corners at (1,1), (2,1), (2,2), (1,2)."""
    corners = mesh.face_starts[faces] + np.arange(4)[:, None]
    near, far, diagonal = _outer_vertices(mesh, corners)
    v = mesh.corner_vertices[corners]
    rows = [
        [diagonal[0], far[3], near[3], diagonal[3]],
        [near[0], v[0], v[3], far[2]],
        [far[0], v[1], v[2], near[2]],
        [diagonal[1], near[1], far[1], diagonal[2]],
    ]
    net = mesh.positions.take(np.array(rows, dtype=np.intp), axis=0)
    sharp = np.isinf(mesh.edge_sharpness)[mesh.corner_edges[corners]]
    _extrapolate(net, sharp)
    return net


def _outer_vertices(mesh: PolygonMesh, corners: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
    """For half-edges of quads: the two vertices of the quad across, and the vertex diagonal from the start.

    corners: (…) intp. near lies beyond the half-edge's start, far beyond its end, and diagonal across the corner at
    the start. Where a neighbour is missing the answer is some vertex without meaning.
    """
    across = mesh.twin[corners]
    leaving = mesh.next_corner[across]
    near = mesh.corner_vertices[mesh.next_corner[leaving]]
    far = mesh.corner_vertices[mesh.previous_corner[across]]
    diagonal = mesh.corner_vertices[mesh.previous_corner[mesh.twin[leaving]]]
    return near, far, diagonal


def _extrapolate(net: FloatArray, sharp: BoolArray) -> None:
    """Put phantom points beyond the sharp sides: (4, P) bool, the sides from each corner to the next."""
    for i, inner, second, side in ((0, 1, 2, 3), (3, 2, 1, 1)):
        patches = np.flatnonzero(sharp[side])
        if len(patches):
            net[i][:, patches] = 2 * net[inner][:, patches] - net[second][:, patches]
    for j, inner, second, side in ((0, 1, 2, 0), (3, 2, 1, 2)):
        patches = np.flatnonzero(sharp[side])
        if len(patches):
            net[:, j, patches] = 2 * net[:, inner, patches] - net[:, second, patches]


def extraordinary_nets(mesh: PolygonMesh, corners: IndexArray, valence: int) -> FloatArray:
    """(2n + 8, P, 3) float64: nets in Stam's order of faces with their extraordinary vertex at the given corners.

    corners: (P,) intp, all at vertices of the one valence n. On a grid with V₁ at the origin, V₆ at (1, 0) and V₄ at
    (0, 1): V₅ (1, 1), V₃ (-1, 1), V₂ (-1, 0), V₇ (1, -1), V₈ (0, -1), then V₂ₙ₊₂ … V₂ₙ₊₈ at (2, 2), (2, 1), (2, 0),
    (2, -1), (1, 2), (0, 2), (-1, 2).
    """
    numbers = np.empty((2 * valence + 8, len(corners)), dtype=np.intp)
    numbers[0] = mesh.corner_vertices[corners]
    spoke = corners
    for step in range(valence):
        across = mesh.twin[spoke]
        numbers[ring_index(valence, 6 + 2 * step)] = mesh.corner_vertices[mesh.next_corner[spoke]]
        numbers[ring_index(valence, 7 + 2 * step)] = mesh.corner_vertices[mesh.previous_corner[across]]
        spoke = mesh.next_corner[across]
    side_6 = mesh.next_corner[corners]
    side_5 = mesh.next_corner[side_6]
    side_4 = mesh.next_corner[side_5]
    near, far, diagonal = _outer_vertices(mesh, np.stack([side_6, side_5, side_4]))
    outer = [diagonal[1], far[0], near[0], diagonal[0], near[1], far[1], diagonal[2]]
    numbers[2 * valence + 1 :] = outer
    return mesh.positions.take(numbers, axis=0)
