# SPDX-License-Identifier: GPL-3.0-or-later
"""The tessellation of a tree's leaves: templates for leaves with split sides, whole faces elsewhere."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import AT_ONCE, chunks, index_chunks
from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray, ShortIndexArray
from ..mesh.submesh import compact, renumber
from ..surface.surface_points import SurfacePoints
from .leaf_approximation import LeafApproximation
from .rectangle_tree import NONE, Point, RectangleTree
from .subdivided_mesh import SubdividedMesh
from .templates import (
    WHOLE,
    Template,
    template_groups,
    template_numbers,
    templates,
    triangle_template,
)


@dataclass(frozen=True)
class Polygons:
    """P polygons over the same points of their leaves, each leaf with ``size`` corners. leaves: (P,) the leaf of each
    polygon, as an index into the leaves."""

    leaves: IndexArray
    points: list[Point]
    size: int

    def slots(self, tree: RectangleTree, leaves: IndexArray) -> list[IndexArray]:
        """(P,) for each point: the slots of the corners."""
        first = tree.first_slots(leaves[self.leaves])
        return [first + place for place, _ in self.points]

    def vertices(self, tree: RectangleTree, leaves: IndexArray) -> Iterator[ShortIndexArray]:
        """(P,) for each point: the vertices."""
        for slots, (_, middle) in zip(self.slots(tree, leaves), self.points, strict=True):
            yield tree.midpoints[tree.slot_edges[slots]] if middle else tree.slot_vertices[slots]

    def sides(self, tree: RectangleTree, leaves: IndexArray) -> Iterator[ShortIndexArray | int]:
        """(P,) for each point: the tree's edge from the point to the next, or NONE inside the leaf."""
        slots = self.slots(tree, leaves)
        for number, (place, middle) in enumerate(self.points):
            following = (number + 1) % len(self.points)
            next_place, next_middle = self.points[following]
            goes_on = next_place == (place + 1) % self.size
            if not middle and not next_middle and goes_on:
                yield tree.slot_edges[slots[number]]
            elif not middle and next_middle and next_place == place:
                yield tree.half_at(slots[number], slots[number])
            elif middle and not next_middle and goes_on:
                yield tree.half_at(slots[number], slots[following])
            else:
                yield NONE


@dataclass(frozen=True)
class Edges:
    """E edges between C corners. of_corners: (C,) the edge from each corner to the next; vertices: (E, 2); base_edges:
    (E,) the control edge of each edge, or NONE. clashing: (E,) bool, edges inside a leaf without two faces, and edges
    with the same vertices as another edge, such as the diagonals of two quads over the same two opposite corners.
    """

    of_corners: ShortIndexArray
    vertices: ShortIndexArray
    base_edges: ShortIndexArray
    clashing: BoolArray


@dataclass(frozen=True)
class TessellationPlan:
    """The polygons that tessellate leaves (L,) of a tree, in the order of the leaves, and their connectivity.

    blocks: the polygons, by template; firsts: (P,) for each block, the first corners of its polygons. starts: (F + 1,)
    first corners; drawn: (F,) the leaf of each face, as an index into the leaves; used: (V,) vertices of the tree;
    corner_vertices: (C,) indices into ``used``.
    """

    tree: RectangleTree
    leaves: IndexArray
    blocks: list[Polygons]
    firsts: list[IndexArray]
    starts: IndexArray
    drawn: IndexArray
    used: IndexArray
    corner_vertices: ShortIndexArray
    edges: Edges

    @property
    def clashes(self) -> IndexArray:
        """The nodes to split because of clashing edges."""
        return self.at_edges(self.edges.clashing)

    def at_edges(self, chosen: BoolArray) -> IndexArray:
        """The nodes with chosen edges (E,)."""
        if not np.any(chosen):
            return np.zeros(0, dtype=np.intp)
        faces = np.logical_or.reduceat(chosen[self.edges.of_corners], self.starts[:-1])
        return self.leaves[np.unique(self.drawn[faces])]


def plan_tessellation(tree: RectangleTree, leaves: IndexArray, approximation: LeafApproximation) -> TessellationPlan:
    """The tessellation of leaves (L,) of a tree, by their approximation. Loose control vertices and edges are kept."""
    polygons = [*_polygons_of_quads(tree, leaves, approximation), *_polygons_of_faces(tree, leaves)]
    starts, drawn, firsts = _order(polygons, len(leaves))
    corner_vertices = _at_corners(starts[-1], firsts, (block.vertices(tree, leaves) for block in polygons))
    loose = np.flatnonzero(tree.mesh.vertex_face_counts == 0)
    used = compact(corner_vertices, len(tree.vertex_edges), loose)
    sides = _at_corners(starts[-1], firsts, (block.sides(tree, leaves) for block in polygons))
    edges = _edges(tree, sides, used, starts, corner_vertices)
    return TessellationPlan(tree, leaves, polygons, firsts, starts, drawn, used, corner_vertices, edges)


def tessellate(plan: TessellationPlan, positions: FloatArray) -> SubdividedMesh:
    """The mesh of a plan, with vertices at positions (V, 3) float64."""
    tree, used, edges = plan.tree, plan.used, plan.edges
    return SubdividedMesh(
        find_vertex_points=partial(tree.vertex_points, used),
        positions=positions,
        face_starts=plan.starts,
        corner_vertices=plan.corner_vertices,
        corner_edges=edges.of_corners,
        edge_vertices=edges.vertices,
        find_corner_points=partial(_corner_points, plan),
        base_faces=tree.base_faces[plan.leaves[plan.drawn]],
        base_edges=edges.base_edges,
        base_vertices=_base_vertices(tree, used),
        vertex_edges=tree.vertex_edges[used],
    )


def at_corners(plan: TessellationPlan, values: FloatArray) -> FloatArray:
    """(C, D): values (2, S, D) at the slots of the plan's leaves, at their vertices and at the middles of their sides,
    at the corners of the faces."""
    found = np.empty((plan.starts[-1], values.shape[2]))
    counts = plan.tree.slot_counts(plan.leaves)
    starts = np.cumsum(counts) - counts
    for block, first in zip(plan.blocks, plan.firsts, strict=True):
        for number, (place, middle) in enumerate(block.points):
            found[first + number] = values[int(middle), starts[block.leaves] + place]
    return found


def _base_vertices(tree: RectangleTree, used: IndexArray) -> ShortIndexArray:
    """(V,): the control vertex at each vertex of the tree, or NONE, for vertices in ascending order."""
    found = np.full(len(used), NONE, dtype=np.int32)
    count = np.searchsorted(used, tree.mesh.vertex_count)
    found[:count] = used[:count]
    return found


def _polygons_of_quads(tree: RectangleTree, leaves: IndexArray, approximation: LeafApproximation) -> Iterator[Polygons]:
    quads = np.flatnonzero(tree.is_quad(leaves))
    for pattern, alternative, alike in template_groups(
        template_numbers(approximation.patterns[quads], approximation.alternatives[quads])
    ):
        template = templates(pattern)[alternative]
        for chosen in index_chunks(quads[alike], AT_ONCE):
            yield from _polygons_of_template(chosen, template, pattern, approximation.folded[chosen])


def _polygons_of_template(
    leaves: IndexArray, template: Template, pattern: int, folded: BoolArray
) -> Iterator[Polygons]:
    if pattern == WHOLE:
        # Blender triangulates a quad along its first diagonal.
        yield _polygons(leaves[~folded], [*template[0], template[1][2]])
        leaves = leaves[folded]
    for triangle in template:
        yield _polygons(leaves, triangle)


def _polygons(leaves: IndexArray, points: Sequence[int], size: int = 4) -> Polygons:
    """The polygons over points of leaves: corners 0 to size - 1, then the middles of the sides."""
    return Polygons(leaves, [(point % size, point >= size) for point in points], size)


def _polygons_of_faces(tree: RectangleTree, leaves: IndexArray) -> Iterator[Polygons]:
    """The polygons of control faces other than quads, with a vertex at the middle of every split side."""
    others = np.flatnonzero(~tree.is_quad(leaves))
    sizes = tree.slot_counts(leaves[others])
    for size in np.unique(sizes).tolist():
        of_size = others[sizes == size]
        found, group = np.unique(
            tree.hanging(tree.slots(leaves[of_size])).reshape(-1, size), axis=0, return_inverse=True
        )
        for number, sides in enumerate(found.tolist()):
            chosen = of_size[group.reshape(-1) == number]
            for points in _points_of_face(sides):
                yield _polygons(chosen, points, size=size)


def _points_of_face(split_sides: list[bool]) -> list[Sequence[int]]:
    """The polygons that tessellate a face, by its split sides: of a triangle the triangles of its template, of any
    other face itself. Corners are 0 to k - 1, the middle of the side after a corner is k + corner."""
    size = len(split_sides)
    if size == 3 and any(split_sides):
        return [*triangle_template(sum(1 << side for side in range(3) if split_sides[side]))]
    return [[point for side in range(size) for point in (side, size + side) if point < size or split_sides[side]]]


def _order(polygons: list[Polygons], count: int) -> tuple[IndexArray, IndexArray, list[IndexArray]]:
    """The polygons ordered by leaf, and within a leaf by block: (F + 1,) first corners, (F,) leaves; and for each block
    (P,) first corners. count: of the leaves."""
    faces, corners = np.zeros((2, count), dtype=np.int32)
    for block in polygons:
        faces[block.leaves] += 1
        corners[block.leaves] += len(block.points)
    next_faces, next_corners = (np.cumsum(counts, dtype=np.int32) - counts for counts in (faces, corners))
    starts, firsts = np.empty(faces.sum() + 1, dtype=np.intp), []
    starts[-1] = corners.sum()
    for block in polygons:
        firsts.append(next_corners[block.leaves])
        starts[next_faces[block.leaves]] = firsts[-1]
        next_faces[block.leaves] += 1
        next_corners[block.leaves] += len(block.points)
    return starts, np.repeat(np.arange(count), faces), firsts


def _at_corners(
    count: int, firsts: list[IndexArray], values: Iterable[Iterable[ShortIndexArray | int]]
) -> ShortIndexArray:
    """(C,): the values of all points of all blocks, in the order of the corners."""
    found = np.empty(count, dtype=np.int32)
    for first, of_block in zip(firsts, values, strict=True):
        for number, of_point in enumerate(of_block):
            found[first + number] = of_point
    return found


def _corner_points(plan: TessellationPlan) -> SurfacePoints:
    """(C,): the points of the corners on the surface."""
    count = plan.starts[-1]
    corners, parameters = np.empty(count, dtype=np.intp), np.empty((count, 2))
    for block, first in zip(plan.blocks, plan.firsts, strict=True):
        nodes = plan.leaves[block.leaves]
        for number, points in enumerate(plan.tree.points_at(nodes, block.points)):
            corners[first + number] = points.corners
            parameters[first + number] = points.parameters
    return SurfacePoints(corners, parameters)


def _edges(
    tree: RectangleTree, sides: ShortIndexArray, used: IndexArray, starts: IndexArray, corner_vertices: ShortIndexArray
) -> Edges:
    """The edges: first edges of the tree, in its order, then edges inside leaves, then loose edges of the mesh. sides:
    (C,) the tree's edge from each corner to the next, or NONE; renumbered in place. Edges of the tree need no check of
    their faces, as the tree is balanced.
    """
    is_used = mask(len(tree.edge_vertices) + 1, sides)
    outer_count = int(np.count_nonzero(is_used[:NONE]))
    inner = np.flatnonzero(sides == NONE)
    inner_vertices, of_inner = _inner_edges(inner, starts, corner_vertices, len(used))
    renumber(sides, is_used)
    sides[inner] = outer_count + of_inner
    loose = np.flatnonzero(tree.mesh.edge_face_counts == 0)
    new = np.full(len(tree.vertex_edges), NONE, dtype=np.int32)
    new[used] = np.arange(len(used), dtype=np.int32)

    insides = slice(outer_count, outer_count + len(inner_vertices))
    vertices = np.empty((insides.stop + len(loose), 2), dtype=np.int32)
    base_edges = np.full(len(vertices), NONE, dtype=np.int32)
    filled = 0
    for block in chunks(len(tree.edge_vertices), AT_ONCE):
        outer = block.start + np.flatnonzero(is_used[:NONE][block])
        own = slice(filled, filled := filled + len(outer))
        vertices[own] = new.take(tree.edge_vertices.take(outer, axis=0))
        base_edges[own] = tree.base_edges[outer]
    vertices[insides] = inner_vertices
    vertices[insides.stop :] = new[tree.edge_vertices[loose]]
    base_edges[insides.stop :] = loose
    clashing = _doubled(tree, used, vertices) & (base_edges == NONE)
    clashing[insides] |= np.bincount(of_inner, minlength=len(inner_vertices)) != 2
    return Edges(sides, vertices, base_edges, clashing)


def _inner_edges(
    corners: IndexArray, starts: IndexArray, corner_vertices: ShortIndexArray, count: int
) -> tuple[IndexArray, IndexArray]:
    """(I, 2): the edges from corners to the next corners in their faces, each pair of vertices once; and (corners,):
    the edge of each corner. count: of the vertices."""
    faces = np.searchsorted(starts, corners, side="right") - 1
    following = np.where(corners + 1 == starts[faces + 1], starts[faces], corners + 1)
    ends = np.stack([corner_vertices[corners], corner_vertices[following]])
    keys, of_corners = np.unique(_keys(ends, count), return_inverse=True)
    return np.stack(np.divmod(keys, count), axis=1), of_corners.reshape(-1)


def _keys(ends: NDArray[Any], count: int) -> IndexArray:
    """(N,): a unique number for each unordered pair of vertices (2, N). count: of the vertices."""
    return np.minimum(*ends).astype(np.intp) * count + np.maximum(*ends)


def _doubled(tree: RectangleTree, used: IndexArray, vertices: ShortIndexArray) -> BoolArray:
    """(E,) bool: whether an edge (E, 2) between used vertices has the same ends as another. Both then lie on borders of
    control faces, as edges within one face differ."""
    on_border = (used < tree.mesh.vertex_count) | (tree.vertex_edges[used] != NONE)
    possible = np.flatnonzero(on_border[vertices[:, 0]] & on_border[vertices[:, 1]])
    _, pair, pairs = np.unique(_keys(vertices[possible].T, len(used)), return_inverse=True, return_counts=True)
    doubled = np.zeros(len(vertices), dtype=bool)
    doubled[possible] = pairs[pair.reshape(-1)] > 1
    return doubled
