# SPDX-License-Identifier: GPL-3.0-or-later
"""Lines on a mesh that must stay where they are when its triangles are merged: Decimate knows of none of them."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import ShortIndexArray
from .attributes import MARKS
from .blender_arrays import TYPES, read_built_in, read_values

# Values on both sides of an edge that differ by more than this part of all there are make a line.
SAME = 1e-5

# Marks of edges that make lines.
EDGE_MARKS = ("use_seam", "use_edge_sharp", MARKS)

# Attributes of corners that change along lines.
CORNER_TYPES = {"FLOAT2", "FLOAT_COLOR", "BYTE_COLOR"}


def changes_along_lines(attribute: bpy.types.Attribute) -> bool:
    """Whether an attribute is a UV map or colours of corners."""
    return attribute.domain == "CORNER" and attribute.data_type in CORNER_TYPES


def border_edges(mesh: bpy.types.Mesh) -> ShortIndexArray:
    """(B, 2) int32, the vertices of edges with one face."""
    edges = read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2)
    corner_edges = read_built_in(mesh.attributes, ".corner_edge", "value", np.int32)
    return edges[np.bincount(corner_edges, minlength=len(edges)) == 1]


def line_edges(mesh: bpy.types.Mesh) -> ShortIndexArray:
    """(L, 2) int32, the vertices of edges that are seams, sharp or marked, or at the border of a material, of smooth
    shading, of a UV island or of colours. mesh: in Object Mode."""
    edges = read_built_in(mesh.attributes, ".edge_verts", "value", np.int32, 2)
    corner_edges = read_built_in(mesh.attributes, ".corner_edge", "value", np.int32)
    starts = read_values(mesh.polygons, "loop_start", np.int32)
    sizes = np.diff(starts, append=len(corner_edges))
    is_line = np.zeros(len(edges), dtype=bool)
    for mark in EDGE_MARKS:
        if len(edges) and hasattr(mesh.edges[0], mark):
            is_line |= read_values(mesh.edges, mark, np.bool_)
    for name, dtype in (("material_index", np.int32), ("use_smooth", np.bool_)):
        values = np.repeat(read_values(mesh.polygons, name, dtype), sizes).astype(np.float64)
        is_line |= _spread(values[:, None], corner_edges, len(edges)) > 0
    corner_vertices = read_built_in(mesh.attributes, ".corner_vert", "value", np.int32)
    following = np.arange(len(corner_edges)) + 1
    following[starts + sizes - 1] = starts
    forwards = corner_vertices < corner_vertices[following]
    for attribute in mesh.attributes:
        if not changes_along_lines(attribute):
            continue
        kind = TYPES[attribute.data_type]
        values = read_values(attribute.data, kind.value, kind.dtype, kind.width).astype(np.float64)
        largest = float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        ends = np.concatenate(
            [
                np.where(forwards[:, None], values, values[following]),
                np.where(forwards[:, None], values[following], values),
            ],
            axis=1,
        )
        is_line |= _spread(ends, corner_edges, len(edges)) > max(SAME * largest, kind.step)
    return edges[is_line]


def _spread(values: NDArray[Any], corner_edges: NDArray[np.int32], edge_count: int) -> NDArray[np.float64]:
    """(E,): how far values (C, D) at the corners before edges are apart at each edge, in the column where most."""
    low, high = np.full((edge_count, values.shape[1]), np.inf), np.full((edge_count, values.shape[1]), -np.inf)
    np.minimum.at(low, corner_edges, values)
    np.maximum.at(high, corner_edges, values)
    has_faces = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    spread = np.zeros(edge_count)
    spread[has_faces] = (high[has_faces] - low[has_faces]).max(axis=1)
    return spread
