# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of an adaptive mesh: a quadtree on its way, what is known of its nodes, and what is to be evaluated again.

The phases that work on it are ``growth``, ``balance`` and ``neighbour_bounds``, in the order of ``planner``.
"""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as dataclass_field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from .approximation_store import ApproximationStore
from .cells.cell_store import CellStore
from .leaf_approximation import Cells, LeafApproximation
from .quadtree import NONE, Quadtree
from .templates import Transitions
from .vertex_positions import VertexPositions

# Faces for each leaf, transitions included, when they are only estimated; and how far the estimate has to be above the
# number allowed to be believed.
FACES_OF_A_LEAF = 1.3
BELIEVED = 4

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
class AdaptiveRequest:
    """What is wanted of a control mesh. limit: the largest distance, in the unit of its positions, rounding taken off.

    most_faces: beyond that many the result is refused. axes: (3, 3) float64, its columns the axes of the space where
    Blender triangulates the result, in coordinates of the positions. rounding: what it can hide from a distance
    (``face_depths.rounding_allowance``), in the unit of the positions, for bounds in which that counts for more.
    """

    limit: float
    mode: Mode
    transitions: Transitions
    most_faces: int
    axes: FloatArray = dataclass_field(default_factory=lambda: np.eye(3))
    rounding: float = 0.0


class NodeQueue:
    """Nodes of a tree that wait."""

    def __init__(self, tree: Quadtree) -> None:
        self._tree = tree
        self._waiting: list[IndexArray] = []

    def put(self, nodes: IndexArray) -> None:
        """Let nodes wait; they may do so already."""
        if len(nodes):
            self._waiting.append(nodes)

    def take(self) -> IndexArray:
        """All that wait, as they came; none waits any longer."""
        waiting, self._waiting = self._waiting, []
        return np.concatenate([np.zeros(0, dtype=np.intp), *waiting])

    def take_leaves(self) -> IndexArray:
        """Those of them that are leaves, each once, in ascending order; none waits any longer."""
        is_waiting = np.zeros(len(self._tree.first_child), dtype=bool)
        for nodes in self._waiting:
            is_waiting[nodes] = True
        self._waiting = []
        return np.flatnonzero(is_waiting & (self._tree.first_child == NONE))


class Plan:
    """tree; of its nodes cells, what is known of the surface, and fits, how they are drawn; of its vertices positions.
    split_sides: (nodes,) how many of a leaf's sides were split when it was fitted last; it never gets fewer.

    Three queues say what a split may have changed, so that only this is evaluated again. split_nodes: nodes split since
    balance was looked at. beside_split: leaves some of whose sides may have been split since they were fitted. fitted:
    nodes fitted since the bounds along the surface were found.
    """

    def __init__(self, mesh: PolygonMesh, request: AdaptiveRequest, least_levels: NDArray[np.int8]) -> None:
        """least_levels: (faces of the mesh,) the least level of the leaves on each."""
        self.request = request
        self.tree = Quadtree(mesh)
        self.positions = VertexPositions(self.tree)
        self.cells = CellStore(self.tree)
        self.approximations = ApproximationStore(self.tree)
        self.split_sides = self.tree.add_column(np.int32(0))
        self.split_nodes, self.beside_split, self.approximated = (NodeQueue(self.tree) for _ in range(3))
        self._least_levels = least_levels

    def split(self, nodes: IndexArray) -> None:
        """Split leaves, each once."""
        self.tree.split(nodes)
        self.split_nodes.put(nodes)

    def approximate(self, cells: Cells, hanging: BoolArray) -> LeafApproximation:
        """How to draw cells with these sides split, (slots of the cells,)."""
        return cells.approximate(hanging, self.request.transitions, self.request.limit, self.request.axes)

    def record(self, nodes: IndexArray, approximation: LeafApproximation) -> None:
        """Nodes, each once, are drawn like that."""
        self.approximations.put(nodes, approximation)
        self.approximated.put(nodes)

    def has_least_level(self, nodes: IndexArray) -> BoolArray:
        """(nodes,) whether they are on the least level of their face, or below."""
        return self.tree.levels[nodes] >= self._least_levels[self.tree.base_faces[nodes]]

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
        """About how many leaves there will be, now that these nodes have to be split."""
        worth = np.maximum(_leaves_of(self.approximations.least[unfinished] / self.request.limit), 4.0)
        return int(self.tree.leaf_count - len(unfinished) + worth.sum())

    def refuse_too_many(self, unfinished: int, expected: int) -> None:
        """Raise TooManyFacesError if there are too many leaves now that so many have to be split, or if so many as are
        expected are far too many."""
        estimate, most = int(FACES_OF_A_LEAF * expected), self.request.most_faces
        if self.tree.leaf_count + 3 * unfinished > most or estimate > BELIEVED * most:
            raise TooManyFacesError(estimate, self._fitting_limit())

    def _fitting_limit(self) -> float:
        """A limit by which about as many faces as allowed would be made; inf where the mesh has too many itself."""
        least = self.approximations.least[: self.tree.mesh.face_count]
        if len(least) > self.request.most_faces:
            return np.inf
        room = max(self.request.most_faces / FACES_OF_A_LEAF, len(least))
        limit = self.request.limit
        while _leaves_of(least / limit).sum() > room:
            limit *= SEARCH_STEP
        return limit


def _leaves_of(ratios: FloatArray) -> FloatArray:
    """About how many leaves it takes where the distance is so many limits: a level divides it by four."""
    return 4.0 ** np.ceil(np.log2(np.maximum(ratios, 1.0)) / 2)
