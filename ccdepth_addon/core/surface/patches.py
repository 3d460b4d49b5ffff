# SPDX-License-Identifier: GPL-3.0-or-later
"""Patches: the kind of each face's patch, and its control net.

A face whose surface patch is known in closed form is *regular* (a uniform bicubic B-spline patch with a 4×4 net) or
*extraordinary* (all regular but for one corner, an interior vertex of valence 3 or 5 and more; a net of 2n + 8 points
in Stam's order, as in Cheng, Chen and Yong 2006). Every other face is *irregular* and is refined first.

At a boundary edge or an infinitely sharp crease the surface is that of a net with phantom points V₋₁ = 2V₀ - V₁ beyond
it: the B-spline step then gives the edge points (V_a + V_b) / 2 and vertex points (1, 6, 1) / 8 of the crease rules,
and the phantom points of the next level, so such a face is regular when its corners are. At a fixed corner with one
face between its sharp edges both directions are extrapolated, V₋₁₋₁ = 4V₀₀ - 2V₀₁ - 2V₁₀ + V₁₁, whose B-spline limit is
V₀₀.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces
from .sharpness import VertexRule, has_semi_sharp, vertex_rules

Number = TypeVar("Number", int, IndexArray)


class PatchKind(IntEnum):
    """The kind of a face's patch; see the module's docstring."""

    REGULAR = 0
    EXTRAORDINARY = 1
    IRREGULAR = 2


class CornerKind(IntEnum):
    """The kind of patch that a face's corner allows; INSIDE and AT_SHARP_EDGE allow a spline patch."""

    OTHER = 0
    INSIDE = 1
    AT_SHARP_EDGE = 2
    EXTRAORDINARY = 3


@dataclass(frozen=True)
class PatchKinds:
    """kinds: (F,) int8 of PatchKind; extraordinary_corners: (F,) intp, for the extraordinary faces only that corner.
    inside: (F,) bool, quads with all corners smooth and inside the surface, among quads, of any valence but 2."""

    kinds: NDArray[np.int8]
    extraordinary_corners: IndexArray
    inside: BoolArray


def classify_patches(mesh: PolygonMesh) -> PatchKinds:
    """The kind of every face's patch. The mesh's sharpness is explicit (``sharpness.apply_boundary_rule``).

    In a submesh, right for faces whose corners have all their faces there.
    """
    corners = _classify_corners(mesh)
    quads = np.flatnonzero(mesh.face_sizes == 4)
    # One octal digit for each kind of corner counts how many of them a quad has.
    digits = np.array([0, 1, 8, 64], dtype=np.uint16)[corners]
    first = mesh.face_starts[quads]
    counts = digits[first] + digits[first + 1] + digits[first + 2] + digits[first + 3]
    kinds = np.full(mesh.face_count, PatchKind.IRREGULAR, dtype=np.int8)
    kinds[quads[(counts % 8) + (counts // 8) % 8 == 4]] = PatchKind.REGULAR
    kinds[quads[counts == 64 + 3]] = PatchKind.EXTRAORDINARY
    inside = np.zeros(mesh.face_count, dtype=bool)
    inside[quads] = (counts % 8) + counts // 64 == 4
    which = np.zeros(mesh.face_count, dtype=np.intp)
    found = np.flatnonzero(corners == CornerKind.EXTRAORDINARY)
    which[mesh.corner_faces[found]] = found
    return PatchKinds(kinds=kinds, extraordinary_corners=which, inside=inside)


def _classify_corners(mesh: PolygonMesh) -> NDArray[np.int8]:
    """(C,) int8 of ``CornerKind``.

    A corner of a spline patch has only quads around it (in its sector between sharp edges), and is an interior vertex
    of valence 4, a crease vertex with two faces in the sector, or a fixed vertex with one.
    """
    rules = vertex_rules(mesh)
    settled = ~has_semi_sharp(mesh)
    valence = mesh.vertex_face_counts
    smooth = settled & (rules == VertexRule.SMOOTH) & ~_touches_other_than_quads(mesh)
    kinds = np.full(mesh.vertex_count, CornerKind.OTHER, dtype=np.int8)
    kinds[smooth & (valence == 4)] = CornerKind.INSIDE
    kinds[smooth & ((valence == 3) | (valence >= 5))] = CornerKind.EXTRAORDINARY
    corner_kinds = kinds[mesh.corner_vertices]
    at_sharp = settled & ((rules == VertexRule.CREASE) | (rules == VertexRule.CORNER))
    corners = np.flatnonzero(at_sharp[mesh.corner_vertices])
    corner_kinds[corners[_regular_at_sharp_edges(mesh, corners, rules)]] = CornerKind.AT_SHARP_EDGE
    return corner_kinds


def _regular_at_sharp_edges(mesh: PolygonMesh, corners: IndexArray, rules: NDArray[np.int8]) -> BoolArray:
    """(corners,) bool: whether a spline patch can have each of the given corners at crease and fixed vertices."""
    sharp_edges = np.isinf(mesh.edge_sharpness)
    sharp_out = sharp_edges[mesh.corner_edges[corners]]
    sharp_in = sharp_edges[mesh.corner_edges[mesh.previous_corner[corners]]]
    fixed = rules[mesh.corner_vertices[corners]] == VertexRule.CORNER
    regular = fixed & sharp_out & sharp_in
    crease = np.flatnonzero(~fixed & (sharp_out != sharp_in))
    regular[crease] = _next_sector_edge_sharp(mesh, corners[crease], sharp_edges)
    return regular


def faces_on_grids(mesh: PolygonMesh) -> BoolArray:
    """(F,) bool: quads with a 4 × 4 grid for a net (``regular_nets``) by its topology, semi-sharp or not, and a
    surface that reproduces bilinear functions of the places [i, j] on the grid.

    With (i, j) for positions, the smooth rules, the crease rule along a line of the grid, midpoints of sharp edges and
    fixed vertices all give a point's own place, and so do blends of these. Two cases are excluded: a crease that turns,
    at a vertex with its two sharpest edges as neighbours, the other two being duller; and a dart at the end of an
    infinitely sharp crease, as points beyond it count that have no place in the net.
    """
    infinite = np.isinf(mesh.edge_sharpness)
    infinite_counts = np.bincount(mesh.edge_vertices[infinite].reshape(-1), minlength=mesh.vertex_count)
    edge_counts = np.bincount(mesh.edge_vertices.reshape(-1), minlength=mesh.vertex_count)
    fixed = np.isinf(mesh.vertex_sharpness)
    inside = (mesh.vertex_face_counts == 4) & (edge_counts == 4) & (infinite_counts == 0) & ~fixed
    inside &= ~_touches_other_than_quads(mesh) & ~_has_turning_crease(mesh)
    on_grid = inside[mesh.corner_vertices]
    rules = np.where(fixed | (infinite_counts > 2), VertexRule.CORNER, VertexRule.CREASE).astype(np.int8)
    corners = np.flatnonzero((fixed | (infinite_counts >= 2))[mesh.corner_vertices])
    on_grid[corners[_regular_at_sharp_edges(mesh, corners, rules)]] = True
    return np.logical_and.reduceat(on_grid, mesh.face_starts[:-1]) & (mesh.face_sizes == 4)


def _has_turning_crease(mesh: PolygonMesh) -> BoolArray:
    """(V,) bool: vertices of four edges inside the surface two of which, next to each other, are sharper than the
    others."""
    spokes = [np.arange(mesh.corner_count)]
    for _ in range(3):
        spokes.append(mesh.next_corner[mesh.twin[spokes[-1]]])
    first, second, third, fourth = (mesh.edge_sharpness[mesh.corner_edges[spoke]] for spoke in spokes)
    turning = mask(mesh.vertex_count, mesh.corner_vertices[np.minimum(first, second) > np.maximum(third, fourth)])
    return turning


def _touches_other_than_quads(mesh: PolygonMesh) -> BoolArray:
    """Vertices of a face that is not a quad: (V,) bool."""
    touched = np.zeros(mesh.vertex_count, dtype=bool)
    others = np.flatnonzero(mesh.face_sizes != 4)
    touched[mesh.corner_vertices[corners_of_faces(mesh, others)]] = True
    return touched


def _next_sector_edge_sharp(mesh: PolygonMesh, corners: IndexArray, sharp_edges: BoolArray) -> BoolArray:
    """(corners,) bool: across the corner's one smooth edge lies a quad whose other edge at the vertex is sharp."""
    before = mesh.previous_corner[corners]
    sharp_out = sharp_edges[mesh.corner_edges[corners]]
    neighbour = np.where(sharp_out, mesh.twin[before], mesh.next_corner[mesh.twin[corners]])
    other_edge = np.where(sharp_out, mesh.previous_corner[neighbour], neighbour)
    is_quad = mesh.face_sizes[mesh.corner_faces[neighbour]] == 4
    return sharp_edges[mesh.corner_edges[other_edge]] & is_quad


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
    sharp = np.isinf(mesh.edge_sharpness[mesh.corner_edges[corners]])
    _extrapolate(net, sharp)
    return net


def _outer_vertices(mesh: PolygonMesh, corners: IndexArray) -> tuple[IndexArray, IndexArray, IndexArray]:
    """For half-edges of quads: the two vertices of the quad across, and the vertex diagonal from the start.

    corners: (…) intp. near lies beyond the half-edge's start, far beyond its end, and diagonal across the corner at the
    start. A vertex of a missing neighbour has no meaning.
    """
    across = mesh.twin[corners]
    leaving = mesh.next_corner[across]
    near = mesh.corner_vertices[mesh.next_corner[leaving]]
    far = mesh.corner_vertices[mesh.previous_corner[across]]
    diagonal = mesh.corner_vertices[mesh.previous_corner[mesh.twin[leaving]]]
    return near, far, diagonal


def _extrapolate(net: FloatArray, sharp: BoolArray) -> None:
    """Put phantom points beyond sharp sides, in place: sharp (4, P) bool, the sides from each corner to the next."""
    for i, inner, second, side in ((0, 1, 2, 3), (3, 2, 1, 1)):
        patches = np.flatnonzero(sharp[side])
        if len(patches):
            net[i][:, patches] = 2 * net[inner][:, patches] - net[second][:, patches]
    for j, inner, second, side in ((0, 1, 2, 0), (3, 2, 1, 2)):
        patches = np.flatnonzero(sharp[side])
        if len(patches):
            net[:, j, patches] = 2 * net[:, inner, patches] - net[:, second, patches]


def ring_index(valence: int, number: Number) -> Number:
    """Index into an extraordinary net of ring point V_number, whose numbers 2 … 2n + 1 wrap around.

    number: an int, or an array of intp.
    """
    return (number - 2) % (2 * valence) + 1


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
