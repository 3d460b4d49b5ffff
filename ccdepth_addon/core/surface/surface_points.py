# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of a surface by their place on the control mesh, and values interpolated linearly at them.

Every corner of the control mesh has a *quarter* of its face: the quad over the corner's vertex, the middle of the edge
that leaves it, the face's centroid, and the middle of the edge before it, with parameters (0, 0), (1, 0), (1, 1) and
(0, 1). The quarter is the face's child at that corner after one Catmull-Clark step, for faces of any size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh


@dataclass(frozen=True)
class SurfacePoints(Table):
    """N points of the limit surface. corners: (N,) intp, corners of the control mesh; parameters: (N, 2) float64,
    within the quarters of the corners."""

    corners: IndexArray
    parameters: FloatArray


def interpolate_linearly(mesh: PolygonMesh, corner_values: FloatArray, points: SurfacePoints) -> FloatArray:
    """(N, D): values (C, D) at the corners of a mesh, bilinear over the quarters; over a quad, simply bilinear.

    The value at the middle of an edge is the mean of its ends' within the same face, that at the centroid the mean of
    the face's corners.
    """
    u, v = points.parameters[:, :1], points.parameters[:, 1:]
    own = corner_values[points.corners]
    following = (own + corner_values[mesh.next_corner[points.corners]]) / 2
    before = (own + corner_values[mesh.previous_corner[points.corners]]) / 2
    sums = np.add.reduceat(corner_values, mesh.face_starts[:-1])
    centroids = (sums / mesh.face_sizes[:, None])[mesh.corner_faces[points.corners]]
    return (1 - v) * ((1 - u) * own + u * following) + v * ((1 - u) * before + u * centroids)
