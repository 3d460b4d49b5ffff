# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive subdivision: a mesh of few faces that is within a tolerance of the limit surface.

The faces of the control mesh are the first leaves of a tree of rectangles. A leaf is split

1. while its triangles seem to miss the surface by more than the limit, across the direction of most bend;
2. where neighbours are more than one split ahead, or where split sides make more faces than a split does;
3. with angles, while the normals of the leaf are not proved to be within them (``leaf_angles``);
4. while no bound within the limit is proved for the leaf (``leaf_bounds``); then the leaves around are bounded again;
5. where edges clash, or are longer than allowed.
Bounds fall with the size of a leaf, and no split is undone, so splitting ends. Every leaf then has a proved bound, in
both directions between mesh and surface (docs/adaptive.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import lengths, units
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress, no_report
from .balance import cheaper_split, unbalanced
from .leaf_angles import beyond_angles, proved_angles
from .leaf_bounds import bounds_both_ways, unbounded
from .leaf_normals import leaf_normals
from .plan import Plan
from .rectangle_tree import QUARTERS
from .request import AdaptiveRequest, Mode
from .subdivided_mesh import SubdividedMesh
from .tessellation import TessellationPlan, at_corners, plan_tessellation, tessellate


@dataclass(frozen=True)
class AdaptiveMesh:
    """A tessellated mesh of F faces. bounds: (F,) float64, the proved distance of each face; ratios:
    (F,) float64, the largest ratio of a proved distance to the tolerance at the surface; depths: (F,) int32, the depth
    of each face's base face: the level of the deepest leaf there. leaf_count: the number of leaves of the tree.

    angles: (F,) float64, in radians: the proved angle of shading where that counts, otherwise of facets; 0 where none
    counts, as on leaves that are too narrow. normals: (C, 3) float64, the unit normals to store at corners of smooth
    faces, in the space of the result, or None without an angle of shading. narrow_count: the number of leaves with
    parts too narrow to count.
    """

    mesh: SubdividedMesh
    bounds: FloatArray
    ratios: FloatArray
    depths: NDArray[np.int32]
    leaf_count: int
    angles: FloatArray
    normals: FloatArray | None
    narrow_count: int


def count_faces(mesh: PolygonMesh, request: AdaptiveRequest, progress: Progress = no_report) -> int:
    """The number of faces that ``subdivide_adaptively`` makes.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``). progress: is told the number of leaves so far,
    and may raise to stop. Raises TooManyFacesError.
    """
    _, tessellation = plan_within(mesh, request, progress)
    return len(tessellation.drawn)


def subdivide_adaptively(
    mesh: PolygonMesh, request: AdaptiveRequest, positions: FloatArray, progress: Progress = no_report
) -> AdaptiveMesh:
    """The adaptive mesh within the limit of the request.

    mesh: its sharpness explicit (``catmull_clark.apply_boundary_rule``), in the space of the limit. positions: (V, 3)
    float64, of the same control mesh in the space of the result, whose axes are those of the request. progress: is told
    the number of leaves so far, and may raise to stop. Raises TooManyFacesError, and ToleranceError where a varied
    limit is below rounding.
    """
    plan, tessellation = plan_within(mesh, request, progress)
    leaves, drawn = tessellation.leaves, tessellation.drawn
    made = tessellate(tessellation, plan.positions.in_space_of(positions, tessellation.used))
    bounds, ratios = (each[drawn] for each in bounds_both_ways(plan, leaves))
    depths = plan.tree.face_levels()[made.base_faces].astype(np.int32)
    angles, is_narrow = proved_angles(plan, leaves)
    normals = _corner_normals(plan, tessellation) if request.shading else None
    narrow_count = int(np.count_nonzero(is_narrow))
    return AdaptiveMesh(made, bounds, ratios, depths, len(leaves), angles[drawn], normals, narrow_count)


def _corner_normals(plan: Plan, tessellation: TessellationPlan) -> FloatArray:
    """(C, 3): the unit normals to store at the corners of the mesh, in its space."""
    stored, axes = leaf_normals(plan, tessellation.leaves), plan.request.axes
    # Normals go by the inverse transpose; a mirrored object's faces are turned over.
    return units(at_corners(tessellation, stored) @ axes) * np.sign(np.linalg.det(axes))


def plan_within(mesh: PolygonMesh, request: AdaptiveRequest, progress: Progress) -> tuple[Plan, TessellationPlan]:
    """A plan with bounds within the limit for all leaves, and its tessellation without edges that clash or are too
    long."""
    plan = Plan(mesh, request, progress)
    leaves = np.arange(mesh.face_count)
    while len(missing := plan.approximate(leaves)):
        leaves = _split(plan, missing, plan.ways(missing))
    while True:
        while len((wanted := _unfinished(plan))[0]):
            _split(plan, *wanted)
        leaves = plan.leaves()
        tessellation = plan_tessellation(plan.tree, leaves, plan.approximation(leaves))
        if len(clashes := tessellation.clashes):
            _split(plan, clashes, np.full(len(clashes), QUARTERS))
        elif request.longest_edge and len(long := tessellation.at_edges(_are_too_long(plan, tessellation))):
            _split(plan, long, plan.ways_by_sides(long))
        else:
            return plan, tessellation


def _are_too_long(plan: Plan, tessellation: TessellationPlan) -> BoolArray:
    """(E,) bool: whether edges are longer than the request allows."""
    ends = plan.positions.of(tessellation.used)[tessellation.edges.vertices]
    found: BoolArray = lengths(ends[:, 1] - ends[:, 0]) > plan.request.longest_edge
    return found


def _unfinished(plan: Plan) -> tuple[IndexArray, IndexArray]:
    """The leaves to split next, and how to split them: leaves out of balance; if there are none, leaves that seem to
    miss more than the limit with their sides split; then leaves that make fewer faces when split; then leaves without a
    proved bound within the limit."""
    wanted, ways = unbalanced(plan)
    if len(wanted):
        return wanted, ways
    missing = plan.approximate_beside_split()
    if not len(missing):
        wanted, ways = cheaper_split(plan)
        if len(wanted):
            return wanted, ways
        if plan.request.has_angles:
            wanted, ways = beyond_angles(plan)
            if len(wanted):
                return wanted, ways
        failed = unbounded(plan)
        return failed, plan.ways_to_bounds(failed)
    return missing, plan.ways(missing)


def _split(plan: Plan, leaves: IndexArray, ways: IndexArray) -> IndexArray:
    """Split leaves, and in the mode PER_FACE all leaves of their faces. Returns the children."""
    if plan.request.mode is Mode.PER_FACE:
        tree, every = plan.tree, plan.tree.leaves()
        faces = mask(tree.mesh.face_count, tree.base_faces[leaves])
        leaves = every[faces[tree.base_faces[every]]]
        ways = np.full(len(leaves), QUARTERS)
    return plan.split(leaves, ways)
