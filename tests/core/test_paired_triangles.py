# SPDX-License-Identifier: GPL-3.0-or-later
"""Pairs of a leaf's surface with its own drawn triangles, against dense samples of both, pair by pair."""

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.adaptive.leaf_angles import bound_angles
from ccdepth_addon.core.adaptive.leaf_bounds import bound_at_equal
from ccdepth_addon.core.adaptive.leaf_normals import leaf_normals
from ccdepth_addon.core.adaptive.leaf_triangles import LeafTriangles
from ccdepth_addon.core.adaptive.paired_triangles import MeasuredPieces, PairedTriangles
from ccdepth_addon.core.adaptive.plan import Plan
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import COUNTS, QUAD_POINTS, TRIANGLE_COUNTS, TRIANGLES, template_numbers
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
    angle, reach = plan.shading.values[face], min(plan.paired.values[face], plan.reaches(leaves)[0])
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


@pytest.mark.parametrize("step", [1, 2])
def test_a_polygon_that_goes_round_twice_has_no_pairs(step: int) -> None:
    """All triangles of its fan face its normal, but lie over each other."""
    turns = 2 * np.pi * np.arange(5) / 5
    corners = np.stack([np.cos(turns), np.sin(turns), np.zeros(5)], axis=1)
    polygon = meshes.MeshData(corners, np.array([5]), step * np.arange(5) % 5)
    plan = Plan(meshes.build(polygon), AdaptiveRequest(10.0, Mode.ADAPTIVE, 1000, shading=1.2), no_report)
    leaves = np.array([0])
    plan.approximate(leaves)
    bound_at_equal(plan, leaves)
    bound_angles(plan, leaves)
    assert np.isfinite(plan.shading.values[0]) == np.isfinite(plan.paired.values[0]) == (step == 1)


def drawn_of(plan: Plan, leaf: int) -> tuple[NDArray, NDArray]:
    """(N, 3) twice: points of the drawn triangles of a whole quad, and their interpolated normals."""
    tree, nodes = plan.tree, np.array([leaf])
    approximation = plan.approximation(nodes)
    number = int(template_numbers(approximation.patterns, approximation.alternatives)[0])
    positions = plan.positions.of(tree.slot_vertices[tree.slots(nodes)])
    normals = leaf_normals(plan, nodes)[0]
    weights = np.array([(i, j, STEPS - i - j) for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]) / STEPS
    triangles = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
    points, directions = (
        np.concatenate([weights @ each[corners] for corners in triangles]) for each in (positions, normals)
    )
    return points, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def random_leaf(seed: int) -> PairedTriangles:
    """The triangles of a quad with a random template, uneven and bent, with any normals."""
    generator = np.random.default_rng(seed)
    pattern = int(generator.choice(np.flatnonzero(COUNTS)))
    number = int(template_numbers(np.array([pattern]), generator.integers(COUNTS[pattern], size=1))[0])
    vertices = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
    flat = QUAD_POINTS * generator.uniform(0.5, 2.0, 2) + generator.normal(0.0, 0.06, (8, 2))
    points = np.column_stack([flat, generator.normal(0.0, 0.15, 8)]) @ np.linalg.qr(generator.normal(size=(3, 3)))[0]
    around = np.cross(points[1] - points[0], points[3] - points[0])
    normals = around / np.linalg.norm(around) + generator.normal(0.0, 0.2, (8, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    count = len(vertices)
    triangles = LeafTriangles(np.arange(8), vertices, np.zeros(count, int), np.array([0, count]), np.zeros((0, 3)))
    request = AdaptiveRequest(1.0, Mode.ADAPTIVE, 1000)
    are_polygons = np.zeros(count, dtype=bool)
    return PairedTriangles.of(triangles, points[vertices], normals[vertices], are_polygons, request).along_common_axes()


@pytest.mark.parametrize("seed", each(range(2000), range(60)))
def test_pairing_along_an_axis_adds_what_normals_and_heights_change_on_the_way(seed: int) -> None:
    drawn, generator = random_leaf(seed), np.random.default_rng(seed)
    count = len(drawn.corners)
    measured = MeasuredPieces.none(drawn)
    measured.heights[:], measured.rests[:] = generator.uniform(0.0, [[0.1], [0.02]], (2, count))
    measured.over[:], measured.bows[:] = (
        generator.uniform(0.0, 0.2, (count, 3)),
        generator.uniform(0.0, 0.1, (2, count, 3)),
    )
    added, off = measured.pairs_along_axis()
    areas = np.cross(drawn.corners[:, 1] - drawn.corners[:, 0], drawn.corners[:, 2] - drawn.corners[:, 0])
    planes = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    axis = planes.sum(axis=0) / np.linalg.norm(planes.sum(axis=0))
    if not np.isfinite(off[0]) or (added[0] >= np.pi / 2).any():
        pytest.skip("there are no pairs")

    # Seen along the axis: places, and normals and heights as linear functions of these.
    across = np.linalg.svd(axis[None])[2][1:].T
    places = np.concatenate([drawn.corners @ across, np.ones((count, 3, 1))], axis=2)
    normals, heights = (np.linalg.solve(places, own) for own in (drawn.normals, drawn.corners @ axis[:, None]))
    on_sides = outer_sides(drawn.corners)
    bows = [np.hypot(*measured.bows[:, one, side]) for one, side in on_sides]
    reach = max(bows) + measured.rests.max()
    weights = np.array([(i, j, STEPS - i - j) for i in range(STEPS + 1) for j in range(STEPS + 1 - i)]) / STEPS
    for one in range(count):
        tilt = np.sqrt(1 / (planes[one] @ axis) ** 2 - 1)
        jumps, raised = 0.0, 0.0
        for other in range(count):
            # The surface over one triangle reaches so far beyond its sides.
            seen = weights @ places[other]
            beyond = -seen @ np.linalg.inv(places[one])
            high = np.abs(np.linalg.det(places[one])) / np.array([side_length(places[one], k) for k in range(3)])
            met = seen[(beyond * high <= measured.over[one] * high + reach).all(axis=1)]
            if len(met):
                jumps = max(jumps, np.linalg.norm(met @ (normals[one] - normals[other]), axis=1).max())
                raised = max(raised, np.abs(met @ (heights[one] - heights[other])).max())
            assert added[1, one] >= np.arccos(np.clip(planes[one] @ planes[other], -1, 1)) - 1e-7
        slides = max(
            slide(places[other], side, measured.bows[:, other, side], normals[one]) for other, side in on_sides
        )
        slides += np.linalg.norm(normals[one][:2], 2) * measured.rests.max()
        mean = drawn.normals[one].sum(axis=0)
        shortest = (drawn.normals[one] @ mean).min() / np.linalg.norm(mean)
        assert np.sin(added[0, one]) * shortest >= jumps + slides - 1e-9
        assert off[0] >= np.hypot(reach, measured.heights[one] + tilt * reach + raised) - 1e-9


def outer_sides(corners: NDArray) -> list[tuple[int, int]]:
    """The triangles and the corners opposite to sides that one triangle alone has, of triangles (M, 3, 3)."""
    sides = {(one, side): corners[one, [side - 2, side - 1]] for one in range(len(corners)) for side in range(3)}
    return [key for key, own in sides.items() if sum(np.allclose(own[::-1], each) for each in sides.values()) == 0]


def side_length(places: NDArray, side: int) -> float:
    return float(np.linalg.norm(places[side - 2, :2] - places[side - 1, :2]))


def slide(places: NDArray, side: int, bows: NDArray, normals: NDArray) -> float:
    """The most that linear normals change between a side of a triangle (3, 3) and points that are off by bows across
    and along the side."""
    along = (places[side - 1] - places[side - 2])[:2] / side_length(places, side)
    away = np.array([along[1], -along[0]])
    return max(float(np.linalg.norm((bows[0] * away + way * bows[1] * along) @ normals[:2])) for way in (-1, 1))
