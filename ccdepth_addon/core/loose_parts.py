# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices and edges without faces, which have no surface and stay as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .mesh import PolygonMesh
from .subdivided_mesh import SubdividedMesh
from .surface_points import SurfacePoints


def with_loose_parts(mesh: PolygonMesh, subdivided: SubdividedMesh) -> SubdividedMesh:
    """The subdivision with the control mesh's loose vertices and edges put after its own, where it does not have them.

    They lie on no surface, so the points that stand for them mean nothing: they go by ``base_vertices``.
    """
    loose_vertices = np.setdiff1d(np.flatnonzero(mesh.vertex_face_counts == 0), subdivided.base_vertices)
    loose_edges = np.setdiff1d(np.flatnonzero(mesh.edge_face_counts == 0), subdivided.base_edges)
    if not len(loose_vertices) and not len(loose_edges):
        return subdivided
    nowhere = SurfacePoints(np.zeros(len(loose_vertices), dtype=np.intp), np.zeros((len(loose_vertices), 2)))
    points = subdivided.vertex_points
    base_vertices = np.concatenate([subdivided.base_vertices, loose_vertices])
    places = np.zeros(mesh.vertex_count, dtype=np.intp)
    kept = np.flatnonzero(base_vertices >= 0)
    places[base_vertices[kept]] = kept
    return replace(
        subdivided,
        vertex_points=SurfacePoints(
            np.concatenate([points.corners, nowhere.corners]), np.concatenate([points.parameters, nowhere.parameters])
        ),
        positions=np.concatenate([subdivided.positions, mesh.positions[loose_vertices]]),
        edge_vertices=np.concatenate([subdivided.edge_vertices, places[mesh.edge_vertices[loose_edges]]]),
        base_edges=np.concatenate([subdivided.base_edges, loose_edges]),
        base_vertices=base_vertices,
        vertex_edges=np.concatenate([subdivided.vertex_edges, np.full(len(loose_vertices), -1)]),
    )
