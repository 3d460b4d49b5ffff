# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of a mesh side by side, so that one pass works on all of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import IndexArray
from .polygon_mesh import PolygonMesh


def side_by_side(mesh: PolygonMesh, count: int) -> PolygonMesh:
    """So many copies of a mesh as one mesh: vertices, edges, corners and faces of the first copy, then of the next."""
    if count == 1:
        return mesh
    starts = _shifted(mesh.face_starts[:-1], mesh.corner_count, count)
    return PolygonMesh(
        positions=np.tile(mesh.positions, (count, 1)),
        face_starts=np.append(starts, count * mesh.corner_count),
        corner_vertices=_shifted(mesh.corner_vertices, mesh.vertex_count, count),
        corner_edges=_shifted(mesh.corner_edges, mesh.edge_count, count),
        edge_vertices=_shifted(mesh.edge_vertices, mesh.vertex_count, count),
        edge_sharpness=np.tile(mesh.edge_sharpness, count),
        vertex_sharpness=np.tile(mesh.vertex_sharpness, count),
        sharpness_is_explicit=mesh.sharpness_is_explicit,
    )


def _shifted(indices: NDArray[Any], step: int, count: int) -> IndexArray:
    """(count · N, …): the indices once for each copy, with the step added for every copy before it."""
    shifts = step * np.arange(count).reshape(-1, *[1] * indices.ndim)
    result: IndexArray = (indices + shifts).reshape(-1, *indices.shape[1:])
    return result
