# SPDX-License-Identifier: GPL-3.0-or-later
"""UV maps as face-varying surfaces: the corners that share a UV vertex, and the places where the map stays sharp.

A UV map is a control mesh in the plane with the faces and corners of its mesh, cut open along its seams. Subdividing it
needs no rules beside those of ``catmull_clark``, given the right sharpness. This follows OpenSubdiv's face-varying
interpolation (its ``vtr/fvarLevel``) and Blender's converter to it, in our own words:

- Corners at a vertex share a UV vertex when their UVs are closer than ``WELD_DISTANCE`` in u and in v, and their faces
  are wound the same way in the map: a mirrored half stays apart though its UVs coincide.
- An edge is whole when the faces at it share the UV vertices at both its ends; else it is cut, into one for each face.
- Whole edges, and UV vertices that no cut touches, follow the rules of the mesh's own edges and vertices, creases too.
- Cut edges are sharp; the modifier's UV Smooth decides what happens at their ends.
- A UV vertex in several fans of faces, which touch in a point, stays in place. But if two such UV vertices alternate
  around a vertex, OpenSubdiv counts the second fan of the second one as another UV vertex, and so does this module.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import INFINITELY_SHARP, PolygonMesh

WELD_DISTANCE = np.float32(1e-4)

# The modifier's UV Smooth. With NONE, values are interpolated linearly, and there is no surface.
UV_SMOOTH = (
    "NONE",
    "PRESERVE_CORNERS",
    "PRESERVE_CORNERS_AND_JUNCTIONS",
    "PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE",
    "PRESERVE_BOUNDARIES",
    "SMOOTH_ALL",
)
JUNCTIONS = {"PRESERVE_CORNERS_AND_JUNCTIONS", "PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE"}
DARTS = {"PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE", "PRESERVE_BOUNDARIES"}


def face_varying_surface(mesh: PolygonMesh, uvs: NDArray[np.float32], smooth: str) -> PolygonMesh:
    """The control mesh of a UV map, with vertices at (u, v, 0) and the same faces and corners as ``mesh``.

    mesh: with explicit sharpness. uvs: (C, 2) float32, finite. smooth: one of ``UV_SMOOTH`` but NONE.
    """
    if smooth not in UV_SMOOTH[1:]:
        raise ValueError(f"no surface of a UV map is smoothed as {smooth}")
    cut = _CutMesh(mesh, *_parted(mesh, *_welded(mesh, uvs)))
    whole = cut.mesh
    corners = _sharp_corners(cut, smooth)
    # A neighbour's sharpness does not change UV vertices with sharpness of their own.
    softly = np.where(whole.vertex_sharpness > 0, whole.vertex_sharpness, _neighbours_sharpness(cut, smooth))
    return replace(whole, vertex_sharpness=np.where(corners, INFINITELY_SHARP, softly))


def _welded(mesh: PolygonMesh, uvs: NDArray[np.float32]) -> tuple[IndexArray, FloatArray]:
    """(C,) intp, the UV vertex of each corner, and (W, 3) float64, the positions of the UV vertices.

    In every round the last corner left at each vertex joins the others near it. The order, Blender's own, matters only
    where UVs differ by about the welding distance.
    """
    uvs = uvs.astype(np.float32)
    mirrored = _is_mirrored(mesh, uvs)[mesh.corner_faces]
    leaders = np.zeros(mesh.corner_count, dtype=np.intp)
    last = np.zeros(mesh.vertex_count, dtype=np.intp)
    left = np.arange(mesh.corner_count)
    while len(left):
        vertices = mesh.corner_vertices[left]
        last[vertices] = left
        leader = last[vertices]
        near = (np.abs(uvs[left] - uvs[leader]) < WELD_DISTANCE).all(axis=1) & (mirrored[left] == mirrored[leader])
        near |= left == leader
        leaders[left[near]] = leader[near]
        left = left[~near]
    chosen, corner_uvs = np.unique(leaders, return_inverse=True)
    positions = np.zeros((len(chosen), 3))
    positions[:, :2] = uvs[chosen]
    return corner_uvs.reshape(-1).astype(np.intp), positions


def _is_mirrored(mesh: PolygonMesh, uvs: NDArray[np.float32]) -> BoolArray:
    """(F,) whether each face runs clockwise in the map."""
    (u, v), (next_u, next_v) = uvs.T.astype(np.float64), uvs[mesh.next_corner].T.astype(np.float64)
    return np.add.reduceat((u - next_u) * (v + next_v), mesh.face_starts[:-1]) < 0


def _parted(mesh: PolygonMesh, corner_uvs: IndexArray, positions: FloatArray) -> tuple[IndexArray, FloatArray]:
    """The result of ``_welded`` with one more UV vertex for the fourth fan of faces around a vertex, wherever the first
    four belong to two UV vertices alternately.

    Fans are counted from OpenSubdiv's first face on, counter-clockwise.
    """
    uv_counts = _uv_counts(mesh, _base_vertices(mesh, corner_uvs, len(positions)))
    corners = _first_corners(mesh, uv_counts > 1)
    # For the vertices whose faces are left to visit: the UV vertices of the first two fans, and the current fan.
    first, second, fans = corner_uvs[corners], corner_uvs[corners], np.ones(len(corners), dtype=np.intp)
    parted = np.zeros(mesh.corner_count, dtype=bool)
    left = mesh.vertex_face_counts[mesh.corner_vertices[corners]] - 1
    while len(going := np.flatnonzero(left > 0)):
        corners, first, second, fans, left = (values[going] for values in (corners, first, second, fans, left - 1))
        following = mesh.twin[mesh.previous_corner[corners]]
        fans = fans + (corner_uvs[following] != corner_uvs[corners])
        second = np.where(fans == 2, corner_uvs[following], second)
        in_turn = corner_uvs[following] == np.where(fans % 2 == 1, first, second)
        parted[following[in_turn & (fans == 4)]] = True
        corners, left = following, np.where(in_turn & (fans <= 4), left, 0)
    origins, numbers = np.unique(corner_uvs[parted], return_inverse=True)
    moved = corner_uvs.copy()
    moved[parted] = len(positions) + numbers.reshape(-1)
    return moved, np.concatenate([positions, positions[origins]])


def _first_corners(mesh: PolygonMesh, wanted: BoolArray) -> IndexArray:
    """The corner from which OpenSubdiv goes around each wanted vertex (V,) with a single fan or ring of faces: on the
    boundary the corner without a face before it, elsewhere the corner of the first face.

    Infinitely sharp vertices, among them all vertices with other faces, are left out, as nothing moves there.
    """
    corners = np.arange(mesh.corner_count)
    on_boundary = corners[mesh.twin == corners]
    first = np.full(mesh.vertex_count, mesh.corner_count, dtype=np.intp)
    np.minimum.at(first, mesh.corner_vertices, corners)
    first[mesh.corner_vertices[on_boundary]] = on_boundary
    return first[wanted & ~np.isinf(mesh.vertex_sharpness) & ~_touch(mesh, _not_manifold(mesh))]


def _base_vertices(mesh: PolygonMesh, corner_uvs: IndexArray, count: int) -> IndexArray:
    """(W,) the mesh vertex of each of W UV vertices."""
    found = np.zeros(count, dtype=np.intp)
    found[corner_uvs] = mesh.corner_vertices
    return found


def _uv_counts(mesh: PolygonMesh, base_vertices: IndexArray) -> IndexArray:
    """(V,) the number of UV vertices at each vertex."""
    return np.bincount(base_vertices, minlength=mesh.vertex_count)


def _not_manifold(mesh: PolygonMesh) -> BoolArray:
    """(E,) bool: the edges with several faces, other than one on either side."""
    return (mesh.edge_face_counts > 1) & ~mesh.edge_has_twins


def _touch(mesh: PolygonMesh, edges: BoolArray) -> BoolArray:
    """(V,) bool: whether a vertex touches one of the given edges (E,)."""
    return mask(mesh.vertex_count, mesh.edge_vertices[edges].reshape(-1))


class _CutMesh:
    """A mesh cut open along the seams of a UV map. W UV vertices; V, E, C of the mesh."""

    def __init__(self, base: PolygonMesh, corner_uvs: IndexArray, positions: FloatArray) -> None:
        self.base = base
        self.uv_count = len(positions)
        self.base_vertices = _base_vertices(base, corner_uvs, self.uv_count)
        self.uv_counts = _uv_counts(base, self.base_vertices)
        following = corner_uvs[base.next_corner]
        backwards = base.edge_vertices[base.corner_edges, 1] == base.corner_vertices
        ends = np.where(backwards[:, None], np.stack([following, corner_uvs], 1), np.stack([corner_uvs, following], 1))
        self.edge_is_cut = self._find_cuts(ends)
        self.mesh = self._with_edges(corner_uvs, positions, ends)

    def _find_cuts(self, ends: IndexArray) -> BoolArray:
        """(E,) whether the faces at an edge disagree, for the UV vertices (C, 2) at its ends in each of them."""
        edges = self.base.corner_edges
        agreed = np.zeros((self.base.edge_count, 2), dtype=np.intp)
        agreed[edges] = ends
        cut = mask(self.base.edge_count, edges[(ends != agreed[edges]).any(axis=1)])
        return cut

    def _with_edges(self, corner_uvs: IndexArray, positions: FloatArray, ends: IndexArray) -> PolygonMesh:
        """Number edges: whole edges keep their number, and the parts of cut edges come after them."""
        base = self.base
        cut_corners = np.flatnonzero(self.edge_is_cut[base.corner_edges])
        corner_edges = base.corner_edges.copy()
        corner_edges[cut_corners] = base.edge_count + np.arange(len(cut_corners))
        edge_vertices = np.zeros((base.edge_count + len(cut_corners), 2), dtype=np.intp)
        edge_vertices[corner_edges] = ends
        sharp_parts = np.full(len(cut_corners), INFINITELY_SHARP)
        # Edges without faces must have no effect.
        edge_sharpness = np.where(self.edge_is_cut | (base.edge_face_counts == 0), 0.0, base.edge_sharpness)
        return PolygonMesh(
            positions=positions,
            face_starts=base.face_starts,
            corner_vertices=corner_uvs,
            corner_edges=corner_edges,
            edge_vertices=edge_vertices,
            edge_sharpness=np.concatenate([edge_sharpness, sharp_parts]),
            vertex_sharpness=base.vertex_sharpness[self.base_vertices],
            sharpness_is_explicit=True,
        )

    def edges_at(self, edges: BoolArray) -> IndexArray:
        """(W,): the number of given edges of the cut mesh at each UV vertex."""
        return np.bincount(self.mesh.edge_vertices[edges].reshape(-1), minlength=self.uv_count)

    @property
    def inner_edges(self) -> BoolArray:
        """Edges of the cut mesh with a face on either side."""
        return self.mesh.edge_face_counts > 1


def _sharp_corners(cut: _CutMesh, smooth: str) -> BoolArray:
    """(W,) bool, the UV vertices that cuts and boundaries hold in place."""
    base = cut.base
    on_boundary = _touch(base, base.edge_face_counts == 1)
    not_manifold = _touch(base, _not_manifold(base))
    cut_open = _touch(base, cut.edge_is_cut)
    changed = cut_open | (not_manifold & (cut.uv_counts > 1))
    all_sharp = changed & not_manifold
    if smooth == "PRESERVE_BOUNDARIES":
        all_sharp |= changed | on_boundary
    if smooth in DARTS:
        all_sharp |= cut_open & (cut.uv_counts == 1) & ~on_boundary
    # More than two edges with one face: the faces at the UV vertex are several fans, or one fan with a cut.
    torn = cut.edges_at(cut.mesh.edge_face_counts == 1) > 2
    single = cut.mesh.vertex_face_counts == 1
    if smooth in JUNCTIONS:
        all_sharp |= changed & (cut.uv_counts > 2)
        unsettled = torn | (cut.edges_at(cut.inner_edges & np.isinf(cut.mesh.edge_sharpness)) > 0)
        if smooth in DARTS:
            unsettled |= single
        all_sharp |= changed & (cut.uv_counts == 2) & _anywhere(cut, unsettled)
    sharp = all_sharp[cut.base_vertices] | (torn & changed[cut.base_vertices])
    if smooth != "SMOOTH_ALL":
        sharp |= single & (changed | on_boundary)[cut.base_vertices]
    return sharp


def _anywhere(cut: _CutMesh, chosen: BoolArray) -> BoolArray:
    """(V,) whether one of the UV vertices at a vertex is among the chosen ones (W,)."""
    return mask(cut.base.vertex_count, cut.base_vertices[chosen])


def _neighbours_sharpness(cut: _CutMesh, smooth: str) -> FloatArray:
    """(W,): the sharpness that one of two UV vertices at a vertex takes from the other, if junctions are kept.

    While other creases at the vertex go on, along the cut, the sharpness lasts to the end of the level.
    """
    if smooth not in JUNCTIONS:
        return np.zeros(cut.uv_count)
    own = _faded(cut.mesh, np.where(cut.inner_edges, cut.mesh.edge_sharpness, 0.0))
    of_two = np.zeros(cut.base.vertex_count)
    np.maximum.at(of_two, cut.base_vertices, own)
    of_two[cut.uv_counts != 2] = 0.0
    semi_sharp = np.where(np.isinf(cut.base.edge_sharpness), 0.0, cut.base.edge_sharpness)
    of_two = np.where(_sharpest(cut.base, semi_sharp) > np.ceil(of_two), np.ceil(of_two), of_two)
    return np.where(own == 0, of_two[cut.base_vertices], 0.0)


def _sharpest(mesh: PolygonMesh, edge_sharpness: FloatArray) -> FloatArray:
    """(V,): the largest of the sharpnesses (E,) of edges at each vertex."""
    sharpest = np.zeros(mesh.vertex_count)
    chosen = edge_sharpness > 0
    np.maximum.at(sharpest, mesh.edge_vertices[chosen].reshape(-1), np.repeat(edge_sharpness[chosen], 2))
    return sharpest


def _faded(mesh: PolygonMesh, edge_sharpness: FloatArray) -> FloatArray:
    """(V,): the number of levels after which none of the sharpnesses (E,) is left at each vertex: the mean of the
    sharpnesses that end in the last level."""
    last = np.ceil(_sharpest(mesh, edge_sharpness)) - 1
    chosen = edge_sharpness > 0
    ends, values = mesh.edge_vertices[chosen].reshape(-1), np.repeat(edge_sharpness[chosen], 2)
    in_last = (values > last[ends]) | np.isinf(values)
    counts = np.bincount(ends[in_last], minlength=mesh.vertex_count)
    return np.bincount(ends[in_last], values[in_last], mesh.vertex_count) / np.maximum(counts, 1)
