# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: which quadtree over a control mesh is drawn within a tolerance of the limit surface.

A node is split while its own bound, as it is drawn, exceeds the tolerance; then wherever a neighbour is more than one
level deeper; then wherever no template for its split sides is within the tolerance; until nothing is left to split.
Splitting only ever makes bounds smaller in the end, and no split is undone, so this ends. What is drawn in the end is
what was bounded, piece by piece (``triangle_bounds``, ``polygons``, ``graph_bounds``): so every point of the mesh is
that near to the surface, and every point of the surface that near to the mesh (docs/adaptive.md).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from .blocks import blocks
from .cell_store import CellStore, in_blocks, some
from .cells import cells_of_faces
from .drawing import Outline, draw, outline, triangles_around
from .fit_store import FitStore
from .fits import Cells, Fit
from .graph_bounds import graph_bounds
from .mesh import FloatArray, IndexArray, PolygonMesh
from .net_cells import BicubicCells, NetCells
from .quadtree import NONE, Column, Quadtree
from .subdivided_mesh import SubdividedMesh
from .templates import Transitions
from .vertex_positions import VertexPositions

BoolArray = NDArray[np.bool_]

# Faces for each leaf, transitions included, when they are only estimated; and how far the estimate has to be above the
# number allowed to be believed.
FACES_OF_A_LEAF = 1.3
BELIEVED = 4

# So many bicubic cells are kept in one block, of which so many are looked at together: what is made on the way stays in
# the processor's cache, and in memory that need not come from the system anew.
CELLS_KEPT_TOGETHER = 1 << 15
PARENTS_AT_ONCE = 1 << 12

# So many take about a tenth of a second, after which there is a sign of life.
NODES_SPLIT_AT_ONCE = 1 << 16

# Beside a quad that is split lie its own quarters and at most two leaves along each side, as soon as there is balance.
LEAVES_BESIDE = 12

# No face has fewer.
FEWEST_SIDES = 3

# By how much a tolerance is raised in search of one that fits.
SEARCH_STEP = 1.1


class Mode(StrEnum):
    """How the faces of the control mesh are divided."""

    ADAPTIVE = "ADAPTIVE"
    PER_FACE = "PER_FACE"


class TooManyFacesError(ValueError):
    """The result would be too large. faces: about how many there would be; tolerance: where to begin to look for one
    that fits, in the unit of the positions. It is worked out from the whole faces, and not tried out."""

    def __init__(self, faces: int, tolerance: float) -> None:
        super().__init__(f"the result would have about {faces:,} faces; about {tolerance:.3g} might fit")
        self.faces = faces
        self.tolerance = tolerance


@dataclass(frozen=True)
class AdaptiveMesh:
    """The mesh, and of each of its F faces: (F,) float64 the proved distance; (F,) int32 the depth of its base face,
    which is the level of the deepest leaf there. leaf_count: how many leaves of the quadtree they draw."""

    mesh: SubdividedMesh
    bounds: FloatArray
    depths: NDArray[np.int32]
    leaf_count: int


@dataclass(frozen=True)
class Request:
    """What is wanted of a control mesh. limit: the largest distance, in the unit of its positions, rounding taken off.

    most_faces: beyond that many the result is refused. axes: (3, 3) float64, its columns the axes of the space where
    Blender triangulates the result, in coordinates of the positions. rounding: what it can hide from a distance
    (``depth.rounding_allowance``), in the unit of the positions, for bounds in which that counts for more.
    """

    limit: float
    mode: Mode
    transitions: Transitions
    most_faces: int
    axes: FloatArray = dataclass_field(default_factory=lambda: np.eye(3))
    rounding: float = 0.0


def count_faces(mesh: PolygonMesh, request: Request) -> Generator[int, None, int]:
    """How many faces the result would have, in steps: yields how many leaves there are so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``). Raises TooManyFacesError.
    """
    settled = yield from _settled(mesh, request)
    return len(settled.bounds)


def subdivide_adaptively(
    mesh: PolygonMesh, request: Request, positions: FloatArray
) -> Generator[int, None, AdaptiveMesh]:
    """The mesh that is drawn within the limit, in steps: yields how many leaves there are so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``), in the space the limit is meant in.
    positions: (V, 3) float64, of the same control mesh in the space that is wanted, with the axes of the request.
    Raises TooManyFacesError.
    """
    settled = yield from _settled(mesh, request)
    made = draw(settled.outline, settled.positions.in_space_of(positions, settled.outline.used))
    depths = settled.depths[made.base_faces].astype(np.int32)
    return AdaptiveMesh(made, settled.bounds, depths, len(settled.outline.leaves))


@dataclass(frozen=True)
class _Settled:
    """What is drawn within the limit, and the proved distance of each of its F faces: (F,) float64. depths: (faces of
    the control mesh,) the level of the deepest leaf of each. positions: of the tree's vertices, in the mesh's space."""

    outline: Outline
    bounds: FloatArray
    depths: NDArray[np.int8]
    positions: VertexPositions


def _settled(mesh: PolygonMesh, request: Request) -> Generator[int, None, _Settled]:
    """Plan until nothing that is drawn clashes."""
    least_levels = np.zeros(mesh.face_count, dtype=np.int8)
    while True:
        planner = _Planner(mesh, request, least_levels)
        yield from planner.settle()
        tree, leaves, depths = planner.tree, planner.leaves(), planner.face_levels()
        fit, positions = planner.fits.of(leaves), planner.positions
        # What else is known of the surface takes as much memory as the tree, and has served its turn.
        del planner
        found = outline(tree, leaves, fit, request.transitions)
        if not len(clashes := found.clashes):
            return _Settled(found, fit.bounds[found.drawn], depths, positions)
        np.maximum.at(least_levels, tree.base_faces[clashes], tree.levels[clashes] + np.int8(1))


class _Planner:
    """A tree on its way, the cells of its leaves, and how they fit so far.

    Only what a split may have changed is looked at again: the leaves beside the nodes that were split
    (``Quadtree.leaves_beside``) for how their sides are split, and those that share a vertex with a leaf fitted since
    for how they fit along the surface.
    """

    def __init__(self, mesh: PolygonMesh, request: Request, least_levels: NDArray[np.int8]) -> None:
        self.tree = Quadtree(mesh)
        self._least_levels = least_levels
        self._request = request
        self._limit = request.limit
        self.positions = VertexPositions(self.tree)
        self._cells = CellStore(self.tree)
        self.fits = FitStore(self.tree)
        # How many of a leaf's sides were split when it was fitted last; it never gets fewer.
        self._split_sides = Column(np.zeros(0, dtype=np.int32))
        # The nodes split since balance was looked at; whether a leaf's sides may have been split since it was fitted;
        # and whether it was fitted since the bounds along the surface were found.
        self._split_since: list[IndexArray] = []
        self._touched = Column(np.zeros(0, dtype=bool))
        self._fitted_since = Column(np.zeros(0, dtype=bool))

    def settle(self) -> Generator[int, None, None]:
        """Find the whole tree."""
        self._extend()
        yield from self.grow((yield from self._fit_new(cells_of_faces(self.tree.mesh))))
        if self._request.mode is Mode.PER_FACE:
            yield from self.level_faces()
        yield from self.settle_neighbours()

    def settle_neighbours(self) -> Generator[int, None, None]:
        """Split until every leaf fits beside its neighbours."""
        while len(wanted := (yield from self.misfits())):
            yield from self.split(wanted)

    def misfits(self) -> Generator[int, None, IndexArray]:
        """The leaves to split next: those out of balance, or else those that do not fit as their sides are, or else
        along the surface."""
        if len(wanted := self.unbalanced()):
            return wanted
        if len(wanted := (yield from self.fit_split_sides())):
            return wanted
        return self.evened((yield from self.fit_along_surface()))

    def grow(self, unfit: list[Cells]) -> Generator[int, None, None]:
        """Split the nodes of cells that do not fit, if they are whole yet, and so their children, level by level."""
        while unfit:
            nodes = self._whole_of(np.concatenate([cells.nodes for cells in unfit]))
            expected = self._expected_leaves(nodes)
            self._refuse_too_many(len(nodes), expected)
            self.tree.reserve(min(expected, self._request.most_faces))
            for part in blocks(len(nodes), NODES_SPLIT_AT_ONCE):
                self._split_nodes(nodes[part])
                yield self.tree.leaf_count
            unfit = yield from self._fit_children(unfit)

    def _fit_children(self, parents: list[Cells]) -> Generator[int, None, list[Cells]]:
        """Fit the children of cells whose nodes have been split; those that do not fit, or have been split as well."""
        unfit: list[Cells] = []
        doubtful: list[Cells] = []
        with_nets = (cells for cells in parents if isinstance(cells, NetCells))
        for cells in in_blocks(with_nets, CELLS_KEPT_TOGETHER):
            self._cells.put(cells)
            if isinstance(cells, BicubicCells):
                is_doubtful, is_unfit = yield from self._look_at_children(cells)
                doubtful += cells.children(self.tree, is_doubtful)
                unfit += cells.children(self.tree, is_unfit)
            else:
                assert isinstance(cells, NetCells)
                self._place(cells, cells.points())
                doubtful += cells.children(self.tree)
        unfit += yield from self._fit_new(doubtful, are_made_again=True)
        others = (cells for cells in parents if not isinstance(cells, NetCells))
        unfit += yield from self._fit_new(child for cells in others for child in cells.children(self.tree))
        return unfit

    def _whole_of(self, nodes: IndexArray) -> IndexArray:
        """Those of some nodes that are not split."""
        return nodes[self.tree.first_child[nodes] == NONE]

    def split(self, wanted: IndexArray) -> Generator[int, None, None]:
        """Split the wanted leaves, and all that gets out of balance by that."""
        self._refuse_too_many(len(wanted), self._expected_leaves(wanted))
        parents: list[Cells] = []
        known = len(self.tree.first_child)
        while len(wanted):
            # What is made meanwhile comes with its parents.
            parents += self._cells.of(wanted[wanted < known])
            self._split_nodes(wanted)
            wanted = self.unbalanced()
        yield from self.grow((yield from self._fit_children(parents)))

    def _split_nodes(self, nodes: IndexArray) -> None:
        self.tree.split(nodes)
        self._extend()
        self._split_since.append(nodes)

    def level_faces(self) -> Generator[int, None, None]:
        """Split every face of the control mesh to the level of its deepest leaf."""
        while True:
            leaves = self.tree.leaves()
            shallow = leaves[self.tree.levels[leaves] < self.face_levels()[self.tree.base_faces[leaves]]]
            if not len(shallow):
                return
            yield from self.split(shallow)

    def evened(self, wanted: IndexArray) -> IndexArray:
        """The leaves to split so that the wanted ones are; where faces are divided evenly, with a wanted leaf of the
        least level of its face go all others of this level."""
        if self._request.mode is not Mode.PER_FACE or not len(wanted):
            return wanted
        tree, leaves = self.tree, self.tree.leaves()
        least = np.full(tree.mesh.face_count, np.iinfo(np.int8).max, dtype=np.int8)
        np.minimum.at(least, tree.base_faces[leaves], tree.levels[leaves])
        is_least = tree.levels == least[tree.base_faces]
        uneven = np.zeros(tree.mesh.face_count, dtype=bool)
        uneven[tree.base_faces[wanted[is_least[wanted]]]] = True
        return np.union1d(wanted, leaves[is_least[leaves] & uneven[tree.base_faces[leaves]]])

    def face_levels(self) -> NDArray[np.int8]:
        """(faces of the control mesh,) the level of the deepest leaf of each."""
        deepest = np.zeros(self.tree.mesh.face_count, dtype=np.int8)
        np.maximum.at(deepest, self.tree.base_faces, self.tree.levels)
        return deepest

    def unbalanced(self) -> IndexArray:
        """The leaves beside others more than one level deeper, or with all their sides split."""
        if not self._split_since:
            return np.zeros(0, dtype=np.intp)
        leaves = self._leaves_beside_split()
        self._touched.values[leaves] = True
        counts, wanted = self.tree.sides(leaves)
        possible = np.flatnonzero(counts >= FEWEST_SIDES)
        wanted[possible] |= counts[possible] == self.tree.slot_counts(leaves[possible])
        return leaves[wanted]

    def _leaves_beside_split(self) -> IndexArray:
        """The leaves beside nodes that were split since balance was looked at; or all if there are not many more."""
        split = np.concatenate(self._split_since)
        self._split_since = []
        if LEAVES_BESIDE * len(split) >= self.tree.leaf_count:
            return self.tree.leaves()
        return self.tree.leaves_beside(split)

    def fit_split_sides(self) -> Generator[int, None, IndexArray]:
        """Fit the leaves anew some more of whose sides are split by now; those that do not fit."""
        leaves = np.flatnonzero(self._touched.values & (self.tree.first_child == NONE))
        self._touched.values[:] = False
        counts, _ = self.tree.sides(leaves)
        more = counts != self._split_sides.values[leaves]
        pending = leaves[more]
        self._split_sides.values[pending] = counts[more]
        yield from self._each(self._fit_as_split, pending)
        return pending[~self.fits.as_fitted(pending).fits]

    def fit_along_surface(self) -> Generator[int, None, IndexArray]:
        """Bound the leaves that are not within the limit at equal parameters by their neighbours; those that do not
        fit for all that.

        A leaf's bound comes from how it and the leaves with a vertex of it are drawn. Where that has changed one of
        them was fitted since: its sides were split, or it is new and has the vertices of the leaf that was there.
        """
        unbounded = self.fits.unbounded()
        wanted = self._fitted_since.values[unbounded]
        wanted[~wanted] = self._are_beside_fitted(unbounded[~wanted])
        self._fitted_since.values[:] = False
        wanted = unbounded[wanted]
        if len(wanted):
            yield from self._find_graph_bounds(wanted)
        return wanted[self.fits.graph_bounds(wanted) > self._limit]

    def _are_beside_fitted(self, leaves: IndexArray) -> BoolArray:
        """(leaves,) those that share a vertex with one that was fitted since."""
        if not len(leaves):
            return np.zeros(0, dtype=bool)
        fitted = np.flatnonzero(self._fitted_since.values & (self.tree.first_child == NONE))
        found = self._faces_around(fitted)[self.tree.base_faces[leaves]]
        found[found] = self.tree.share_a_vertex(leaves[found], fitted)
        return found

    def _faces_around(self, nodes: IndexArray) -> BoolArray:
        """(faces of the control mesh,) those with a vertex of any on which there are nodes: on these are all nodes that
        share a vertex with them."""
        mesh = self.tree.mesh
        marked = np.zeros(mesh.face_count, dtype=bool)
        marked[self.tree.base_faces[nodes]] = True
        at_vertices = np.zeros(mesh.vertex_count, dtype=bool)
        at_vertices[mesh.corner_vertices[marked[mesh.corner_faces]]] = True
        return np.logical_or.reduceat(at_vertices[mesh.corner_vertices], mesh.face_starts[:-1])

    def _find_graph_bounds(self, wanted: IndexArray) -> Generator[int, None, None]:
        """Find those of the wanted leaves."""
        leaves = np.flatnonzero(self._faces_around(wanted)[self.tree.base_faces] & (self.tree.first_child == NONE))
        leaves = leaves[self.tree.share_a_vertex(leaves, wanted)]
        yield from self._each(self._miss, leaves[np.isinf(self.fits.misses(leaves)[0])])
        drawn = triangles_around(self.tree, leaves, self.fits.as_fitted(leaves), self._request.transitions)
        nodes = leaves[drawn.leaves]
        is_wanted = np.zeros(len(self.tree.first_child), dtype=bool)
        is_wanted[wanted] = True
        found = graph_bounds(
            self.positions.of(drawn.used),
            drawn.corners,
            *self.fits.misses(nodes),
            drawn.closed,
            is_wanted[nodes],
            self._request.rounding,
        )
        self.fits.put_graph_bounds(wanted, nodes[is_wanted[nodes]], found)

    def _each(self, work: Callable[[Cells], None], nodes: IndexArray) -> Generator[int, None, None]:
        """Do some work for the cells of nodes."""
        for cells in in_blocks(self._cells.of(nodes)):
            work(cells)
            yield self.tree.leaf_count

    def _miss(self, cells: Cells) -> None:
        """Find and record how far cells are off along and across their normals: no farther than in all."""
        nodes = cells.nodes
        self.fits.put_misses(nodes, cells.misses(self.fits.as_fitted(nodes), self._limit))

    def leaves(self) -> IndexArray:
        """The leaves in the order of the control mesh's faces."""
        leaves = self.tree.leaves()
        return leaves[np.argsort(self.tree.base_faces[leaves], kind="stable")]

    def _fit_new(self, cells: Iterable[Cells], *, are_made_again: bool = False) -> Generator[int, None, list[Cells]]:
        """Fit and record the cells of new leaves, with their sides whole; those that do not fit, or whose nodes are
        split already.

        are_made_again: whether they are found later from their parents' nets, so that they are not kept
        (``CellStore``).
        """
        unfit: list[Cells] = []
        for block in in_blocks(cells):
            is_leaf = self.tree.first_child[block.nodes] == NONE
            unfit += some(block, ~is_leaf)
            for leaves in some(block, is_leaf):
                fit = self._fit(leaves, np.zeros(self.tree.slot_counts(leaves.nodes).sum(), dtype=bool))
                self._record(leaves.nodes, fit)
                fits = fit.fits & self._has_least_level(leaves.nodes)
                if not are_made_again:
                    for kept in some(leaves, fits):
                        self._cells.put(kept)
                unfit += some(leaves, ~fits)
            yield self.tree.leaf_count
        return unfit

    def _look_at_children(self, parents: BicubicCells) -> Generator[int, None, tuple[BoolArray, BoolArray]]:
        """Fit and record the children of which a look at their parents tells whether they fit; of which it does not
        tell, and which do not fit or have been split, (4, P) bool each."""
        doubtful, unfit = np.zeros((2, 4, len(parents.nodes)), dtype=bool)
        for part in blocks(len(parents.nodes), PARENTS_AT_ONCE):
            cells = parents.part(part)
            found = cells.fit_children(self._limit, self._request.axes)
            nodes = self.tree.quarters(cells.nodes).ravel()
            self._place(cells, found.points)
            is_leaf = self.tree.first_child[nodes] == NONE
            is_done = found.fit.fits & is_leaf & self._has_least_level(nodes)
            is_unfit = found.hopeless | (found.fit.fits & ~is_done)
            recorded = np.flatnonzero(is_leaf & (is_done | is_unfit))
            self._record(nodes[recorded], found.fit.at(recorded))
            unfit[:, part] = is_unfit.reshape(4, -1)
            doubtful[:, part] = ~(is_done | is_unfit).reshape(4, -1)
            yield self.tree.leaf_count
        return doubtful, unfit

    def _place(self, cells: NetCells, points: FloatArray) -> None:
        """Keep where the points of split quads and their centres (9, P, 3) lie: the corners too of faces of the control
        mesh; those of others came with a split before, or else they are evaluated."""
        tree, nodes = self.tree, cells.nodes
        slots = tree.slots(nodes).reshape(-1, 4)
        if np.any(turns := cells.turns()):
            slots = np.take_along_axis(slots, (np.arange(4) + turns[:, None]) % 4, axis=1)
        centres = tree.slot_vertices[tree.first_slots(tree.first_child[nodes]) + 2]
        self.positions.put(np.vstack([tree.midpoints[tree.slot_edges[slots.T]], centres]), points[4:])
        faces = np.flatnonzero(nodes < tree.mesh.face_count)
        if len(faces):
            self.positions.put(tree.slot_vertices[slots[faces].T], points[:4, faces])

    def _has_least_level(self, nodes: IndexArray) -> BoolArray:
        return self.tree.levels[nodes] >= self._least_levels[self.tree.base_faces[nodes]]

    def _fit_as_split(self, cells: Cells) -> None:
        """Fit and record cells with those sides split that are."""
        self._record(cells.nodes, self._fit(cells, self.tree.hanging(self.tree.slots(cells.nodes))))

    def _fit(self, cells: Cells, hanging: BoolArray) -> Fit:
        return cells.fit(hanging, self._request.transitions, self._limit, self._request.axes)

    def _record(self, nodes: IndexArray, fit: Fit) -> None:
        self.fits.put(nodes, fit)
        self._fitted_since.values[nodes] = True

    def _extend(self) -> None:
        """Make room for the nodes of the tree."""
        more = len(self.tree.first_child) - len(self._split_sides.values)
        for column in (self._split_sides, self._touched, self._fitted_since):
            column.reserve(self.tree.node_room)
            column.extend(more, 0)
        self.fits.extend()
        self._cells.extend()

    def _expected_leaves(self, unfit: IndexArray) -> int:
        """About how many leaves there will be, now that these nodes have to be split."""
        worth = np.maximum(_leaves_of(self.fits.least[unfit] / self._limit), 4.0)
        return int(self.tree.leaf_count - len(unfit) + worth.sum())

    def _refuse_too_many(self, unfit: int, expected: int) -> None:
        """Raise TooManyFacesError if there are too many leaves now that so many have to be split, or if so many as are
        expected are far too many."""
        estimate, most = int(FACES_OF_A_LEAF * expected), self._request.most_faces
        if self.tree.leaf_count + 3 * unfit > most or estimate > BELIEVED * most:
            raise TooManyFacesError(estimate, self._fitting_limit())

    def _fitting_limit(self) -> float:
        """A limit by which about as many faces as allowed would be made; inf where the mesh has too many itself."""
        least = self.fits.least[: self.tree.mesh.face_count]
        if len(least) > self._request.most_faces:
            return np.inf
        room = max(self._request.most_faces / FACES_OF_A_LEAF, len(least))
        limit = self._limit
        while _leaves_of(least / limit).sum() > room:
            limit *= SEARCH_STEP
        return limit


def _leaves_of(ratios: FloatArray) -> FloatArray:
    """About how many leaves it takes where the distance is so many limits: a level divides it by four."""
    return 4.0 ** np.ceil(np.log2(np.maximum(ratios, 1.0)) / 2)
