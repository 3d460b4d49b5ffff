# SPDX-License-Identifier: GPL-3.0-or-later
"""The trees over the faces of a control mesh: rectangles of parameters, and their connections.

The roots are control faces. A quad is split into two halves, along its parameter u or v, or into four quarters; any
other face into one quad for each corner. Every node has one slot for each corner; the slot also stands for the side
from there to the next corner. Splitting a node splits sides of it; edges form trees of their own, shared by all nodes
along them, so the sides of a leaf alone tell whether the leaves across are split, on a boundary, on a crease where
three faces meet, or inside. A chain from slot to slot connects all slots along an edge, so that a split finds the
leaves it concerns.

The slots of a half are at the same corners as those of its parent. The quarter at slot s has slots at the vertex of s,
the middle of side s, the centre, and the middle of the side before, in this order: that of ``catmull_clark.subdivide``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.column import Column
from ..arrays.ranges import any_of_ranges, ranges
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.squares import SQUARE
from ..surface.surface_points import SurfacePoints
from .templates import INWARDS, QUAD_POINTS

NONE = -1

# A point of a node: the place of a corner, and whether the middle of the side from there is meant.
Point = tuple[int, bool]

# The ways to split nodes: into halves one after the other along u or along v, or into quarters.
ALONG_U, ALONG_V, QUARTERS = 0, 1, 2

# The halves of a quad along u, and along v: (2, 2, 4), their vertices among ``QUAD_POINTS``; and their sides among the
# quad's sides, the halves of these at their starts, the halves at their ends, and the new edge.
HALF_POINTS = np.array([[[0, 4, 6, 3], [4, 1, 2, 6]], [[0, 1, 5, 7], [7, 5, 2, 3]]])
START, END, INNER = 4, 8, 12
HALF_SIDES = np.array(
    [
        [[START + 0, INNER, END + 2, 3], [END + 0, 1, START + 2, INNER]],
        [[0, START + 1, INNER, END + 3], [INNER, END + 1, 2, START + 3]],
    ]
)

# The corners of a quad, the middles of its sides, and its sides from corner to corner, as complex numbers:
# multiplication turns and scales parameters.
COMPLEX_POINTS = QUAD_POINTS @ np.array([1, 1j])
COMPLEX_SIDES = np.array([1, 1j, -1, -1j])

# The most numerous items are slots.
MOST_SLOTS = np.iinfo(np.int32).max

# The state of an edge.
SPLIT, SPLIT_TWICE = np.uint8(1), np.uint8(2)


class RectangleTree:
    """N nodes, S slots, E edges and V vertices; the first of each are the mesh's faces, corners, edges and vertices.

    nodes: (N,) first_child (node, or NONE for a leaf), base_faces; levels (N, 2) int8, how often a node has been halved
    along its u and v.
    slots: (S,) slot_vertices, slot_edges.
    edges: (E, 2) edge_vertices; (E,) edge_children (the half at the first vertex, the other is the next; NONE while
    whole), midpoints (vertex, or NONE), base_edges (NONE inside a face).
    vertices: (V,) vertex_edges, the edge of the mesh that a vertex made by splitting lies on, or NONE.

    All arrays are int32: a mesh in Blender has no more corners than int32 can count.

    The parameters of a quad and its descendants are those of the whole quad, from its first corner; other faces have no
    parameters of their own, and their descendants have those of the quarter at a corner.
    """

    def __init__(self, mesh: PolygonMesh) -> None:
        self.mesh = mesh
        faces, corners, edges = mesh.face_count, mesh.corner_count, mesh.edge_count
        self._first_child = Column(_numbers(NONE, faces))
        self._child_counts = Column(_numbers(0, faces))
        self._levels = Column(np.zeros((faces, 2), dtype=np.int8))
        self._base_faces = Column(_numbers(np.arange(faces), faces))
        # A frame: the quad or quarter of the parameters, the place of a node's first slot there, and the turn of its
        # side.
        self._frame_corners = Column(_numbers(mesh.face_starts[:-1], faces))
        self._frame_origins = Column(np.zeros(faces, dtype=np.complex128))
        self._frame_turns = Column(np.zeros(faces, dtype=np.int8))
        self._slot_vertices = Column(_numbers(NONE, 0))
        self._slot_edges = Column(_numbers(NONE, 0))
        # The last slot made along an edge, and the slot made before a slot along the same edge; or NONE.
        self._last_slots = Column(_numbers(NONE, edges))
        self._slots_before = Column(_numbers(NONE, 0))
        self._edge_vertices = Column(_numbers(mesh.edge_vertices, (edges, 2)))
        self._edge_children = Column(_numbers(NONE, edges))
        self._edge_parents = Column(_numbers(NONE, edges))
        self._edge_states = Column(np.zeros(edges, dtype=np.uint8))
        self._midpoints = Column(_numbers(NONE, edges))
        self._base_edges = Column(_numbers(np.arange(edges), edges))
        at_corner = _numbers(NONE, mesh.vertex_count)
        at_corner[mesh.corner_vertices] = np.arange(corners)
        self._vertex_corners = Column(at_corner)
        self._vertex_parameters = Column(np.zeros(mesh.vertex_count, dtype=np.complex128))
        self._vertex_edges = Column(_numbers(NONE, mesh.vertex_count))
        self._append_slots(mesh.corner_vertices, mesh.corner_edges)
        self._node_columns: list[tuple[Column, Any]] = []
        self._vertex_columns: list[tuple[Column, Any]] = []
        self.leaf_count = faces

    first_child = property(lambda self: self._first_child.values)
    levels = property(lambda self: self._levels.values)
    base_faces = property(lambda self: self._base_faces.values)
    slot_vertices = property(lambda self: self._slot_vertices.values)
    slot_edges = property(lambda self: self._slot_edges.values)
    edge_vertices = property(lambda self: self._edge_vertices.values)
    edge_children = property(lambda self: self._edge_children.values)
    midpoints = property(lambda self: self._midpoints.values)
    base_edges = property(lambda self: self._base_edges.values)
    vertex_edges = property(lambda self: self._vertex_edges.values)

    def add_column(self, default: np.generic) -> Column:
        """A column of nodes (N,) with the default's dtype. The column grows with the tree; new nodes have the
        default."""
        self._node_columns.append((Column(np.full(len(self.first_child), default)), default))
        return self._node_columns[-1][0]

    def add_vertex_column(self, default: np.generic) -> Column:
        """A column of vertices, (V,)."""
        self._vertex_columns.append((Column(np.full(len(self.vertex_edges), default)), default))
        return self._vertex_columns[-1][0]

    def leaves(self) -> IndexArray:
        """The leaves, in ascending order."""
        return np.flatnonzero(self.first_child == NONE)

    def face_levels(self) -> NDArray[np.int8]:
        """(control faces,): the level of the deepest node on each face, in either direction."""
        deepest = np.zeros(self.mesh.face_count, dtype=np.int8)
        np.maximum.at(deepest, self.base_faces, self.levels.max(axis=1))
        return deepest

    def slot_counts(self, nodes: IndexArray) -> IndexArray:
        """(nodes,) the number of corners of each."""
        counts = np.full(len(nodes), 4, dtype=np.intp)
        faces = np.flatnonzero(nodes < self.mesh.face_count)
        counts[faces] = self.mesh.face_sizes[nodes[faces]]
        return counts

    def first_slots(self, nodes: IndexArray) -> IndexArray:
        """(nodes,) the first slot of each."""
        first = self.mesh.corner_count + 4 * (nodes - self.mesh.face_count)
        faces = np.flatnonzero(nodes < self.mesh.face_count)
        first[faces] = self.mesh.face_starts[nodes[faces]]
        return first

    def slots(self, nodes: IndexArray) -> IndexArray:
        """(slots of the nodes,) node by node."""
        return ranges(self.first_slots(nodes), self.slot_counts(nodes))

    def quad_slots(self, quads: IndexArray) -> IndexArray:
        """(P, 4): the slots of quads (P,)."""
        return self.first_slots(quads)[:, None] + np.arange(4)

    def is_quad(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) bool: whether nodes are quads, as all are but control faces of other sizes."""
        return self.slot_counts(nodes) == 4

    def vertex_points(self, vertices: IndexArray) -> SurfacePoints:
        """The points of vertices on the surface; corner NONE for vertices without faces."""
        return self._surface_points(self._vertex_corners.values[vertices], self._vertex_parameters.values[vertices])

    def points_at(self, nodes: IndexArray, points: Sequence[Point]) -> Iterator[SurfacePoints]:
        """The place of each point on the surface, in each node's own face: (nodes,)."""
        corners, origins = self._frame_corners.values[nodes], self._frame_origins.values[nodes]
        along, across = self._frame_axes(nodes)
        without = np.flatnonzero(~self.is_quad(nodes))
        for place, middle in points:
            u, v = QUAD_POINTS[place % 4 + 4 * middle]
            own, parameters = corners.copy(), origins + u * along + v * across
            own[without] += place
            parameters[without] = float(middle)
            yield self._surface_points(own, parameters)

    def slot_points(self, nodes: IndexArray, steps: FloatArray) -> Iterator[SurfacePoints]:
        """The places on the surface near the slots' vertices, and near the middles of their sides: (slots of the
        nodes,) each. steps: (slots of the nodes,), the way inwards from there, in parts of a node's sides."""
        counts = self.slot_counts(nodes)
        owners, numbers = np.repeat(nodes, counts), np.arange(counts.sum())
        numbers -= np.repeat(np.cumsum(counts) - counts, counts)
        corners, origins = self._frame_corners.values[owners], self._frame_origins.values[owners]
        along, across = self._frame_axes(owners)
        without = np.flatnonzero(~self.is_quad(owners))
        for first, starts in ((0, 0.0), (4, 1.0)):
            points = QUAD_POINTS[first + numbers % 4] + INWARDS[first + numbers % 4] * steps[:, None]
            own, parameters = corners.astype(np.intp), origins + points[:, 0] * along + points[:, 1] * across
            own[without] += numbers[without]
            inwards = (1j if first else 1 + 1j) * 2 * steps[without]
            parameters[without] = starts + inwards
            yield self._surface_points(own, parameters)

    def rectangles(self, nodes: IndexArray, roots: IndexArray) -> tuple[FloatArray, FloatArray]:
        """(2, n) twice: the lower corners and the sides of nodes (n,), in the parameters of their ancestors, the roots
        (n,), which are split by halving alone."""
        origins = self._frame_origins.values
        axes = np.stack(self._frame_axes(roots))
        way = origins[nodes] - origins[roots]
        # The axes are a quarter turn apart, and all numbers powers of two: nothing is rounded.
        lower = (way * axes.conj()).real / (axes * axes.conj()).real
        return lower, np.ldexp(1.0, (self.levels[roots].T - self.levels[nodes].T).astype(np.int32))

    def _frame_axes(self, nodes: IndexArray) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """The sides of nodes along u and v from their first slots."""
        turns, levels = self._frame_turns.values[nodes], self.levels[nodes].T.astype(np.int32)
        # A quarter of another face is on level 1.
        units = np.where(self.mesh.face_sizes[self.base_faces[nodes]] == 4, 0, 1)
        along, across = np.ldexp(1.0, units - levels)
        return COMPLEX_SIDES[turns] * along, COMPLEX_SIDES[(turns + 1) % 4] * across

    def _surface_points(self, corners: IndexArray, parameters: NDArray[np.complex128]) -> SurfacePoints:
        """The parameters in quarters, from parameters in frames."""
        corners, parameters = corners.astype(np.intp), parameters.copy()
        faces = self.mesh.corner_faces[corners]
        of_quads = np.flatnonzero((corners != NONE) & (self.mesh.face_sizes[faces] == 4))
        # Vertices of the mesh may be at any corner; only frames count corners from the first.
        own = of_quads[corners[of_quads] == self.mesh.face_starts[faces[of_quads]]]
        upper, right = parameters[own].imag >= 0.5, parameters[own].real >= 0.5
        quarters = np.where(upper, np.where(right, 2, 3), np.where(right, 1, 0))
        corners[own] += quarters
        parameters[own] = 2 * (parameters[own] - COMPLEX_POINTS[quarters]) * COMPLEX_SIDES[quarters].conj()
        return SurfacePoints(corners, parameters.view(np.float64).reshape(-1, 2))

    def hanging(self, slots: IndexArray) -> BoolArray:
        """Whether the sides at slots are split; arrays of any shape."""
        return self.edge_children.take(self.slot_edges.take(slots)) != NONE

    def hanging_twice(self, slots: IndexArray) -> BoolArray:
        """Whether half of the sides at slots is split again."""
        return self._edge_states.values.take(self.slot_edges.take(slots)) >= SPLIT_TWICE

    def share_a_vertex(self, leaves: IndexArray, others: IndexArray) -> BoolArray:
        """(leaves,) bool: whether leaves share a vertex with any of the others, middles of split sides included."""
        marked = np.zeros(len(self.vertex_edges), dtype=bool)
        for part in chunks(len(others), AT_ONCE):
            slots = self.slots(others[part])
            middles = self.midpoints.take(self.slot_edges.take(slots))
            marked[self.slot_vertices.take(slots)] = True
            marked[middles[middles != NONE]] = True
        found = np.zeros(len(leaves), dtype=bool)
        for part in chunks(len(leaves), AT_ONCE):
            slots, counts = self.slots(leaves[part]), self.slot_counts(leaves[part])
            middles = self.midpoints.take(self.slot_edges.take(slots))
            touched = marked.take(self.slot_vertices.take(slots)) | (marked.take(middles) & (middles != NONE))
            found[part] = any_of_ranges(touched, counts)
        return found

    def leaves_beside(self, nodes: IndexArray) -> IndexArray:
        """The leaves with split sides that a split of given nodes may have changed, each once, in ascending order.

        Splitting a node splits only its sides. So the split sides of a leaf change only if a side of the leaf, or half
        of such a side, is a side of a node; or if the leaf is new.
        """
        beside = np.zeros(len(self.first_child), dtype=bool)
        for part in chunks(len(nodes), AT_ONCE):
            edges = self.slot_edges[self.slots(nodes[part])]
            parents = self._edge_parents.values[edges]
            beside[self._nodes_along(edges)] = True
            beside[self._nodes_along(parents[parents != NONE])] = True
            beside[self.children(nodes[part])] = True
        return np.flatnonzero(beside & (self.first_child == NONE))

    def _nodes_along(self, edges: IndexArray) -> IndexArray:
        """The nodes with given edges as sides, possibly with repetitions."""
        found = [np.zeros(0, dtype=np.int32)]
        slots = self._last_slots.values[edges]
        while len(slots := slots[slots != NONE]):
            found.append(slots)
            slots = self._slots_before.values[slots]
        return self._owners(np.concatenate(found))

    def _owners(self, slots: IndexArray) -> IndexArray:
        """The nodes of slots."""
        nodes = (slots - self.mesh.corner_count) // 4 + self.mesh.face_count
        corners = np.flatnonzero(slots < self.mesh.corner_count)
        nodes[corners] = self.mesh.corner_faces[slots[corners]]
        return nodes

    def children(self, nodes: IndexArray) -> IndexArray:
        """The children of nodes that have been split, node by node."""
        return ranges(self.first_child[nodes].astype(np.intp), self._child_counts.values[nodes].astype(np.intp))

    def split(self, nodes: IndexArray, way: int) -> None:
        """Split leaves, each once, all in the same way: into quarters (``QUARTERS``), or quads into halves."""
        for part in chunks(len(nodes), AT_ONCE):
            if way == QUARTERS:
                self._quarter(nodes[part])
            else:
                self._halve(nodes[part], way)

    def _halve(self, nodes: IndexArray, way: int) -> None:
        slots = self.quad_slots(nodes)
        edges, vertices = self.slot_edges[slots], self.slot_vertices[slots]
        corners, origins = self._frame_corners.values[nodes], self._frame_origins.values[nodes]
        axes, split = self._frame_axes(nodes), [way, way + 2]
        places = [origins + u * axes[0] + v * axes[1] for u, v in QUAD_POINTS[4:][split]]
        self._split_edges(edges[:, split].T.ravel(), np.tile(corners, 2), np.concatenate(places))
        points = np.concatenate([vertices, self.midpoints[edges]], axis=1)
        inner = self._append_edges(self.midpoints[edges[:, split]], NONE)
        halves = [self._half_of(edges, ends) for ends in (vertices, np.roll(vertices, -1, axis=1))]
        sides = np.concatenate([edges, *halves, inner[:, None]], axis=1)
        levels = np.repeat(self.levels[nodes], 2, axis=0)
        levels[:, way] += 1
        self._append_children(
            nodes,
            np.full(len(nodes), 2),
            levels,
            np.repeat(corners, 2),
            np.stack([origins, origins + axes[way] / 2], axis=1).ravel(),
            np.repeat(self._frame_turns.values[nodes], 2),
            points[:, HALF_POINTS[way]].reshape(-1, 4),
            sides[:, HALF_SIDES[way]].reshape(-1, 4),
        )

    def _quarter(self, nodes: IndexArray) -> None:
        counts = self.slot_counts(nodes)
        starts = np.cumsum(counts) - counts
        places = np.arange(counts.sum()) - np.repeat(starts, counts)
        slots, owners = self.slots(nodes), np.repeat(nodes, counts)
        last = np.repeat(starts + counts - 1, counts)
        before = np.where(places == 0, last, np.arange(len(slots)) - 1)
        edges, vertices = self.slot_edges[slots], self.slot_vertices[slots]

        corners, origins, steps, turns = self._quarter_frames(owners, slots, places)
        self._split_edges(edges, corners, origins + steps)
        centres = len(self._vertex_corners.values) + np.repeat(np.arange(len(nodes)), counts)
        self._append_vertices(corners[starts], (origins + (1 + 1j) * steps)[starts], NONE)
        middles = self.midpoints[edges]
        inner = self._append_edges(np.stack([middles, centres], axis=1), NONE)
        outgoing, incoming = self._half_of(edges, vertices), self._half_of(edges[before], vertices)
        self._append_children(
            nodes,
            counts,
            # Quarters are made of squares alone.
            self.levels[owners] + np.int8(1),
            corners,
            origins,
            turns,
            np.stack([vertices, middles, centres, middles[before]], axis=1),
            np.stack([outgoing, inner, inner[before], incoming], axis=1),
        )

    def _quarter_frames(
        self, owners: IndexArray, slots: IndexArray, places: IndexArray
    ) -> tuple[IndexArray, NDArray[np.complex128], NDArray[np.complex128], NDArray[np.int8]]:
        """The frames of quarters at slots, their sides along u, and the turns of these sides."""
        along, across = self._frame_axes(owners)
        origins = self._frame_origins.values[owners]
        u, v = SQUARE[places % 4].T
        corners, origins = self._frame_corners.values[owners].astype(np.intp), origins + u * along + v * across
        turns = (self._frame_turns.values[owners] + places % 4) % 4
        steps = COMPLEX_SIDES[turns] * np.abs(along) / 2
        without = np.flatnonzero(~self.is_quad(owners))
        corners[without], origins[without], steps[without], turns[without] = slots[without], 0.0, 1.0, 0
        return corners, origins, steps, turns.astype(np.int8)

    def _append_children(
        self,
        parents: IndexArray,
        counts: IndexArray,
        levels: NDArray[np.int8],
        corners: IndexArray,
        origins: NDArray[np.complex128],
        turns: NDArray[np.int8],
        vertices: IndexArray,
        edges: IndexArray,
    ) -> None:
        """Append the children of nodes, with their levels, frames, vertices and edges. counts: the children of each
        node."""
        count = len(levels)
        self.first_child[parents] = len(self.first_child) + np.cumsum(counts) - counts
        self._child_counts.values[parents] = counts
        self._base_faces.append(np.repeat(self.base_faces[parents], counts))
        self._first_child.extend(count, NONE)
        self._child_counts.extend(count, 0)
        self._levels.append(levels)
        self._frame_corners.append(corners)
        self._frame_origins.append(origins)
        self._frame_turns.append(turns)
        for column, default in self._node_columns:
            column.extend(count, default)
        self._append_slots(vertices.ravel(), edges.ravel())
        self.leaf_count += count - len(parents)

    def _split_edges(self, sides: IndexArray, corners: IndexArray, middles: NDArray[np.complex128]) -> None:
        """Split the whole edges among sides. corners, middles: the places of the midpoints."""
        whole = np.flatnonzero(self.edge_children[sides] == NONE)
        # The last side written along an edge remains.
        self.edge_children[sides[whole]] = whole
        chosen = whole[self.edge_children[sides[whole]] == whole]
        edges = sides[chosen]
        base_edges = self.base_edges[edges]
        midpoints = self._append_vertices(corners[chosen], middles[chosen], base_edges)
        ends = self.edge_vertices.take(edges, axis=0)
        halves = np.stack([ends[:, 0], midpoints, midpoints, ends[:, 1]], axis=1).reshape(-1, 2)
        children = self._append_edges(halves, np.repeat(base_edges, 2), np.repeat(edges, 2))
        self.edge_children[edges] = children[::2]
        self.midpoints[edges] = midpoints
        self._edge_states.values[edges] |= SPLIT
        parents = self._edge_parents.values[edges]
        self._edge_states.values[parents[parents != NONE]] |= SPLIT_TWICE

    def half_at(self, sides: IndexArray, slots: IndexArray) -> IndexArray:
        """For each of the slots ``sides``, the half of the split side that ends at the vertex of the matching one of
        ``slots``."""
        return self._half_of(self.slot_edges[sides], self.slot_vertices[slots])

    def _half_of(self, edges: IndexArray, vertices: IndexArray) -> IndexArray:
        """The half of each split edge that ends at a vertex."""
        return self.edge_children[edges] + (self.edge_vertices[:, 1].take(edges) == vertices)

    def _append_slots(self, vertices: IndexArray, edges: IndexArray) -> None:
        waiting = np.arange(len(edges)) + len(self.slot_edges)
        if len(self.slot_edges) + len(edges) > MOST_SLOTS:
            raise MemoryError("the tree of rectangles is too large")
        self._slot_vertices.append(vertices)
        self._slot_edges.append(edges)
        self._slots_before.extend(len(edges), NONE)
        # The last slot written along an edge remains; the next rounds chain the others before it.
        while len(waiting):
            edges = self.slot_edges[waiting]
            before = self._last_slots.values[edges]
            self._last_slots.values[edges] = waiting
            written = self._last_slots.values[edges] == waiting
            self._slots_before.values[waiting[written]] = before[written]
            waiting = waiting[~written]

    def _append_vertices(
        self, corners: IndexArray, parameters: NDArray[np.complex128], edges: IndexArray | int
    ) -> IndexArray:
        first = len(self._vertex_corners.values)
        self._vertex_corners.append(corners)
        self._vertex_parameters.append(parameters)
        self._vertex_edges.extend(len(corners), edges)
        for column, default in self._vertex_columns:
            column.extend(len(corners), default)
        return np.arange(first, first + len(corners))

    def _append_edges(
        self, ends: IndexArray, base_edges: IndexArray | int, parents: IndexArray | int = NONE
    ) -> IndexArray:
        first = len(self.edge_vertices)
        self._edge_parents.extend(len(ends), parents)
        self._edge_states.extend(len(ends), 0)
        self._last_slots.extend(len(ends), NONE)
        self._edge_vertices.append(ends)
        self._edge_children.extend(len(ends), NONE)
        self._midpoints.extend(len(ends), NONE)
        self._base_edges.extend(len(ends), base_edges)
        return np.arange(first, first + len(ends))


def _numbers(values: IndexArray | int, shape: int | tuple[int, int]) -> NDArray[np.int32]:
    """Numbers in the tree's dtype."""
    return np.full(shape, values, dtype=np.int32)
