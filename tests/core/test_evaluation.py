# SPDX-License-Identifier: GPL-3.0-or-later
"""The limit surface at given points against the limits of the vertices of refined meshes, which use no patches."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.evaluation import LARGEST_STENCIL_VALENCE, limit_values
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes
from tests.core.test_catmull_clark import MESHES, build, every_mesh, refined
from tests.thorough import combinations
from tests.uniform import uniform_points


def rounding(values: np.ndarray, levels: int) -> float:
    """A level adds some dozens of products, none larger than the largest value, each rounded to half a unit in its
    last place; they are bounded as if all erred the same way, the few steps to the limit counted as another level."""
    return 16 * (levels + 1) * np.finfo(np.float64).eps * np.abs(values).max()


def limits_of_descendants(mesh: PolygonMesh, levels: int) -> np.ndarray:
    """The limits of the corners of all faces after so many steps, by refining the whole mesh."""
    mesh = refined(mesh, levels)
    return limit_positions(mesh)[mesh.corner_vertices]


def assert_agrees(mesh: PolygonMesh, levels: int, factor: float = 1.0) -> None:
    """At the vertices of the mesh after so many steps; factor: how many times the rounding of a small face."""
    found = limit_values(mesh, mesh.positions, uniform_points(mesh, levels))
    atol = factor * rounding(mesh.positions, levels)
    np.testing.assert_allclose(found, limits_of_descendants(mesh, levels), rtol=0, atol=atol)


@pytest.mark.parametrize("smooth_corners", [True, False])
@every_mesh
def test_agrees_with_the_limits_of_refined_vertices(name: str, smooth_corners: bool) -> None:
    assert_agrees(build(name, smooth_corners=smooth_corners), 3)


@pytest.mark.parametrize("valence", [*range(2, 13), LARGEST_STENCIL_VALENCE, LARGEST_STENCIL_VALENCE + 1])
def test_agrees_around_every_valence(valence: int) -> None:
    assert_agrees(apply_boundary_rule(meshes.to_polygon_mesh(meshes.fan(valence)), smooth_corners=True), 3, valence)


def test_agrees_on_a_face_of_a_hundred_corners() -> None:
    assert_agrees(apply_boundary_rule(meshes.to_polygon_mesh(meshes.cylinder(100)), smooth_corners=True), 2, 100)


@pytest.mark.parametrize(
    ("name", "columns"), combinations(["cylinder", "creased cube", "dart", "landscape with random creases"], [1, 2, 6])
)
def test_carries_values_in_place_of_positions(name: str, columns: int) -> None:
    mesh = build(name)
    values = np.random.default_rng(columns).uniform(-1.0, 1.0, (mesh.vertex_count, columns))
    found = limit_values(mesh, values, uniform_points(mesh, 2))
    expected = limits_of_descendants(mesh.changed(positions=values), 2)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0, atol=rounding(values, 2))


@every_mesh
def test_points_in_any_order_and_number(name: str) -> None:
    mesh = build(name)
    points = uniform_points(mesh, 2)
    expected = limit_values(mesh, mesh.positions, points)
    order = np.random.default_rng(1).integers(0, len(expected), len(expected) // 2)
    found = limit_values(mesh, mesh.positions, points.at(order))
    np.testing.assert_allclose(found, expected[order], rtol=0, atol=rounding(mesh.positions, 2))
    assert limit_values(mesh, mesh.positions, points.at(slice(0, 0))).shape == (0, 3)


@every_mesh
def test_faces_agree_where_they_meet(name: str) -> None:
    """Both sides of an edge see the same points on it: twins run in opposite directions, half an edge to a quarter."""
    mesh = build(name)
    sides = np.flatnonzero(mesh.twin > np.arange(mesh.corner_count))
    for distance in (2.0**-20, 0.25, 0.375, 1.0):
        along = np.tile([distance, 0.0], (len(sides), 1))
        back = np.tile([0.0, distance], (len(sides), 1))
        one = limit_values(mesh, mesh.positions, SurfacePoints(sides, along))
        other = limit_values(mesh, mesh.positions, SurfacePoints(mesh.next_corner[mesh.twin[sides]], back))
        np.testing.assert_allclose(one, other, rtol=0, atol=rounding(mesh.positions, 20))


@given(
    name=st.sampled_from(sorted(MESHES)),
    corner=st.integers(0, 10**6),
    level=st.integers(1, 12),
    numerators=st.tuples(st.integers(0, 1 << 12), st.integers(0, 1 << 12)),
)
def test_a_point_is_where_its_child_has_it(name: str, corner: int, level: int, numerators: tuple[int, int]) -> None:
    """The same surface evaluated on the mesh after one step, where the kinds of patches differ."""
    mesh = build(name)
    corner %= mesh.corner_count
    u, v = (numerator % (1 << level) / (1 << level) for numerator in numerators)
    # In the child the quarter at its first corner holds what lies within half of its parameters.
    child = SurfacePoints(np.array([4 * corner]), np.array([[u, v]]))
    parent = SurfacePoints(np.array([corner]), np.array([[u / 2, v / 2]]))
    refined = subdivide(mesh).mesh
    np.testing.assert_allclose(
        limit_values(mesh, mesh.positions, parent),
        limit_values(refined, refined.positions, child),
        rtol=0,
        atol=rounding(mesh.positions, level),
    )


@every_mesh
def test_deep_points_close_in_on_the_limit_of_their_vertex(name: str) -> None:
    """No rule leaves more than 0.6546 of the distance to the limit after a step: the second eigenvalue of a ring's step
    is (6 + √20)/16 at most, for ever larger valences. Those of semi-sharp features, which last ten steps at most, leave
    no more than all."""
    mesh = build(name)
    corners = np.arange(mesh.corner_count)
    limits = np.repeat(limit_positions(mesh)[mesh.corner_vertices], 3, axis=0)
    size = np.ptp(mesh.positions, axis=0).max()
    started = time.process_time()
    # Three points as far from each vertex: along both sides and between.
    parameters = np.tile(np.ldexp([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], -30), (len(corners), 1))
    found = limit_values(mesh, mesh.positions, SurfacePoints(np.repeat(corners, 3), parameters))
    assert time.process_time() - started < 1.0
    assert np.abs(found - limits).max() < 10 * size * 0.6546**20
    at_vertices = limit_values(mesh, mesh.positions, SurfacePoints(corners, np.zeros((len(corners), 2))))
    np.testing.assert_allclose(at_vertices, limits[::3], rtol=0, atol=rounding(mesh.positions, 1))
