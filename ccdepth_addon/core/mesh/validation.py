# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation: which meshes have no Catmull-Clark surface, and why."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .polygon_mesh import PolygonMesh
from .submesh import corners_of_faces


class InvalidMeshError(ValueError):
    """The mesh has no Catmull-Clark surface; the message says why in a modeller's words."""


# A face has no area when its fan of triangles around the centroid covers less than this share of its perimeter
# squared: what rounding leaves of a face whose vertices lie on one line.
NO_AREA = 1e-12

# An angle whose parallelogram covers more than this share of its sides squared is no rounded straight line.
CLEAR_ANGLE = 1e-6


def validate(mesh: PolygonMesh) -> None:
    """Raise InvalidMeshError unless the mesh has faces, finite positions, valid creases, and no degenerate face."""
    if mesh.face_count == 0:
        raise InvalidMeshError("the mesh has no faces")
    if not np.all(np.isfinite(mesh.positions)):
        misplaced = ~np.isfinite(mesh.positions).all(axis=1) & (mesh.vertex_face_counts > 0)
        _refuse(misplaced, "vertex", "vertices", "at no finite position")
    _refuse(np.isnan(mesh.edge_sharpness), "edge", "edges", "with a crease that is no number")
    _refuse(np.isnan(mesh.vertex_sharpness), "vertex", "vertices", "with a crease that is no number")
    _refuse(_faces_with_repeated_vertices(mesh), "face", "faces", "with a repeated vertex")
    _refuse(_faces_without_area(mesh), "face", "faces", "with zero area")


def _refuse(bad: BoolArray, one: str, many: str, fault: str) -> None:
    found = np.flatnonzero(bad)
    if len(found):
        raise InvalidMeshError(f"{len(found):,} {one if len(found) == 1 else many} {fault} (first: {one} {found[0]})")


def _faces_with_repeated_vertices(mesh: PolygonMesh) -> BoolArray:
    """(F,) bool: sorted, the same vertices stand beside each other."""
    bad = np.zeros(mesh.face_count, dtype=bool)
    for size in np.flatnonzero(np.bincount(mesh.face_sizes)).tolist():
        faces = np.flatnonzero(mesh.face_sizes == size)
        first = mesh.face_starts[faces]
        vertices = [mesh.corner_vertices.take(first + corner) for corner in range(size)]
        for one, other in pairwise(np.sort(vertices, axis=0)):
            bad[faces[one == other]] = True
    return bad


def _faces_without_area(mesh: PolygonMesh) -> BoolArray:
    """(F,) bool: a face with a clear angle at its first corner has area; the others are measured as a whole."""
    bad = np.zeros(mesh.face_count, dtype=bool)
    first, last = mesh.face_starts[:-1], mesh.face_starts[1:] - 1
    at_first, a, b = (
        mesh.positions.take(mesh.corner_vertices.take(corner), axis=0)
        for corner in (first, np.minimum(first + 1, last), last)
    )
    a -= at_first
    b -= at_first
    squared_a, product, squared_b = (np.einsum("ij,ij->i", one, other) for one, other in ((a, a), (a, b), (b, b)))
    # The parallelogram's area squared; its cancellation errors are far below a clear angle.
    areas = squared_a * squared_b - product * product
    unclear = np.flatnonzero(areas <= (CLEAR_ANGLE * (squared_a + squared_b)) ** 2)
    if len(unclear):
        bad[unclear] = _faces_collapsed(mesh, unclear)
    return bad


def _faces_collapsed(mesh: PolygonMesh, faces: IndexArray) -> BoolArray:
    """(faces,) bool: whether the fan of triangles around the centroid has no area."""
    sizes = mesh.face_sizes[faces]
    starts = np.cumsum(sizes) - sizes
    corners = corners_of_faces(mesh, faces)
    points = mesh.positions[mesh.corner_vertices[corners]]
    following = mesh.positions[mesh.corner_vertices[mesh.next_corner[corners]]]
    centroids = np.repeat(np.add.reduceat(points, starts) / sizes[:, None], sizes, axis=0)
    areas = np.add.reduceat(_doubled_area(points - centroids, following - centroids), starts)
    perimeters = np.add.reduceat(np.linalg.norm(following - points, axis=1), starts)
    return areas <= NO_AREA * perimeters**2


def _doubled_area(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, 3) vectors each → (N,) the area of the parallelogram they span."""
    return np.linalg.norm(np.cross(a, b), axis=1)
