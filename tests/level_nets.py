# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes of which a face is within a tolerance at level 0 and beyond it at a later level, found by linear programming.

Heights of the vertices over a plain mesh are what is looked for: the distances of facets from the surface at given
parameters are linear in them. The face's distances at level 0, and if wanted those of all others at the later level,
are kept within the tolerance at many places, and its distance at one place at the later level is made as large as that
allows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.brute_force import Levels, linear_children

# Places are so many levels below the facets; between them the distance at level 0 may be a little larger than at them.
DEEPER = 2
ROOM = 0.92

# How many places of the face are tried.
GOALS = 6

# Heights are kept within this, in parts of the tolerance.
HIGHEST = 1e4


def worse_later(
    data: meshes.MeshData, face: int, vertices: str, tolerance: float, level: int, *, others_near: bool
) -> meshes.MeshData:
    """The mesh with heights along z such that the face is as far off at that level as it can be.

    others_near: whether all other faces are to be within the tolerance there.
    """
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=False)
    before, after = (_distances(mesh, at, vertices) for at in (0, level))
    others = np.delete(after, face, axis=0).reshape(-1, after.shape[-1])[: None if others_near else 0]
    # Places that several facets share are the same but for rounding.
    rows = np.unique(np.round(np.concatenate([before[face], others]), 12), axis=0)
    goals = np.unique(np.round(after[face], 12), axis=0)
    best, heights = 0.0, np.zeros(mesh.vertex_count)
    # Those that depend on the heights most are the most promising.
    for goal in goals[np.argsort(-np.abs(goals).sum(axis=1))][:GOALS]:
        found = linprog(
            -goal,
            A_ub=np.concatenate([rows, -rows]),
            b_ub=np.full(2 * len(rows), ROOM * tolerance),
            bounds=(-HIGHEST * tolerance, HIGHEST * tolerance),
        )
        assert found.status == 0
        if -found.fun > best:
            best, heights = -found.fun, found.x
    flat = data.positions * [1.0, 1.0, 0.0]
    return replace(data, positions=flat + heights[:, None] * [0.0, 0.0, 1.0])


def _distances(mesh: PolygonMesh, level: int, vertices: str) -> FloatArray:
    """(F, places, V): Lᵏ - S at places in each face, as functionals of one coordinate of the vertices."""
    levels = Levels(mesh.changed(positions=np.eye(mesh.vertex_count)))
    corners, fine = levels.mesh(level), levels.mesh(level + DEEPER)
    points = corners.positions if vertices == "CONTROL" else limit_positions(corners)
    values = points[corners.corner_vertices]
    for finer in range(level, level + DEEPER):
        values = linear_children(levels.mesh(finer), values)
    gaps = values - limit_positions(fine)[fine.corner_vertices]
    return gaps.reshape(mesh.face_count, -1, mesh.vertex_count)


# Largest values of functionals


# What HiGHS leaves unsatisfied of a constraint, relative to coefficients of about 1.
PROGRAM_TOLERANCE = 1e-7

# How far functionals may be from what the differences make of them, by rounding.
ROUNDING = 1e-9


def worst_of(functionals: FloatArray, differences: FloatArray) -> tuple[float, FloatArray]:
    """The largest value over many functionals, (…, D), and a net that has it.

    Least squares gives weights y with Dᵀy = c, and Σ|y| is at least the largest c·V: once it is below the largest value
    found so far, that row and all the following need no program.
    """
    rows = functionals.reshape(-1, functionals.shape[-1])
    rows = rows[np.abs(rows).max(axis=1) > 1e-12]
    # Functionals that are the same but for rounding are solved once.
    rows = rows[np.unique(np.round(rows, 12), axis=0, return_index=True)[1]]
    weights = rows @ np.linalg.pinv(differences.T, rcond=1e-10).T
    size = max(1.0, np.abs(rows).max(initial=0.0))
    assert np.all(np.abs(weights @ differences - rows) <= ROUNDING * size), "not made of the differences"
    most = np.abs(weights).sum(axis=1)
    both_signs = np.vstack([differences, -differences])
    found, net = 0.0, np.zeros(rows.shape[1])
    for row in np.argsort(-most):
        if most[row] <= found:
            break
        scale = np.abs(rows[row]).max()
        solution = linprog(-rows[row] / scale, A_ub=both_signs, b_ub=np.ones(len(both_signs)), bounds=(None, None))
        assert solution.status == 0, "the functional is not made of the differences"
        if -scale * solution.fun > found:
            found, net = -scale * solution.fun, solution.x
    return found, net


def largest_of(functionals: FloatArray, differences: FloatArray) -> float:
    """The largest value over many functionals, (…, D)."""
    return worst_of(functionals, differences)[0]
