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
from ..arrays.chunks import AT_ONCE, chunks
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
    for block in chunks(len(values), AT_ONCE):
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
        inner_values = evaluate(subdivided.vertex_points.at(np.flatnonzero(inside))).astype(np.float32)
        rows = np.cumsum(inside) - 1
        corners = np.flatnonzero(corner_inside)
        values[corners] = inner_values[rows[subdivided.corner_vertices[corners]]]
    return values


def at_vertices(subdivided: SubdividedMesh, values: NDArray[Any], evaluate: Evaluate, kept: BoolArray) -> NDArray[Any]:
    """(V, D): control values at kept control vertices, and the values of ``evaluate`` at all other vertices.

    values: (control vertices, D). kept: (control vertices,) bool, True at all loose vertices.
    """
    found = evaluate(subdivided.vertex_points.at(np.flatnonzero(~kept)))
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


def to_rotation_vectors(quaternions: FloatArray) -> FloatArray:
    """(N, 3): rotation vectors, axis times angle from 0 to 2π, of quaternions (N, 4), w, x, y, z."""
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.divide(quaternions, lengths, out=np.tile([1.0, 0.0, 0.0, 0.0], (len(lengths), 1)), where=lengths > 0)
    sines = np.linalg.norm(unit[:, 1:], axis=1, keepdims=True)
    angles = 2 * np.arctan2(sines, unit[:, :1])
    return unit[:, 1:] * np.divide(angles, sines, out=np.full_like(sines, 2.0), where=sines > 0)


def to_quaternions(rotation_vectors: FloatArray) -> FloatArray:
    """(N, 4): unit quaternions w, x, y, z, from rotation vectors (N, 3), axis times angle."""
    angles = np.linalg.norm(rotation_vectors, axis=1, keepdims=True)
    scaled = np.divide(np.sin(angles / 2), angles, out=np.full_like(angles, 0.5), where=angles > 0)
    return np.concatenate([np.cos(angles / 2), scaled * rotation_vectors], axis=1)


def split_transformations(matrices: FloatArray) -> FloatArray:
    """(N, 9): location, rotation vector and scale of matrices (N, 16), column by column. Shear is lost."""
    columns = matrices.reshape(-1, 4, 4)[:, :3, :3]
    scales = np.linalg.norm(columns, axis=2)
    mirrored = np.linalg.det(columns) < 0
    scales = np.where(mirrored[:, None], -scales, scales)
    unturned = np.tile(np.eye(3), (len(columns), 1, 1))
    axes = np.divide(columns, scales[:, :, None], out=unturned, where=scales[:, :, None] != 0)
    rotations = to_rotation_vectors(_quaternions_of(axes))
    return np.concatenate([matrices.reshape(-1, 4, 4)[:, 3, :3], rotations, scales], axis=1)


def join_transformations(parts: FloatArray) -> FloatArray:
    """(N, 16): matrices, column by column, from parts (N, 9): location, rotation vector, scale."""
    w, x, y, z = to_quaternions(parts[:, 3:6]).T
    axes = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1),
            np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=1),
            np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )
    matrices = np.zeros((len(parts), 4, 4))
    matrices[:, :3, :3] = axes * parts[:, 6:, None]
    matrices[:, 3, :3] = parts[:, :3]
    matrices[:, 3, 3] = 1.0
    return matrices.reshape(-1, 16)


def _quaternions_of(axes: FloatArray) -> FloatArray:
    """(N, 3, 3), the images of x, y and z under rotations, → (N, 4): the column of q qᵀ with the largest diagonal."""
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = (axes[:, column].T for column in range(3))
    products = np.empty((len(axes), 4, 4))
    products[:, 0] = np.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy], axis=1)
    products[:, 1] = np.stack([zy - yz, 1 + xx - yy - zz, yx + xy, xz + zx], axis=1)
    products[:, 2] = np.stack([xz - zx, yx + xy, 1 - xx + yy - zz, zy + yz], axis=1)
    products[:, 3] = np.stack([yx - xy, xz + zx, zy + yz, 1 - xx - yy + zz], axis=1)
    largest = np.argmax(np.diagonal(products, axis1=1, axis2=2), axis=1)
    found = products[np.arange(len(axes)), largest]
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    return np.where(found[:, :1] < 0, -found, found)
