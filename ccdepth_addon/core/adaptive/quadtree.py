# SPDX-License-Identifier: GPL-3.0-or-later
"""The quadtrees over the faces of a control mesh: its subfaces and their connectivity.

Nodes are faces of the control mesh and, four to a split node (or one for each corner of a face that is no quad), the
subfaces below them. Every node has one slot for each of its corners, which is also its side from that corner to the
next. Splitting a node splits its sides; edges form trees of their own, shared by all nodes along them, so the
sides of a leaf alone tell whether the leaves across are split, on a boundary, on a crease where three faces meet, or
inside. A chain from slot to slot connects all slots along an edge, so that a split finds the leaves it concerns.

The child of slot s has slots at the vertex of s, the middle of side s, the centre, and the middle of the side before,
in this order: that of ``catmull_clark.subdivide``.

In the end four leaves of a quad may become two halves of it (``Quadtree.halve``). Their first slots are along one of
the quad's sides, which is their side too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import AT_ONCE, chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.surface_points import SurfacePoints
from .templates import QUAD_POINTS

NONE = -1

# The least factor by which a column grows.
SLACK = 1.5

# A point of a node: the place of a corner, and whether it means the middle of the side from there.
Point = tuple[int, bool]

# Parameters as complex numbers, which turn and scale by multiplication: the points of a quad, and its sides from corner
# to corner.
COMPLEX_POINTS = QUAD_POINTS @ np.array([1, 1j])
COMPLEX_SIDES = np.array([1, 1j, -1, -1j])

# The points of a half (``templates.QUAD_POINTS``): in which of the two children it covers each lies, and which of that
# child's points it is, or 8 for its centre.
POINTS_OF_HALF = ((0, 0), (1, 0), (1, 1), (0, 3), (0, 1), (1, 4), (0, 2), (0, 7))

# There are more slots than nodes, edges or vertices.
MOST_SLOTS = np.iinfo(np.int32).max

# The state of an edge.
SPLIT, SPLIT_TWICE = np.uint8(1), np.uint8(2)


class Column:
    """An array that grows at its end: read and write ``values``, which growth replaces."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._room = values.copy()
        self._count = len(values)

    @property
    def values(self) -> NDArray[Any]:
        return self._room[: self._count]

    def append(self, more: NDArray[Any]) -> None:
        self.extend(len(more), more)

    def extend(self, count: int, more: Any) -> None:
        """Append so many entries: one value for all, or one for each."""
        self.reserve(self._count + count)
        self._room[self._count : self._count + count] = more
        self._count += count

    @property
    def room(self) -> int:
        """How many entries there is memory for."""
        return len(self._room)

    def reserve(self, count: int) -> None:
        """Allocate memory for so many entries in all."""
        if count > self.room:
            grown = np.empty((max(count, int(SLACK * self.room)), *self._room.shape[1:]), self._room.dtype)
            grown[: self._count] = self.values
            self._room = grown


class Quadtree:
    """N nodes, S slots, E edges and V vertices; the first of each are the mesh's faces, corners, edges and vertices.

    nodes: (N,) first_child (node, or NONE for a leaf), parents (node, or NONE for a face), levels (int8), base_faces.
    slots: (S,) slot_vertices, slot_edges.
    edges: (E, 2) edge_vertices; (E,) edge_children (the half at the first vertex, the other is the next; NONE while
    whole), midpoints (vertex, or NONE), base_edges (NONE inside a face).
    vertices: (V,) vertex_edges, the edge of the mesh that a vertex made by splitting lies on, or NONE.

    All of these are int32: a mesh in Blender has no more corners than that can count, and the tree of one would take
    hundreds of gigabytes.
    """

    def __init__(self, mesh: PolygonMesh) -> None:
        self.mesh = mesh
        faces, corners, edges = mesh.face_count, mesh.corner_count, mesh.edge_count
        self._first_child = Column(_numbers(NONE, faces))
        self._parents = Column(_numbers(NONE, faces))
        self._levels = Column(np.zeros(faces, dtype=np.int8))
        self._base_faces = Column(_numbers(np.arange(faces), faces))
        # A frame is the quarter a node lies in, its first slot there, and which of the quarter's sides the side from
        # there is parallel to. A whole face has a frame for each slot.
        self._frame_corners = Column(_numbers(mesh.face_starts[:-1], faces))
        self._frame_origins = Column(np.zeros(faces, dtype=np.complex128))
        self._frame_turns = Column(np.zeros(faces, dtype=np.int8))
        self._slot_vertices = Column(_numbers(NONE, 0))
        self._slot_edges = Column(_numbers(NONE, 0))
        # The last slot made along an edge, and the one made along the same edge before a slot; or NONE.
        self._last_slots = Column(_numbers(NONE, edges))
        self._slots_before = Column(_numbers(NONE, 0))
        self._edge_vertices = Column(_numbers(mesh.edge_vertices, (edges, 2)))
        self._edge_children = Column(_numbers(NONE, edges))
        self._edge_parents = Column(_numbers(NONE, edges))
        self._edge_states = Column(np.zeros(edges, dtype=np.uint8))
        self._midpoints = Column(_numbers(NONE, edges))
        self._base_edges = Column(_numbers(np.arange(edges), edges))
        first_corner = _numbers(NONE, mesh.vertex_count)
        first_corner[mesh.corner_vertices] = np.arange(corners)
        self._vertex_corners = Column(first_corner)
        self._vertex_parameters = Column(np.zeros(mesh.vertex_count, dtype=np.complex128))
        self._vertex_edges = Column(_numbers(NONE, mesh.vertex_count))
        self._append_slots(mesh.corner_vertices, mesh.corner_edges)
        # (halves, 2): the children that each covers. Halves are the last nodes, and edges between them the last edges.
        self.covered = np.zeros((0, 2), dtype=np.int32)
        self._split_before = (_numbers(NONE, 0),) * 3
        self._added_columns: list[tuple[Column, Any]] = []
        self._added_vertex_columns: list[tuple[Column, Any]] = []
        self.leaf_count = faces

    first_child = property(lambda self: self._first_child.values)
    parents = property(lambda self: self._parents.values)
    levels = property(lambda self: self._levels.values)
    base_faces = property(lambda self: self._base_faces.values)
    slot_vertices = property(lambda self: self._slot_vertices.values)
    slot_edges = property(lambda self: self._slot_edges.values)
    edge_vertices = property(lambda self: self._edge_vertices.values)
    edge_children = property(lambda self: self._edge_children.values)
    midpoints = property(lambda self: self._midpoints.values)
    base_edges = property(lambda self: self._base_edges.values)
    vertex_edges = property(lambda self: self._vertex_edges.values)

    @property
    def first_half(self) -> int:
        """The first of the nodes made by ``halve``."""
        return len(self.first_child) - len(self.covered)

    def add_column(self, default: np.generic) -> Column:
        """(N,) of the default's dtype: it grows with the tree, and new nodes have the default."""
        return _added(self._added_columns, default, self._first_child)

    def add_vertex_column(self, default: np.generic) -> Column:
        """The same for vertices, (V,)."""
        return _added(self._added_vertex_columns, default, self._vertex_corners)

    def vertex_points(self, vertices: IndexArray) -> SurfacePoints:
        """The points of vertices on the surface; corner NONE for vertices without faces."""
        corners = self._vertex_corners.values[vertices].astype(np.intp)
        return SurfacePoints(corners, _as_pairs(self._vertex_parameters.values[vertices]))

    def leaves(self) -> IndexArray:
        """The nodes that are not split, in ascending order."""
        return np.flatnonzero(self.first_child == NONE)

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
        counts, first = self.slot_counts(nodes), self.first_slots(nodes)
        if np.all(counts == 4):
            # Four long sums take a tenth of the time of many short ones.
            slots = np.empty((len(nodes), 4), dtype=np.intp)
            for place in range(4):
                np.add(first, place, out=slots[:, place])
            return slots.ravel()
        starts = np.cumsum(counts) - counts
        return np.arange(counts.sum()) + np.repeat(first - starts, counts)

    def points_at(self, nodes: IndexArray, points: Sequence[Point]) -> Iterator[SurfacePoints]:
        """For each point: (nodes,) its place on the surface, in each node's own face."""
        corners = self._frame_corners.values[nodes].astype(np.intp)
        origins, sides = self._frame_origins.values[nodes], self._frame_sides(nodes)
        faces = np.flatnonzero(nodes < self.mesh.face_count)
        halves = np.flatnonzero(nodes >= self.first_half)
        covered = self.covered[nodes[halves] - self.first_half]
        for place, middle in points:
            parameters = origins + COMPLEX_POINTS[place % 4 + 4 * middle] * sides
            # The quarters of a whole face meet in its centre, so its corners and sides are all alike in theirs.
            parameters[faces] = middle
            own = corners.copy()
            own[faces] += place
            if len(halves):
                child, point = POINTS_OF_HALF[place + 4 * middle]
                quads = covered[:, child]
                own[halves] = self._frame_corners.values[quads]
                turned = COMPLEX_POINTS[point] * self._frame_sides(quads)
                parameters[halves] = self._frame_origins.values[quads] + turned
            yield SurfacePoints(own, _as_pairs(parameters))

    def is_quad(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) bool."""
        return self.slot_counts(nodes) == 4

    def hanging(self, slots: IndexArray) -> BoolArray:
        """Whether the sides at these slots are split, whatever the shape of the array."""
        return self.edge_children.take(self.slot_edges.take(slots)) != NONE

    def sides(self, nodes: IndexArray) -> tuple[NDArray[np.int32], BoolArray]:
        """(nodes,) each: the number of split sides, and whether half of one is split again."""
        split_sides, deeper = np.zeros(len(nodes), dtype=np.int32), np.zeros(len(nodes), dtype=bool)
        for part in chunks(len(nodes), AT_ONCE):
            counts = self.slot_counts(nodes[part])
            states = self._edge_states.values.take(self.slot_edges.take(self.slots(nodes[part])))
            split_sides[part] = sums_of_slots(states & SPLIT, counts)
            deeper[part] = any_of_slots(states >= SPLIT_TWICE, counts)
        return split_sides, deeper

    def share_a_vertex(self, leaves: IndexArray, others: IndexArray) -> BoolArray:
        """(leaves,) bool, which share a vertex with any of the others, the middles of split sides included."""
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
            found[part] = any_of_slots(touched, counts)
        return found

    def leaves_beside(self, nodes: IndexArray) -> IndexArray:
        """The leaves whose ``sides`` a split of these nodes may have changed, each once, in ascending order.

        Splitting a node splits its sides and nothing else. So it changes the split sides of a leaf only where a side of
        the leaf is one of them, or has one of them for a half; or where the leaf is new.
        """
        beside = np.zeros(len(self.first_child), dtype=bool)
        for part in chunks(len(nodes), AT_ONCE):
            edges = self.slot_edges[self.slots(nodes[part])]
            parents = self._edge_parents.values[edges]
            beside[self.nodes_along(edges)] = True
            beside[self.nodes_along(parents[parents != NONE])] = True
            beside[self._children(nodes[part])] = True
        found = np.flatnonzero(beside)
        return found[self.first_child[found] == NONE]

    def edges_by_midpoint(self) -> NDArray[np.int32]:
        """(V,) the edge that each vertex is the midpoint of, or NONE."""
        found, split = _numbers(NONE, len(self.vertex_edges)), np.flatnonzero(self.midpoints != NONE)
        found[self.midpoints[split]] = split
        return found

    def nodes_along(self, edges: IndexArray) -> IndexArray:
        """The nodes with these edges for sides, but for halves; some may be there several times."""
        return self._owners(self._slots_along(edges))

    def _slots_along(self, edges: IndexArray) -> IndexArray:
        """All the slots whose sides are these edges, but for those of halves."""
        found = [np.zeros(0, dtype=np.int32)]
        slots = self._last_slots.values[edges]
        while len(slots := slots[slots != NONE]):
            found.append(slots)
            slots = self._slots_before.values[slots]
        return np.concatenate(found)

    def _owners(self, slots: IndexArray) -> IndexArray:
        """The nodes of slots."""
        nodes = (slots - self.mesh.corner_count) // 4 + self.mesh.face_count
        corners = np.flatnonzero(slots < self.mesh.corner_count)
        nodes[corners] = self.mesh.corner_faces[slots[corners]]
        return nodes

    def children_of_quads(self, quads: IndexArray) -> IndexArray:
        """(4, P): the children at each slot of quads (P,) that have been split."""
        return self.first_child[quads] + np.arange(4)[:, None]

    def _children(self, nodes: IndexArray) -> IndexArray:
        """The children of nodes that have been split."""
        counts = self.slot_counts(nodes)
        return np.arange(counts.sum()) + np.repeat(self.first_child[nodes] - np.cumsum(counts) + counts, counts)

    def reserve(self, leaves: int) -> None:
        """Allocate memory for about so many leaves in all."""
        mesh = self.mesh
        splits = max(0, leaves - mesh.face_count) // 3
        for column in (
            self._first_child,
            self._parents,
            self._levels,
            self._base_faces,
            self._frame_corners,
            self._frame_origins,
            self._frame_turns,
            *(column for column, _ in self._added_columns),
        ):
            column.reserve(mesh.face_count + 4 * splits)
        for column in (self._slot_vertices, self._slot_edges, self._slots_before):
            column.reserve(mesh.corner_count + 16 * splits)
        # A split makes four edges inside and a vertex at the centre. It shares the halves of four sides, and the
        # vertices at their middles, with its neighbours.
        for column in (
            self._last_slots,
            self._edge_vertices,
            self._edge_children,
            self._edge_parents,
            self._edge_states,
            self._midpoints,
            self._base_edges,
        ):
            column.reserve(mesh.edge_count + 8 * splits)
        for column in (
            self._vertex_corners,
            self._vertex_parameters,
            self._vertex_edges,
            *(column for column, _ in self._added_vertex_columns),
        ):
            column.reserve(mesh.vertex_count + 3 * splits)

    def split(self, nodes: IndexArray) -> None:
        """Split leaves, each once."""
        for part in chunks(len(nodes), AT_ONCE):
            self._split(nodes[part])

    def _split(self, nodes: IndexArray) -> None:
        counts = self.slot_counts(nodes)
        starts = np.cumsum(counts) - counts
        places = np.arange(counts.sum()) - np.repeat(starts, counts)
        slots, owners = self.slots(nodes), np.repeat(nodes, counts)
        last = np.repeat(starts + counts - 1, counts)
        before = np.where(places == 0, last, np.arange(len(slots)) - 1)
        edges, vertices = self.slot_edges[slots], self.slot_vertices[slots]

        corners, origins, sides = self._slot_frames(owners, slots, places)
        self._split_edges(edges, corners, origins + sides / 2)
        centres = len(self._vertex_corners.values) + np.repeat(np.arange(len(nodes)), counts)
        self._append_vertices(corners[starts], (origins + (0.5 + 0.5j) * sides)[starts], NONE)
        middles = self.midpoints[edges]
        inner = self._append_edges(np.stack([middles, centres], axis=1), NONE)

        outgoing, incoming = self._halves(edges, vertices), self._halves(edges[before], vertices)
        child_vertices = np.stack([vertices, middles, centres, middles[before]], axis=1)
        child_edges = np.stack([outgoing, inner, inner[before], incoming], axis=1)
        self.first_child[nodes] = len(self.first_child) + starts
        self._first_child.extend(len(slots), NONE)
        self._parents.append(owners)
        self._levels.append(self.levels[owners] + np.int8(1))
        self._base_faces.append(self.base_faces[owners])
        self._frame_corners.append(corners)
        self._frame_origins.append(origins)
        self._frame_turns.append(
            np.where(owners < self.mesh.face_count, 0, self._frame_turns.values[owners] + places) % 4
        )
        for column, default in self._added_columns:
            column.extend(len(slots), default)
        self._append_slots(child_vertices.ravel(), child_edges.ravel())
        self.leaf_count += len(slots) - len(nodes)

    def halves(self, quads: IndexArray, turns: IndexArray) -> IndexArray:
        """Append two halves of each of split quads (P,), whose four children are leaves: each over the two children
        along a side, that at slot ``turns`` (P,), 0 or 1, and the side across. Returns (2, P): the nodes, which are no
        leaves yet (``halve``)."""
        first, places = self.children_of_quads(quads), (turns + np.array([0, 2])[:, None]) % 4
        following = (places + 1) % 4
        one, other = (np.take_along_axis(first, each, axis=0).ravel() for each in (places, following))
        of_one, of_other = self.first_slots(one), self.first_slots(other)
        slots, count = (self.first_slots(quads) + places).ravel(), len(quads)
        vertices = self.slot_vertices[np.stack([of_one, of_other, of_other + 1, of_one + 3], axis=1)]
        edges = self.slot_edges[np.stack([slots, of_other, slots, of_one + 3], axis=1)]
        edges[:, 2] = np.tile(self._append_edges(vertices[:count, 2:], NONE), 2)
        halves, parents = len(self.first_child) + np.arange(2 * count), np.tile(quads, 2)
        self._first_child.append(parents)
        self._parents.append(parents)
        self._levels.append(self.levels[one])
        self._base_faces.append(self.base_faces[one])
        for frames in (self._frame_corners, self._frame_origins, self._frame_turns):
            frames.append(frames.values[one])
        for column, default in self._added_columns:
            column.extend(2 * count, default)
        # No split has to find them.
        self._append_unchained_slots(vertices.ravel(), edges.ravel())
        self.covered = np.concatenate([self.covered, np.stack([one, other], axis=1)])
        return halves.reshape(2, count)

    def halve(self, halves: IndexArray, whole: IndexArray) -> None:
        """Replace the children of quads by their halves (2, P).

        whole: split edges at whose midpoints no leaf has a corner then; they count as whole. The tree can be
        tessellated then, and not be split any more, unless it is made as it was (``undo_halves``); ``sides`` tells what
        it told before.
        """
        self.first_child[self.covered[halves.ravel() - self.first_half]] = halves.reshape(-1, 1)
        self.first_child[halves] = NONE
        self.leaf_count -= halves.size
        self._split_before = (whole, self.edge_children[whole], self.midpoints[whole])
        self.edge_children[whole] = self.midpoints[whole] = NONE

    def undo_halves(self, halves: IndexArray) -> None:
        """Undo the last ``halve``, which made these (2, P)."""
        self.first_child[self.covered[halves.ravel() - self.first_half]] = NONE
        self.first_child[halves] = self.parents[halves]
        self.leaf_count += halves.size
        edges, children, midpoints = self._split_before
        self.edge_children[edges], self.midpoints[edges] = children, midpoints

    def _frame_sides(self, nodes: IndexArray) -> NDArray[np.complex128]:
        """The side of each node from its first slot, in its quarter, which is the child of a whole face."""
        return COMPLEX_SIDES[self._frame_turns.values[nodes]] * np.ldexp(2.0, -self.levels[nodes].astype(np.int32))

    def _slot_frames(
        self, owners: IndexArray, slots: IndexArray, places: IndexArray
    ) -> tuple[IndexArray, NDArray[np.complex128], NDArray[np.complex128]]:
        """For slots: the quarter each lies in, its parameters there, and its side there.

        The side of a whole face reaches twice as far as its quarter.
        """
        corners = self._frame_corners.values[owners]
        origins, axes = self._frame_origins.values[owners], self._frame_sides(owners)
        points, sides = origins + COMPLEX_POINTS[places % 4] * axes, COMPLEX_SIDES[places % 4] * axes
        faces = np.flatnonzero(owners < self.mesh.face_count)
        corners[faces], points[faces], sides[faces] = slots[faces], 0.0, 2.0
        return corners, points, sides

    def _split_edges(self, sides: IndexArray, corners: IndexArray, middles: NDArray[np.complex128]) -> None:
        """Split the whole edges among some sides; corners and middles are the places of their midpoints."""
        whole = np.flatnonzero(self.edge_children[sides] == NONE)
        # Of several sides along an edge the last one written remains.
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
        """The half of the split side at each of the slots ``sides`` that ends at the vertex of each of ``slots``."""
        return self._halves(self.slot_edges[sides], self.slot_vertices[slots])

    def _halves(self, edges: IndexArray, vertices: IndexArray) -> IndexArray:
        """The half of each split edge that ends at a vertex."""
        return self.edge_children[edges] + (self.edge_vertices.take(edges, axis=0)[:, 1] == vertices)

    def _append_slots(self, vertices: IndexArray, edges: IndexArray) -> None:
        waiting = np.arange(len(edges)) + len(self.slot_edges)
        self._append_unchained_slots(vertices, edges)
        # Of several slots along an edge the last one written remains; the next rounds chain the others before it.
        while len(waiting):
            edges = self.slot_edges[waiting]
            before = self._last_slots.values[edges]
            self._last_slots.values[edges] = waiting
            written = self._last_slots.values[edges] == waiting
            self._slots_before.values[waiting[written]] = before[written]
            waiting = waiting[~written]

    def _append_unchained_slots(self, vertices: IndexArray, edges: IndexArray) -> None:
        if len(self.slot_edges) + len(edges) > MOST_SLOTS:
            raise MemoryError("the quadtree is too large")
        self._slot_vertices.append(vertices)
        self._slot_edges.append(edges)
        self._slots_before.extend(len(edges), NONE)

    def _append_vertices(
        self, corners: IndexArray, parameters: NDArray[np.complex128], edges: IndexArray | int
    ) -> IndexArray:
        first = len(self._vertex_corners.values)
        self._vertex_corners.append(corners)
        self._vertex_parameters.append(parameters)
        self._vertex_edges.extend(len(corners), edges)
        for column, default in self._added_vertex_columns:
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


def any_of_slots(values: BoolArray, counts: IndexArray) -> BoolArray:
    """(nodes,) whether any is true of values of their slots, node by node; counts: (nodes,) how many each has."""
    if len(values) == 4 * len(counts) and np.all(counts == 4):
        first, second, third, fourth = values.reshape(-1, 4).T
        return first | second | third | fourth
    return np.logical_or.reduceat(values, np.cumsum(counts) - counts)


def sums_of_slots(values: BoolArray | NDArray[np.uint8], counts: IndexArray) -> NDArray[np.int32]:
    """(nodes,) their sums, in the same way."""
    if len(values) == 4 * len(counts) and np.all(counts == 4):
        first, second, third, fourth = values.reshape(-1, 4).T.view(np.uint8)
        return (first + second + third + fourth).astype(np.int32)
    return np.add.reduceat(values, np.cumsum(counts) - counts, dtype=np.int32)


def _added(columns: list[tuple[Column, Any]], default: np.generic, like: Column) -> Column:
    """A new one of these columns, with the length and the memory of another."""
    column = Column(np.full(len(like.values), default))
    column.reserve(like.room)
    columns.append((column, default))
    return column


def _numbers(values: IndexArray | int, shape: int | tuple[int, int]) -> NDArray[np.int32]:
    """In the tree's dtype."""
    return np.full(shape, values, dtype=np.int32)


def _as_pairs(parameters: NDArray[np.complex128]) -> FloatArray:
    """(…, 2): complex numbers as parameters u and v."""
    return parameters.view(np.float64).reshape(-1, 2)
