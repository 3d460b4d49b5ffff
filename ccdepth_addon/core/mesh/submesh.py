# SPDX-License-Identifier: GPL-3.0-or-later
"""Submeshes of faces with their one-ring, renumbered indices, and meshes joined to one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.masks import mask
from ..arrays.ranges import any_of_ranges
from ..arrays.types import BoolArray, IndexArray
from .polygon_mesh import PolygonMesh


def submesh(mesh: PolygonMesh, faces: IndexArray) -> tuple[PolygonMesh, IndexArray]:
    """The given faces with every face that shares a vertex with them (their one-ring), as a mesh of its own.

    faces: (n,) ints, each face once. Returns the submesh and (m,) intp, for each of its faces the face of ``mesh``: the
    given ones first, in the given order, then the ring in the order of ``mesh``. Vertices and edges keep their order;
    those without a kept face are dropped. Sharpness is copied unchanged, so the outer border of the ring follows no
    boundary rules: a Catmull-Clark step moves everything that touches the given faces exactly as in the whole mesh;
    only the ring's outer half differs.
    """
    touched = mask(mesh.vertex_count, mesh.corner_vertices[corners_of_faces(mesh, faces)])
    in_ring = mask(mesh.face_count, mesh.corner_faces[touched[mesh.corner_vertices]])
    in_ring[faces] = False
    kept_faces = np.concatenate([np.asarray(faces, dtype=np.intp), np.flatnonzero(in_ring)])
    return faces_alone(mesh, kept_faces), kept_faces


def faces_alone(mesh: PolygonMesh, faces: IndexArray) -> PolygonMesh:
    """The given faces (n,), each once, as a mesh of its own, without the faces around.

    Vertices and edges keep their order; those without a given face are dropped. Sharpness is copied unchanged. A
    Catmull-Clark step makes the same points as in the whole mesh for the faces, and for vertices and edges with all
    their faces given.
    """
    kept_corners = corners_of_faces(mesh, faces)
    corner_vertices, corner_edges = mesh.corner_vertices[kept_corners], mesh.corner_edges[kept_corners]
    kept_vertices, kept_edges = compact(corner_vertices, mesh.vertex_count), compact(corner_edges, mesh.edge_count)
    new_vertex = np.zeros(mesh.vertex_count, dtype=np.intp)
    new_vertex[kept_vertices] = np.arange(len(kept_vertices))
    return PolygonMesh(
        positions=mesh.positions[kept_vertices],
        face_starts=np.concatenate([[0], np.cumsum(mesh.face_sizes[faces])]).astype(np.intp),
        corner_vertices=corner_vertices,
        corner_edges=corner_edges,
        edge_vertices=new_vertex[mesh.edge_vertices[kept_edges]],
        edge_sharpness=mesh.edge_sharpness[kept_edges],
        vertex_sharpness=mesh.vertex_sharpness[kept_vertices],
        sharpness_is_explicit=mesh.sharpness_is_explicit,
    )


def rings_around(mesh: PolygonMesh, wanted: BoolArray, rings: int) -> BoolArray:
    """(n,) bool: the wanted faces (n,) among the first n, and a number of rings around them: each ring shares a vertex
    with the faces inside."""
    last = mesh.face_starts[len(wanted)]
    vertices, faces = mesh.corner_vertices[:last], mesh.corner_faces[:last]
    for _ in range(rings if len(wanted) else 0):
        touched = mask(mesh.vertex_count, vertices[wanted[faces]])
        wanted = any_of_ranges(touched[vertices], mesh.face_sizes[: len(wanted)])
    return wanted


def joined_meshes(meshes: Sequence[PolygonMesh], counts: Sequence[int]) -> PolygonMesh:
    """Several meshes beside each other as one. counts: for each mesh the number of its first faces that come first in
    the joined mesh, mesh by mesh; the other faces follow."""
    vertices = np.cumsum([0, *(mesh.vertex_count for mesh in meshes)])
    edges = np.cumsum([0, *(mesh.edge_count for mesh in meshes)])
    ends = [int(mesh.face_starts[count]) for mesh, count in zip(meshes, counts, strict=True)]

    def reordered(columns: list[IndexArray], firsts: Sequence[int]) -> IndexArray:
        pairs = list(zip(columns, firsts, strict=True))
        return np.concatenate([each[:count] for each, count in pairs] + [each[count:] for each, count in pairs])

    sizes = reordered([mesh.face_sizes for mesh in meshes], counts)
    return PolygonMesh(
        positions=np.concatenate([mesh.positions for mesh in meshes]),
        face_starts=np.concatenate([[0], np.cumsum(sizes)]).astype(np.intp),
        corner_vertices=reordered([mesh.corner_vertices + vertices[i] for i, mesh in enumerate(meshes)], ends),
        corner_edges=reordered([mesh.corner_edges + edges[i] for i, mesh in enumerate(meshes)], ends),
        edge_vertices=np.concatenate([mesh.edge_vertices + vertices[i] for i, mesh in enumerate(meshes)]),
        edge_sharpness=np.concatenate([mesh.edge_sharpness for mesh in meshes]),
        vertex_sharpness=np.concatenate([mesh.vertex_sharpness for mesh in meshes]),
        sharpness_is_explicit=meshes[0].sharpness_is_explicit,
    )


def corners_of_faces(mesh: PolygonMesh, faces: IndexArray) -> IndexArray:
    """(sum of sizes,) intp, the corners of the given faces, face by face in the given order."""
    sizes = mesh.face_sizes[faces]
    skipped = mesh.face_starts[faces] - (np.cumsum(sizes) - sizes)
    return np.arange(sizes.sum()) + np.repeat(skipped, sizes)


def compact(indices: NDArray[Any], count: int, kept: IndexArray | None = None) -> IndexArray:
    """The numbers 0 … count - 1 that occur in ``indices`` or ``kept``, in ascending order; renumbers the indices in
    place to match."""
    is_used = mask(count, indices)
    if kept is not None:
        is_used[kept] = True
    renumber(indices, is_used)
    return np.flatnonzero(is_used)


def renumber(indices: NDArray[Any], used: BoolArray) -> None:
    """Renumber indices of used entries by their rank among the used ones, in place: (count,) bool."""
    numbers = np.cumsum(used, dtype=indices.dtype)
    numbers -= 1
    indices[:] = numbers.take(indices)
