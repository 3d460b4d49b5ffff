# SPDX-License-Identifier: GPL-3.0-or-later
"""Lines on a mesh that must stay in place when its triangles are merged, and fewer vertices on them.

Decimate knows no lines: it merges their vertices with neighbours. So the vertices of lines are fixed for Decimate, and
superfluous ones have to go before.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import bmesh
import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import BoolArray, FloatArray, ShortIndexArray
from .attributes import MARKS
from .blender_arrays import TYPES, face_sizes, read_built_in, read_values
from .data_blocks import as_bmesh

# Values on both sides of an edge make a line if they differ by more than this part of the range of all values.
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
    sizes = face_sizes(mesh)
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
    """(E,): the largest difference, over columns, between values (C, D) at the corners before each edge."""
    low, high = np.full((edge_count, values.shape[1]), np.inf), np.full((edge_count, values.shape[1]), -np.inf)
    np.minimum.at(low, corner_edges, values)
    np.maximum.at(high, corner_edges, values)
    has_faces = np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1)
    spread = np.zeros(edge_count)
    spread[has_faces] = (high[has_faces] - low[has_faces]).max(axis=1)
    return spread


Chain = list[int]


def thin_lines(mesh: bpy.types.Mesh, edges: ShortIndexArray, may_go: BoolArray, tolerance: float) -> None:
    """Remove vertices from the lines of a mesh of triangles, which stays a mesh of triangles.

    edges: (L, 2), of the lines. may_go: (V,), the vertices that may be removed. tolerance: their largest distance from
    the remaining line.
    """
    positions = read_built_in(mesh.attributes, "position", "vector", np.float32, 3).astype(np.float64)
    chains = chains_of(edges)
    going = [[vertex for vertex in superfluous(positions, chain, tolerance) if may_go[vertex]] for chain in chains]
    with as_bmesh(mesh) as edited:
        edited.verts.ensure_lookup_table()
        vertices = edited.verts
        beside = _beside([[vertices[index] for index in chain] for chain in chains])
        left = [vertices[index] for each in going for index in each]
        while left:
            chosen, left = _apart(left)
            _remove(edited, chosen, beside)


def chains_of(edges: ShortIndexArray) -> list[Chain]:
    """The lines between vertices where lines end or meet; closed lines start and end at one vertex."""
    neighbours: dict[int, list[int]] = {}
    for one, other in edges.tolist():
        neighbours.setdefault(one, []).append(other)
        neighbours.setdefault(other, []).append(one)
    ends = [vertex for vertex, others in neighbours.items() if len(others) != 2]
    chains: list[Chain] = []
    walked: set[tuple[int, int]] = set()
    # After the lines with ends only rings remain.
    for start in [*ends, *neighbours]:
        for following in neighbours[start]:
            if (start, following) not in walked:
                chains.append(_walk(neighbours, start, following, walked))
    return chains


def _walk(neighbours: dict[int, list[int]], start: int, following: int, walked: set[tuple[int, int]]) -> Chain:
    chain = [start, following]
    while chain[-1] != start and len(neighbours[chain[-1]]) == 2:
        one, other = neighbours[chain[-1]]
        chain.append(other if one == chain[-2] else one)
    for one, other in pairwise(chain):
        walked.update(((one, other), (other, one)))
    return chain


def superfluous(positions: FloatArray, chain: Chain, tolerance: float) -> Chain:
    """The superfluous vertices of a line: no farther than the tolerance from the segments between the kept vertices
    (Douglas and Peucker, 1973)."""
    points = positions[chain]
    kept = np.zeros(len(chain), dtype=bool)
    kept[[0, -1]] = True
    parts = [(0, len(chain) - 1)]
    if chain[0] == chain[-1]:
        # A ring is kept a triangle.
        thirds = [len(chain) // 3, 2 * len(chain) // 3]
        kept[thirds] = True
        parts = [(0, thirds[0]), (thirds[0], thirds[1]), (thirds[1], len(chain) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        distances = _to_segment(points[first + 1 : last], points[first], points[last])
        farthest = int(distances.argmax())
        if distances[farthest] > tolerance:
            middle = first + 1 + farthest
            kept[middle] = True
            parts += [(first, middle), (middle, last)]
    return [vertex for vertex, stays in zip(chain, kept.tolist(), strict=True) if not stays]


def _to_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """(P,): the distances of points (P, 3) from a segment."""
    along = end - start
    shares = (points - start) @ along / max(float(along @ along), np.finfo(float).tiny)
    return np.linalg.norm(points - start - np.clip(shares, 0.0, 1.0)[:, None] * along, axis=1)


def _beside(chains: Iterable[list[Any]]) -> dict[Any, list[Any]]:
    """The two vertices beside each inner vertex of the lines."""
    return {
        vertex: [before, after]
        for chain in chains
        for before, vertex, after in zip(chain, chain[1:], chain[2:], strict=False)
    }


def _apart(vertices: list[Any]) -> tuple[list[Any], list[Any]]:
    """A part of the vertices without a common edge between any two, and the others."""
    chosen, others = [], []
    taken: set[Any] = set()
    for vertex in vertices:
        if vertex in taken:
            others.append(vertex)
            continue
        chosen.append(vertex)
        taken.update(edge.other_vert(vertex) for edge in vertex.link_edges)
    return chosen, others


def _remove(edited: Any, vertices: list[Any], beside: dict[Any, list[Any]]) -> None:
    """Remove vertices of lines without a common edge between any two: on either side of the line the triangles around a
    vertex become a polygon, which is cut into triangles anew."""
    removed = [vertex for vertex in vertices if _can_go(vertex, beside[vertex])]
    around = [e for v in removed for e in v.link_edges if e.other_vert(v) not in beside[v]]
    bmesh.ops.dissolve_edges(edited, edges=around, use_verts=False, use_face_split=False)
    touched: set[Any] = set()
    for vertex in removed:
        before, after = beside[vertex]
        touched.update((before, after))
        if not vertex.is_valid or len(vertex.link_edges) != 2:
            touched.add(vertex)
            continue
        for one, other in ((before, after), (after, before)):
            if one in beside:
                beside[one] = [other if each is vertex else each for each in beside[one]]
        bmesh.utils.vert_collapse_edge(vertex, vertex.link_edges[0])
    polygons = {face for vertex in touched if vertex.is_valid for face in vertex.link_faces if len(face.verts) > 3}
    bmesh.ops.triangulate(edited, faces=list(polygons), quad_method="BEAUTY", ngon_method="BEAUTY")


def _can_go(vertex: Any, beside: list[Any]) -> bool:
    """Whether a vertex can be removed: its triangles lie around it, or beside each other at a border along the line;
    and its two neighbours on the line share no edge."""
    if not vertex.is_manifold:
        return False
    if vertex.is_boundary and not all(e.other_vert(vertex) in beside for e in vertex.link_edges if e.is_boundary):
        return False
    return not any(edge.other_vert(beside[0]) is beside[1] for edge in beside[0].link_edges)
