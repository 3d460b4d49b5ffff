# SPDX-License-Identifier: GPL-3.0-or-later
"""Validation: the reasons why a mesh has no Catmull-Clark surface. A face without area has one, bounded by its control
points.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..arrays.types import BoolArray, IndexArray
from .polygon_mesh import PolygonMesh

NO_FACES = np.zeros(0, dtype=np.intp)


class InvalidMeshError(ValueError):
    """The error of a mesh without a Catmull-Clark surface. The message gives the reason in a modeller's words.

    faces: (N,) intp, ascending, the faces at fault; empty where the mesh as a whole is at fault.
    """

    def __init__(self, message: str, faces: IndexArray = NO_FACES) -> None:
        super().__init__(message)
        self.faces = faces


def validate(mesh: PolygonMesh) -> None:
    """Raise InvalidMeshError unless the mesh has faces and an extent, finite positions, valid creases, and no face that
    visits a vertex twice."""
    if mesh.face_count == 0:
        raise InvalidMeshError("the mesh has no faces")
    nowhere = _is_nowhere(mesh)
    bad_edges, bad_vertices = np.isnan(mesh.edge_sharpness), np.isnan(mesh.vertex_sharpness)
    repeated = _faces_with_repeated_vertices(mesh)
    faults = [
        _fault(nowhere, "vertex", "vertices", "at no finite position"),
        _fault(bad_edges, "edge", "edges", "with a crease that is not a number"),
        _fault(bad_vertices, "vertex", "vertices", "with a crease that is not a number"),
        _fault(repeated, "face", "faces", "with a repeated vertex"),
    ]
    if any(faults):
        bad = repeated.copy()
        bad[mesh.corner_faces[(nowhere | bad_vertices)[mesh.corner_vertices] | bad_edges[mesh.corner_edges]]] = True
        raise InvalidMeshError(", ".join(filter(None, faults)), np.flatnonzero(bad))
    if _is_one_point(mesh):
        raise InvalidMeshError("all its faces are at one point")


def has_good_positions(mesh: PolygonMesh) -> bool:
    """Whether a mesh that is valid with other positions has finite positions, not all at one point."""
    return bool(np.isfinite(mesh.positions).all()) and not _is_one_point(mesh)


def _fault(bad: BoolArray, one: str, many: str, fault: str) -> str:
    """The number of things at fault in words, empty for none."""
    found = np.flatnonzero(bad)
    return f"{len(found):,} {one if len(found) == 1 else many} {fault} (first: {one} {found[0]})" if len(found) else ""


def _is_nowhere(mesh: PolygonMesh) -> BoolArray:
    """(V,) bool: the vertices with faces at no finite position."""
    finite = np.isfinite(mesh.positions)
    if finite.all():
        return np.zeros(mesh.vertex_count, dtype=bool)
    return ~finite.all(axis=1) & (mesh.vertex_face_counts > 0)


def _is_one_point(mesh: PolygonMesh) -> bool:
    """Whether all vertices with faces are at one point. Mostly the first edge disproves it."""
    first = mesh.positions[mesh.corner_vertices[0]]
    if np.any(mesh.positions[mesh.corner_vertices[1:2]] != first):
        return False
    return not np.any((mesh.positions != first).any(axis=1) & (mesh.vertex_face_counts > 0))


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
