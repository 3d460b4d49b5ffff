# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of a leaf's surface with its own drawn triangles, against dense samples of both, pair by pair."""

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.adaptive.leaf_angles import bound_angles
from ccdepth_addon.core.adaptive.leaf_bounds import bound_at_equal
from ccdepth_addon.core.adaptive.leaf_normals import leaf_normals
from ccdepth_addon.core.adaptive.plan import Plan
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import TRIANGLE_COUNTS, TRIANGLES, template_numbers
from ccdepth_addon.core.progress import no_report
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes
from tests.thorough import each

STEPS = 24


def uneven_sheet(seed: int) -> meshes.MeshData:
    """A sheet of one regular quad and the quads around, bent, with uneven spacing and bowed lines."""
    generator = np.random.default_rng(seed)
    power, bow, bend, across, twist = generator.uniform([0.6, -0.3, -0.5, -0.5, -0.3], [1.8, 0.3, 0.5, 0.5, 0.3])

    def change(x: NDArray, y: NDArray, z: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        u, v = x / 3, y / 3
        y = 3 * v + bow * 3 * u * (1 - u)
        return 3 * u**power, y, bend * (3 * u**power) ** 2 / 3 + across * y * y / 3 + twist * u * v

    return meshes.bent(meshes.grid(3, 3), change)


def surface_of(data: meshes.MeshData, face: int) -> tuple[NDArray, NDArray]:
    """(N, 3) twice: points of the surface over a quad, and its normals."""
    mesh = meshes.build(data)
    steps = np.linspace(0, 1, STEPS)
    quarters = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
    corners = np.repeat(mesh.face_starts[face] + np.arange(4), len(quarters))
    points = SurfacePoints(corners, np.tile(quarters, (4, 1)))
    return limit_values(mesh, mesh.positions, points), limit_normals(mesh, points)


@pytest.mark.parametrize("seed", each(range(300), range(12)))
def test_a_leaf_has_near_points_within_its_angle_both_ways(seed: int) -> None:
    data, face = uneven_sheet(seed), 4
    mesh = meshes.build(data)
    plan = Plan(mesh, AdaptiveRequest(0.15, Mode.ADAPTIVE, 1000, shading=1.2), no_report)
    leaves = np.array([face])
    plan.approximate(leaves)
    bound_at_equal(plan, leaves)
    bound_angles(plan, leaves)
    angle, reach = plan.shading.values[face], min(plan.paired.values[face], plan.request.reach)
    if not np.isfinite(angle):
        pytest.skip("there are no pairs")
    drawn, stored = drawn_of(plan, face)
    points, normals = surface_of(data, face)
    for one, own, other, theirs in ((points, normals, drawn, stored), (drawn, stored, points, normals)):
        distances = np.linalg.norm(one[:, None] - other, axis=2)
        cosines = np.where(distances <= reach + 3 / STEPS * np.sqrt(2), own @ theirs.T, -1.0).max(axis=1)
        # The nearest sample is half a step of the normals' whole turn away at most, in either direction.
        turn = np.linalg.norm(theirs - theirs.mean(axis=0), axis=1).max()
        assert np.arccos(np.clip(cosines, -1, 1)).max() <= angle + turn / STEPS


def drawn_of(plan: Plan, leaf: int) -> tuple[NDArray, NDArray]:
    """(N, 3) twice: points of the drawn triangles of a whole quad, and their interpolated normals."""
    tree, nodes = plan.tree, np.array([leaf])
    approximation = plan.approximation(nodes)
    number = int(template_numbers(approximation.patterns, approximation.alternatives)[0])
    positions = plan.positions.of(tree.slot_vertices[tree.slots(nodes)])
    normals = leaf_normals(plan, nodes)[0][0]
    weights = np.array([(i, j, STEPS - i - j) for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]) / STEPS
    triangles = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
    points, directions = (
        np.concatenate([weights @ each[corners] for corners in triangles]) for each in (positions, normals)
    )
    return points, directions / np.linalg.norm(directions, axis=1, keepdims=True)
