# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: the quadtree over a control mesh whose tessellation is within a tolerance of the surface.

Nodes are split while their own bounds exceed the tolerance; then wherever a neighbour is more than one level deeper;
then wherever no template for the split sides is within the tolerance; until nothing is left to split. Bounds fall with
the size of a leaf, and no split is undone, so this ends. Every piece of the tessellation has a proved bound
(``triangle_bounds``, ``polygon_bounds``, ``star_bounds``), in both directions between mesh and surface
(docs/adaptive.md).
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
    which is the level of the deepest leaf there. leaf_count: the number of leaves they tessellate."""

    mesh: SubdividedMesh
    bounds: FloatArray
    depths: NDArray[np.int32]
    leaf_count: int


def count_faces(mesh: PolygonMesh, request: AdaptiveRequest) -> Generator[int, None, int]:
    """The number of faces of the result, in steps: yields the number of leaves so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``). Raises TooManyFacesError.
    """
    settled = yield from _plan_within(mesh, request)
    return len(settled.bounds)


def subdivide_adaptively(
    mesh: PolygonMesh, request: AdaptiveRequest, positions: FloatArray
) -> Generator[int, None, AdaptiveMesh]:
    """The mesh within the limit, in steps: yields the number of leaves so far.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``), in the space of the limit. positions: (V, 3)
    float64, of the same control mesh in the space of the result, which has the axes of the request.
    Raises TooManyFacesError.
    """
    settled = yield from _plan_within(mesh, request)
    made = tessellate(settled.plan, settled.positions.in_space_of(positions, settled.plan.used))
    depths = settled.depths[made.base_faces].astype(np.int32)
    return AdaptiveMesh(made, settled.bounds, depths, len(settled.plan.leaves))


@dataclass(frozen=True)
class _Settled:
    """The tessellation plan, and the proved distance of each of its F faces: (F,) float64. depths: (faces of the
    control mesh,) the level of the deepest leaf of each. positions: of the tree's vertices, in the mesh's space."""

    plan: TessellationPlan
    bounds: FloatArray
    depths: NDArray[np.int8]
    positions: VertexPositions


def _plan_within(mesh: PolygonMesh, request: AdaptiveRequest) -> Generator[int, None, _Settled]:
    """Plan until no edges of the tessellation clash."""
    least_levels = np.zeros(mesh.face_count, dtype=np.int8)
    while True:
        plan = Plan(mesh, request, least_levels)
        yield from _settle(plan)
        tree, leaves, depths = plan.tree, plan.leaves(), plan.face_levels()
        approximation, positions = plan.approximations.of(leaves), plan.positions
        # The rest takes as much memory as the tree, and is no longer needed.
        del plan
        found = plan_tessellation(tree, leaves, approximation, request.transitions)
        if not len(clashes := found.clashes):
            return _Settled(found, approximation.bounds[found.drawn], depths, positions)
        np.maximum.at(least_levels, tree.base_faces[clashes], tree.levels[clashes] + np.int8(1))


def _settle(plan: Plan) -> Generator[int, None, None]:
    """Plan the whole tree: grow it, then split until every leaf is within the limit beside its neighbours."""
    yield from grow(plan, (yield from approximate_new(plan, cells_of_faces(plan.tree.mesh))))
    if plan.request.mode is Mode.PER_FACE:
        yield from _level_faces(plan)
    while len(wanted := (yield from _unfinished(plan))):
        yield from _split(plan, wanted)


def _unfinished(plan: Plan) -> Generator[int, None, IndexArray]:
    """The leaves to split next: those out of balance; if none, those that exceed the limit with their sides split; if
    none, those that exceed it along the surface."""
    if len(wanted := unbalanced(plan)):
        return wanted
    if len(wanted := (yield from approximate_split_sides(plan))):
        return wanted
    return _evened(plan, (yield from bound_along_surface(plan)))


def _split(plan: Plan, wanted: IndexArray) -> Generator[int, None, None]:
    """Split leaves, all that this leaves unbalanced, and then their children while these exceed the limit."""
    plan.refuse_too_many(len(wanted), plan.expected_leaves(wanted))
    parents: list[Cells] = []
    count = len(plan.tree.first_child)
    while len(wanted):
        # Nodes made in this loop have no cells yet; they come with their parents.
        parents += plan.cells.of(wanted[wanted < count])
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
    """The leaves to split along with the wanted ones: where faces are divided evenly, all leaves of the least level of
    a face if one of them is wanted."""
    if plan.request.mode is not Mode.PER_FACE or not len(wanted):
        return wanted
    tree, leaves = plan.tree, plan.tree.leaves()
    least = np.full(tree.mesh.face_count, np.iinfo(np.int8).max, dtype=np.int8)
    np.minimum.at(least, tree.base_faces[leaves], tree.levels[leaves])
    is_least = tree.levels == least[tree.base_faces]
    uneven = np.zeros(tree.mesh.face_count, dtype=bool)
    uneven[tree.base_faces[wanted[is_least[wanted]]]] = True
    return np.union1d(wanted, leaves[is_least[leaves] & uneven[tree.base_faces[leaves]]])
