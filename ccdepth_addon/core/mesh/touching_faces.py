# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of faces and of all faces that touch them, in a vertex at least."""

from __future__ import annotations

import numpy as np

from ..arrays.types import FloatArray
from .polygon_mesh import PolygonMesh


def least_of_touching(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(F,): for each face the least of values (F,) over all faces that share a vertex with it."""
    at_vertices = np.full(mesh.vertex_count, np.inf)
    np.minimum.at(at_vertices, mesh.corner_vertices, values[mesh.corner_faces])
    found: FloatArray = np.minimum.reduceat(at_vertices[mesh.corner_vertices], mesh.face_starts[:-1])
    return found


def surface_boxes(mesh: PolygonMesh) -> tuple[FloatArray, FloatArray]:
    """(3, F) twice: the least and greatest coordinates of the control points of each face's surface, which lies in
    their hull: the vertices of the face and of all faces that touch it."""

    def least(along: FloatArray) -> FloatArray:
        return least_of_touching(mesh, np.minimum.reduceat(along[mesh.corner_vertices], mesh.face_starts[:-1]))

    low, high = (np.stack([least(sign * along) for along in mesh.positions.T]) for sign in (1, -1))
    return low, -high
