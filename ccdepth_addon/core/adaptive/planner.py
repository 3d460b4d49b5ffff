# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: which quadtree over a control mesh is drawn within a tolerance of the limit surface.

A node is split while its own bound, as it is drawn, exceeds the tolerance; then wherever a neighbour is more than one
level deeper; then wherever no template for its split sides is within the tolerance; until nothing is left to split.
Splitting only ever makes bounds smaller in the end, and no split is undone, so this ends. What is drawn in the end is
what was bounded, piece by piece (``triangle_bounds``, ``polygon_bounds``, ``star_bounds``): so every point of the mesh
is that near to the surface, and every point of the surface that near to the mesh (docs/adaptive.md).
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from .balance import approximate_split_sides, unbalanced
from .cells.control_faces import cells_of_faces
from .growth import approximate_children, approximate_new, grow
from .leaf_approximation import Cells
from .neighbour_bounds import bound_along_surface
from .plan import AdaptiveRequest, Mode, Plan
from .subdivided_mesh import SubdividedMesh
from .tessellation import TessellationPlan, plan_tessellation, tessellate
from .vertex_positions import VertexPositions


@dataclass(frozen=True)
class AdaptiveMesh:
    """The mesh, and of each of its F faces: (F,) float64 the proved distance; (F,) int32 the depth of its base face,
    which is the level of the deepest leaf there. leaf_count: how many leaves of the quadtree they draw."""

    mesh: SubdividedMesh
    bounds: FloatArray
    depths: NDArray[np.int32]
    leaf_count: int


def count_faces(mesh: PolygonMesh, request: AdaptiveRequest) -> Generator[int, None, int]:
    """How many faces the result would have, in steps: yields how many leaves there are so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``). Raises TooManyFacesError.
    """
    settled = yield from _plan_within(mesh, request)
    return len(settled.bounds)


def subdivide_adaptively(
    mesh: PolygonMesh, request: AdaptiveRequest, positions: FloatArray
) -> Generator[int, None, AdaptiveMesh]:
    """The mesh that is drawn within the limit, in steps: yields how many leaves there are so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``), in the space the limit is meant in.
    positions: (V, 3) float64, of the same control mesh in the space that is wanted, with the axes of the request.
    Raises TooManyFacesError.
    """
    settled = yield from _plan_within(mesh, request)
    made = tessellate(settled.plan, settled.positions.in_space_of(positions, settled.plan.used))
    depths = settled.depths[made.base_faces].astype(np.int32)
    return AdaptiveMesh(made, settled.bounds, depths, len(settled.plan.leaves))


@dataclass(frozen=True)
class _Settled:
    """What is drawn within the limit, and the proved distance of each of its F faces: (F,) float64. depths: (faces of
    the control mesh,) the level of the deepest leaf of each. positions: of the tree's vertices, in the mesh's space."""

    plan: TessellationPlan
    bounds: FloatArray
    depths: NDArray[np.int8]
    positions: VertexPositions


def _plan_within(mesh: PolygonMesh, request: AdaptiveRequest) -> Generator[int, None, _Settled]:
    """Plan until nothing that is drawn clashes."""
    least_levels = np.zeros(mesh.face_count, dtype=np.int8)
    while True:
        plan = Plan(mesh, request, least_levels)
        yield from _settle(plan)
        tree, leaves, depths = plan.tree, plan.leaves(), plan.face_levels()
        approximation, positions = plan.approximations.of(leaves), plan.positions
        # What else is known of the surface takes as much memory as the tree, and has served its turn.
        del plan
        found = plan_tessellation(tree, leaves, approximation, request.transitions)
        if not len(clashes := found.clashes):
            return _Settled(found, approximation.bounds[found.drawn], depths, positions)
        np.maximum.at(least_levels, tree.base_faces[clashes], tree.levels[clashes] + np.int8(1))


def _settle(plan: Plan) -> Generator[int, None, None]:
    """Find the whole tree: grow it, then split until every leaf fits beside its neighbours."""
    yield from grow(plan, (yield from approximate_new(plan, cells_of_faces(plan.tree.mesh))))
    if plan.request.mode is Mode.PER_FACE:
        yield from _level_faces(plan)
    while len(wanted := (yield from _unfinished(plan))):
        yield from _split(plan, wanted)


def _unfinished(plan: Plan) -> Generator[int, None, IndexArray]:
    """The leaves to split next: those out of balance, or else those that do not fit as their sides are, or else along
    the surface."""
    if len(wanted := unbalanced(plan)):
        return wanted
    if len(wanted := (yield from approximate_split_sides(plan))):
        return wanted
    return _evened(plan, (yield from bound_along_surface(plan)))


def _split(plan: Plan, wanted: IndexArray) -> Generator[int, None, None]:
    """Split the wanted leaves, and all that gets out of balance by that; and then their children, as it takes."""
    plan.refuse_too_many(len(wanted), plan.expected_leaves(wanted))
    parents: list[Cells] = []
    known = len(plan.tree.first_child)
    while len(wanted):
        # What is made meanwhile comes with its parents.
        parents += plan.cells.of(wanted[wanted < known])
        plan.split(wanted)
        wanted = unbalanced(plan)
    yield from grow(plan, (yield from approximate_children(plan, parents)))


def _level_faces(plan: Plan) -> Generator[int, None, None]:
    """Split every face of the control mesh to the level of its deepest leaf."""
    tree = plan.tree
    while True:
        leaves = tree.leaves()
        shallow = leaves[tree.levels[leaves] < plan.face_levels()[tree.base_faces[leaves]]]
        if not len(shallow):
            return
        yield from _split(plan, shallow)


def _evened(plan: Plan, wanted: IndexArray) -> IndexArray:
    """The leaves to split so that the wanted ones are; where faces are divided evenly, with a wanted leaf of the least
    level of its face go all others of this level."""
    if plan.request.mode is not Mode.PER_FACE or not len(wanted):
        return wanted
    tree, leaves = plan.tree, plan.tree.leaves()
    least = np.full(tree.mesh.face_count, np.iinfo(np.int8).max, dtype=np.int8)
    np.minimum.at(least, tree.base_faces[leaves], tree.levels[leaves])
    is_least = tree.levels == least[tree.base_faces]
    uneven = np.zeros(tree.mesh.face_count, dtype=bool)
    uneven[tree.base_faces[wanted[is_least[wanted]]]] = True
    return np.union1d(wanted, leaves[is_least[leaves] & uneven[tree.base_faces[leaves]]])
