# SPDX-License-Identifier: GPL-3.0-or-later
"""The vertices of Blender's Subdivision Surface modifier with Use Limit Surface, and the Quality at which they are
exact.

The modifier evaluates patches that OpenSubdiv isolates to *Quality* levels (docs/methods.md, What Blender shows): cells
that are regular at an earlier level are exact bicubic patches; the patches of the last level meet the surface at their
corners only. The vertices of level k are corners of cells of level k, so Quality has to be at least the level. Quality
also has to be at least the largest finite sharpness, because a patch's corners ignore remaining semi-sharpness. Two
kinds of corners are met only approximately, better with every level of Quality:

- lone corners, of a single face between two infinitely sharp edges, mostly corners of an open mesh with smooth corners:
  OpenSubdiv leaves them at their control points of the last level;
- darts, vertices at which one infinitely sharp edge ends: OpenSubdiv places them as smooth vertices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.limit_positions import limit_positions
from ..surface.refinement import Refinement

# The largest Quality of a Subdivision Surface modifier.
MOST_QUALITY = 10

# The share of the tolerance reserved for unmet corners; where no Quality is enough, half of the tolerance at most.
CORNER_SHARE = 1 / 64
MOST_CORNER_SHARE = 1 / 2


@dataclass(frozen=True)
class UnmetCorners:
    """Corners of faces that Use Limit Surface shows slightly off the surface. corners: (N,) intp. gaps: (MOST_QUALITY +
    1,) float64, their largest distance from the surface at each Quality, in the unit of the positions.
    """

    corners: IndexArray
    gaps: FloatArray

    def margin(self, tolerance: float) -> float:
        """The part of a tolerance to reserve for unmet corners."""
        if self.gaps[MOST_QUALITY] > MOST_CORNER_SHARE * tolerance:
            return CORNER_SHARE * tolerance
        return max(CORNER_SHARE * tolerance, float(self.gaps[MOST_QUALITY]))

    def quality(self, tolerance: float) -> int:
        """The least Quality that brings the corners within the margin; above ``MOST_QUALITY`` if none does."""
        return max((level + 1 for level, gap in enumerate(self.gaps) if gap > self.margin(tolerance)), default=0)


def unmet_corners(mesh: PolygonMesh) -> UnmetCorners:
    """Unmet corners of a mesh whose sharpness is explicit. Semi-sharpness ends with the levels, and causes none."""
    lone, dart = _lone_and_dart(mesh)
    corners = np.flatnonzero(lone | dart)
    gaps = np.zeros(MOST_QUALITY + 1)
    if not len(corners):
        return UnmetCorners(corners, gaps)
    is_lone = lone[corners]
    faces, faces_of_corners = np.unique(mesh.corner_faces[corners], return_inverse=True)
    refinement = Refinement.start(mesh, faces)
    # The index of each corner's own child: at first the corner of the face, then the first corner of the child.
    places = refinement.mesh.face_starts[faces_of_corners] + corners - mesh.face_starts[mesh.corner_faces[corners]]
    for level in range(MOST_QUALITY + 1):
        gaps[level] = _gaps(refinement.mesh, refinement.mesh.corner_vertices[places], is_lone).max()
        # Children come in the order of the corners, which rise.
        own = mask(len(refinement.corner_vertices()), places)
        children = refinement.refined()
        refinement = replace(children, bases=np.arange(len(own))).keep(own)
        places = 4 * np.arange(len(corners))
    return UnmetCorners(corners, gaps)


def _lone_and_dart(mesh: PolygonMesh) -> tuple[BoolArray, BoolArray]:
    """(C,) bool twice: the lone corners, and the corners at darts."""
    is_sharp = np.isinf(mesh.edge_sharpness) & (mesh.edge_face_counts > 0)
    sharp_edges = np.bincount(mesh.edge_vertices[is_sharp].ravel(), minlength=mesh.vertex_count)
    moves = ~np.isinf(mesh.vertex_sharpness)
    between = is_sharp[mesh.corner_edges] & is_sharp[mesh.corner_edges[mesh.previous_corner]]
    lone = between & (moves & (sharp_edges == 2))[mesh.corner_vertices]
    return lone, (moves & (sharp_edges == 1))[mesh.corner_vertices]


def _gaps(mesh: PolygonMesh, vertices: IndexArray, is_lone: BoolArray) -> FloatArray:
    """(N,): the distances from the surface at which OpenSubdiv puts vertices at its last level."""
    wanted = mask(mesh.vertex_count, vertices)
    smooth = mesh.changed(
        edge_sharpness=np.zeros(len(mesh.edge_sharpness)), vertex_sharpness=np.zeros(mesh.vertex_count)
    )
    shown = np.where(is_lone[:, None], mesh.positions[vertices], limit_positions(smooth, wanted)[vertices])
    gaps: FloatArray = np.sqrt(squared_norms(shown - limit_positions(mesh, wanted)[vertices]))
    return gaps


def largest_finite_sharpness(mesh: PolygonMesh) -> float:
    """The largest finite sharpness of edges with faces, and of vertices."""
    edges = mesh.edge_sharpness[mesh.edge_face_counts > 0]
    vertices = mesh.vertex_sharpness[mesh.vertex_face_counts > 0]
    finite = (values[np.isfinite(values)] for values in (edges, vertices))
    return max(float(values.max(initial=0.0)) for values in finite)


def needed_quality(mesh: PolygonMesh, level: int, tolerance: float) -> int:
    """The least Quality, from 1 on, at which the modifier shows a level on the limit surface, with unmet corners within
    their margin of the tolerance; above ``MOST_QUALITY`` if no Quality is enough."""
    sharpness = int(np.ceil(largest_finite_sharpness(mesh)))
    return max(1, level, sharpness, unmet_corners(mesh).quality(tolerance))
