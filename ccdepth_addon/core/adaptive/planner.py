# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: the quadtree over a control mesh whose tessellation is within a tolerance of the surface.

Nodes are split while their own bounds exceed the tolerance; then wherever a neighbour is more than one level deeper;
then wherever no template for the split sides is within the tolerance; until nothing is left to split. Bounds fall with
the size of a leaf, and no split is undone, so this ends. Then quads are halved instead of quartered where that does
(``halves``). Every piece of the tessellation has a proved bound (``triangle_bounds``, ``polygon_bounds``,
``along_surface``), in both directions between mesh and surface (docs/adaptive.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress, no_report
from .along_surface import bound_along_surface, bounds_both_ways
from .balance import approximate_split_sides, unbalanced
from .cells.control_faces import cells_of_faces
from .growth import approximate_children, approximate_new, grow
from .halves import halve
from .leaf_approximation import Cells
from .plan import Plan
from .request import AdaptiveRequest, Mode
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


def count_faces(mesh: PolygonMesh, request: AdaptiveRequest, progress: Progress = no_report) -> int:
    """The number of faces of the result.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``). progress: is told the number of leaves so far,
    and may raise to stop. Raises TooManyFacesError.
    """
    settled = _plan_within(mesh, request, progress)
    return len(settled.bounds)


def subdivide_adaptively(
    mesh: PolygonMesh, request: AdaptiveRequest, positions: FloatArray, progress: Progress = no_report
) -> AdaptiveMesh:
    """The mesh within the limit.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``), in the space of the limit. positions: (V, 3)
    float64, of the same control mesh in the space of the result, which has the axes of the request.
    progress: is told the number of leaves so far, and may raise to stop. Raises TooManyFacesError.
    """
    settled = _plan_within(mesh, request, progress)
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


def _plan_within(mesh: PolygonMesh, request: AdaptiveRequest, progress: Progress) -> _Settled:
    """Plan until no edges of the tessellation clash."""
    least_levels = np.zeros(mesh.face_count, dtype=np.int8)
    while True:
        plan = Plan(mesh, request, least_levels, progress)
        _settle(plan)
        halve(plan)
        tree, leaves, depths = plan.tree, plan.leaves(), plan.face_levels()
        approximation, bounds, positions = (
            plan.approximations.of(leaves),
            bounds_both_ways(plan, leaves),
            plan.positions,
        )
        # The rest takes as much memory as the tree, and is no longer needed.
        del plan
        found = plan_tessellation(tree, leaves, approximation, request.transitions)
        if not len(clashes := found.clashes):
            return _Settled(found, bounds[found.drawn], depths, positions)
        np.maximum.at(least_levels, tree.base_faces[clashes], tree.levels[clashes] + np.int8(1))


def _settle(plan: Plan) -> None:
    """Plan the whole tree: grow it, then split until every leaf is within the limit beside its neighbours."""
    grow(plan, approximate_new(plan, cells_of_faces(plan.tree.mesh)))
    if plan.request.mode is Mode.PER_FACE:
        _level_faces(plan)
    while len(wanted := _unfinished(plan)):
        _split(plan, wanted)


def _unfinished(plan: Plan) -> IndexArray:
    """The leaves to split next: those out of balance; if none, those that exceed the limit with their sides split; if
    none, those that exceed it along the surface."""
    if len(wanted := unbalanced(plan)):
        return wanted
    if len(wanted := approximate_split_sides(plan)):
        return wanted
    return _evened(plan, bound_along_surface(plan))


def _split(plan: Plan, wanted: IndexArray) -> None:
    """Split leaves, all that this leaves unbalanced, and then their children while these exceed the limit."""
    plan.refuse_too_many(len(wanted), plan.expected_leaves(wanted))
    parents: list[Cells] = []
    count = len(plan.tree.first_child)
    while len(wanted):
        # Nodes made in this loop have no cells yet; they come with their parents.
        parents += plan.cells.of(wanted[wanted < count])
        plan.split(wanted)
        wanted = unbalanced(plan)
    grow(plan, approximate_children(plan, parents))


def _level_faces(plan: Plan) -> None:
    """Split every face of the control mesh to the level of its deepest leaf."""
    tree = plan.tree
    while True:
        leaves = tree.leaves()
        shallow = leaves[tree.levels[leaves] < plan.face_levels()[tree.base_faces[leaves]]]
        if not len(shallow):
            return
        _split(plan, shallow)


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
