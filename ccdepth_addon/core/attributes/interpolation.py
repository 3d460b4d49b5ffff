# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a control mesh at the vertices, edges and corners of its subdivision: interpolated, or copied.

Interpolation is that of Blender's Subdivision Surface modifier: bilinear over the quarters of a face; rotations by
their axis times their angle; a transformation by its location, its rotation and its scale.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..adaptive.subdivided_mesh import SubdividedMesh
from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.surface_points import SurfacePoints, interpolate_linearly

# (N points) → (N, D)
Evaluate = Callable[[SurfacePoints], NDArray[Any]]


def interpolated(mesh: PolygonMesh, corner_values: FloatArray, points: SurfacePoints) -> NDArray[np.float32]:
    """(N, D) float32: corner values interpolated linearly within faces, at points of the surface.

    corner_values: (C, D), at the corners of the control mesh.
    """
    values = np.empty((len(points.corners), corner_values.shape[1]), dtype=np.float32)
    for block in index_chunks(np.arange(len(values)), AT_ONCE):
        values[block] = interpolate_linearly(mesh, corner_values, points.at(block))
    return values


def at_corners(subdivided: SubdividedMesh, evaluate: Evaluate) -> NDArray[np.float32]:
    """(C, D) float32: the values of ``evaluate`` at the corners, evaluated once for each vertex inside a base face."""
    inside = (subdivided.base_vertices < 0) & (subdivided.vertex_edges < 0)
    corner_inside = inside[subdivided.corner_vertices]
    on_border = np.flatnonzero(~corner_inside)
    border_values = evaluate(subdivided.corner_points.at(on_border))
    values = np.empty((len(corner_inside), border_values.shape[1]), dtype=np.float32)
    values[on_border] = border_values
    if len(on_border) < len(values):
        inner_values = evaluate(subdivided.vertex_points.at(inside)).astype(np.float32)
        rows = np.cumsum(inside) - 1
        corners = np.flatnonzero(corner_inside)
        values[corners] = inner_values[rows[subdivided.corner_vertices[corners]]]
    return values


def at_vertices(subdivided: SubdividedMesh, values: NDArray[Any], evaluate: Evaluate, kept: BoolArray) -> NDArray[Any]:
    """(V, D): control values at kept control vertices, and the values of ``evaluate`` at all other vertices.

    values: (control vertices, D). kept: (control vertices,) bool, True at all loose vertices.
    """
    found = evaluate(subdivided.vertex_points.at(~kept))
    result = np.empty((len(kept), values.shape[1]), dtype=found.dtype)
    result[~kept] = found
    result[kept] = values[subdivided.base_vertices[kept]]
    return result


def interpolated_at_vertices(mesh: PolygonMesh, values: FloatArray, subdivided: SubdividedMesh) -> NDArray[np.float32]:
    """(V, D) float32: values of the control vertices, interpolated linearly; control vertices keep their values
    exactly."""
    corner_values = values[mesh.corner_vertices]
    return at_vertices(
        subdivided, values, lambda points: interpolated(mesh, corner_values, points), subdivided.base_vertices >= 0
    )


def nearest_vertices(mesh: PolygonMesh, subdivided: SubdividedMesh) -> IndexArray:
    """(V,) intp: for each vertex the nearest control vertex of its base face."""
    nearest = mesh.corner_vertices[subdivided.vertex_points.corners]
    return np.where(subdivided.base_vertices >= 0, subdivided.base_vertices, nearest)
