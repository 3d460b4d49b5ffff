# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of an adaptive mesh: a quadtree, the data of its nodes, and the nodes that need evaluation again.

The phases ``growth``, ``balance`` and ``along_surface`` work on it, in the order of ``planner``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress
from .approximation_store import ApproximationStore
from .cells.cell_store import CellStore
from .leaf_approximation import Cells, LeafApproximation
from .quadtree import NONE, Quadtree
from .request import AdaptiveRequest
from .vertex_positions import VertexPositions

# Estimated faces for each leaf before any are halved, transitions included; the least there can be; and the ratio of
# the estimate to the number allowed above which a result is refused before it is planned.
FACES_OF_A_LEAF = 1.0
LEAST_FACES_OF_A_LEAF = 0.5
SURELY_TOO_MANY = 4

# The factor between the tolerances tried in search of one with few enough faces.
SEARCH_STEP = 1.1


class TooManyFacesError(ValueError):
    """The result would be too large. faces: their estimated number; tolerance: an estimate of one with few enough
    faces, in the unit of the positions, from the control mesh's faces alone."""

    def __init__(self, faces: int, tolerance: float) -> None:
        super().__init__(f"the result would have about {faces:,} faces; about {tolerance:.3g} might fit")
        self.faces = faces
        self.tolerance = tolerance


class NodeQueue:
    """Nodes of a tree, waiting for evaluation."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        self._waiting: list[IndexArray] = []

    def put(self, nodes: IndexArray) -> None:
        """Add nodes; they may be in the queue already."""
        if len(nodes):
            self._waiting.append(nodes)

    def take(self) -> IndexArray:
        """Empty the queue: all nodes in the order they came."""
        waiting, self._waiting = self._waiting, []
        return np.concatenate([np.zeros(0, dtype=np.intp), *waiting])

    def take_leaves(self) -> IndexArray:
        """Empty the queue: the leaves among its nodes, each once, in ascending order."""
        is_waiting = np.zeros(len(self._tree.first_child), dtype=bool)
        for nodes in self._waiting:
            is_waiting[nodes] = True
        self._waiting = []
        return np.flatnonzero(is_waiting & (self._tree.first_child == NONE))


class Plan:
    """tree; the cells and approximations of its nodes; the positions of its vertices. split_sides: (nodes,) how many of
    a leaf's sides were split at its last approximation; the number never falls.

    Three queues hold what a split may have changed, so that only this is evaluated again. split_nodes: nodes split
    since the last test of balance. beside_split: leaves whose sides may have been split since their approximation.
    approximated: nodes approximated since the last search for bounds along the surface.
    """

    def __init__(
        self, mesh: PolygonMesh, request: AdaptiveRequest, least_levels: NDArray[np.int8], progress: Progress
    ) -> None:
        """least_levels: (faces of the mesh,) the least level of the leaves on each. progress: is told their number."""
        self.request = request
        self._progress = progress
        self.tree = Quadtree(mesh)
        self.positions = VertexPositions(self.tree)
        self.cells = CellStore(self.tree)
        self.approximations = ApproximationStore(self.tree)
        self.split_sides = self.tree.add_column(np.int32(0))
        self.split_nodes, self.beside_split, self.approximated = (NodeQueue(self.tree) for _ in range(3))
        self._least_levels = least_levels

    def report(self) -> None:
        """Tell the number of leaves so far; raises what the caller raises to stop."""
        self._progress(self.tree.leaf_count)

    def split(self, nodes: IndexArray) -> None:
        """Split leaves, each once."""
        self.tree.split(nodes)
        self.split_nodes.put(nodes)

    def approximate(self, cells: Cells, hanging: BoolArray) -> LeafApproximation:
        """How to approximate cells with these sides split, (slots of the cells,)."""
        return cells.approximate(hanging, self.request)

    def record(self, nodes: IndexArray, approximation: LeafApproximation) -> None:
        """Record the approximation of nodes, each once."""
        self.approximations.put(nodes, approximation)
        self.approximated.put(nodes)

    def has_least_level(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) whether they have the least level of their face, or a deeper one."""
        return self.tree.levels[nodes] >= self._least_levels[self.tree.base_faces[nodes]]

    def may_be_halved(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) whether they lie on faces without a least level."""
        return self._least_levels[self.tree.base_faces[nodes]] == 0

    def whole_of(self, nodes: IndexArray) -> IndexArray:
        """Those of some nodes that are not split."""
        return nodes[self.tree.first_child[nodes] == NONE]

    def leaves(self) -> IndexArray:
        """The leaves in the order of the control mesh's faces."""
        leaves = self.tree.leaves()
        return leaves[np.argsort(self.tree.base_faces[leaves], kind="stable")]

    def face_levels(self) -> NDArray[np.int8]:
        """(faces of the control mesh,) the level of the deepest leaf of each."""
        deepest = np.zeros(self.tree.mesh.face_count, dtype=np.int8)
        np.maximum.at(deepest, self.tree.base_faces, self.tree.levels)
        return deepest

    def expected_leaves(self, unfinished: IndexArray) -> int:
        """The estimated number of leaves in the end, if these nodes have to be split."""
        leaves = np.maximum(_leaves_of(self.approximations.least[unfinished] / self.request.limit), 4.0)
        return int(self.tree.leaf_count - len(unfinished) + leaves.sum())

    def refuse_too_many(self, unfinished: int, expected: int) -> None:
        """Raise TooManyFacesError if splitting so many leaves makes too many, or if far too many are expected."""
        estimate, most = int(FACES_OF_A_LEAF * expected), self.request.most_faces
        leaves = self.tree.leaf_count + 3 * unfinished
        if LEAST_FACES_OF_A_LEAF * leaves > most or estimate > SURELY_TOO_MANY * most:
            raise TooManyFacesError(estimate, self._feasible_limit())

    def _feasible_limit(self) -> float:
        """A limit with about as many faces as allowed; inf if the control mesh itself has more."""
        least = self.approximations.least[: self.tree.mesh.face_count]
        if len(least) > self.request.most_faces:
            return np.inf
        room = max(self.request.most_faces / FACES_OF_A_LEAF, len(least))
        limit = self.request.limit
        while _leaves_of(least / limit).sum() > room:
            limit *= SEARCH_STEP
        return limit


def _leaves_of(ratios: FloatArray) -> FloatArray:
    """Estimated leaves for ratios of distance to limit: a level divides the distance by four."""
    return 4.0 ** np.ceil(np.log2(np.maximum(ratios, 1.0)) / 2)
