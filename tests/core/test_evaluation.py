# SPDX-License-Identifier: GPL-3.0-or-later
"""Points and normals of the limit surface against limits of the vertices of refined meshes, which use no patches."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.new_vertices import limits_of_new_vertices
from ccdepth_addon.core.surface.stencils import LARGEST_STENCIL_VALENCE
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes, nets
from tests.core.test_catmull_clark import MESHES, build, every_mesh
from tests.meshes import build as smooth
from tests.thorough import combinations
from tests.uniform import uniform_points


def rounding(values: np.ndarray, levels: int) -> float:
    """A level adds some dozens of products, none larger than the largest value, each rounded to half a unit in its
    last place; they are bounded as if all erred the same way, the few steps to the limit counted as another level."""
    return 16 * (levels + 1) * np.finfo(np.float64).eps * np.abs(values).max()


def assert_agrees(mesh: PolygonMesh, levels: int, factor: float = 1.0) -> None:
    """At the vertices of the mesh after so many steps; factor: how many times the rounding of a small face."""
    found, fine = limit_values(mesh, mesh.positions, uniform_points(mesh, levels)), nets.refined(mesh, levels)
    expected, atol = limit_positions(fine)[fine.corner_vertices], factor * rounding(mesh.positions, levels)
    np.testing.assert_allclose(found, expected, rtol=0, atol=atol)


@pytest.mark.parametrize("smooth_corners", [True, False])
@every_mesh
def test_agrees_with_the_limits_of_refined_vertices(name: str, smooth_corners: bool) -> None:
    assert_agrees(build(name, smooth_corners=smooth_corners), 3)


@pytest.mark.parametrize("valence", [*range(2, 13), LARGEST_STENCIL_VALENCE, LARGEST_STENCIL_VALENCE + 1])
def test_agrees_around_every_valence(valence: int) -> None:
    assert_agrees(meshes.build(meshes.fan(valence)), 3, valence)


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
    refined = subdivide(mesh)
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


# A step short enough for second derivatives to be worth 1e-5, and long enough for rounding to be worth less.
STEP = 2.0**-18
BY_DIFFERENCES = 1e-4


def normals_by_differences(mesh: PolygonMesh, points: SurfacePoints) -> np.ndarray:
    """From the central differences of the limit surface at parameters inside quarters."""

    def at(u: float, v: float) -> np.ndarray:
        moved = SurfacePoints(points.corners, points.parameters + np.array([u, v]))
        return limit_values(mesh, mesh.positions, moved)

    normals = np.cross(at(STEP, 0) - at(-STEP, 0), at(0, STEP) - at(0, -STEP))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def at_vertex(mesh: PolygonMesh, corners: np.ndarray, away: float = 0.0) -> np.ndarray:
    """The normals at these corners, or so far from them inside their faces."""
    return limit_normals(mesh, SurfacePoints(corners, np.full((len(corners), 2), away)))


@every_mesh
def test_have_unit_length_are_square_to_the_surface_and_stay_the_same(name: str) -> None:
    """From level to level inside faces, where a step changes which path leads to them."""
    mesh = build(name)
    lengths = np.linalg.norm(limit_normals(mesh, uniform_points(mesh, 2)), axis=1)
    np.testing.assert_allclose(lengths, 1.0, rtol=0, atol=1e-14)
    corners = np.arange(mesh.corner_count)
    points = SurfacePoints(corners, np.random.default_rng(1).integers(16, 1008, (len(corners), 2)) / 1024)
    expected = normals_by_differences(mesh, points)
    np.testing.assert_allclose(limit_normals(mesh, points), expected, rtol=0, atol=BY_DIFFERENCES)
    found = at_vertex(subdivide(mesh), 4 * corners, 0.75)
    np.testing.assert_allclose(found, at_vertex(mesh, corners, 0.375), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["cube", "cylinder", "triangles and quads", "trapezohedron", "bipyramid"])
def test_at_smooth_vertices_are_what_the_normals_around_close_in_on(name: str) -> None:
    """From every face at the vertex alike, though by another path: derivatives beside the vertex. After a step faces
    have no more than one extraordinary vertex."""
    for mesh in (build(name), subdivide(build(name))):
        corners = np.arange(mesh.corner_count)
        here, beside = at_vertex(mesh, corners), at_vertex(mesh, corners, 2.0**-30)
        # Normals differ by the ratio of the eigenvalues of bending and of the tangents, 0.25 / 0.41 at least or, for
        # valence 7, 0.45 / 0.5985, to the power of the levels.
        np.testing.assert_allclose(here, beside, rtol=0, atol=10 * (0.45 / 0.5985) ** 30)


@pytest.mark.parametrize("valence", [2, 3, 5, 6, 8, 12, 65])
def test_agree_between_the_faces_of_a_smooth_vertex_and_are_square_to_a_plane(valence: int) -> None:
    data = meshes.fan(valence, 3)
    mesh = smooth(data)
    corners = np.flatnonzero(mesh.corner_vertices == 0)
    normals = at_vertex(mesh, corners)
    # At valence 2 the surface has no normal.
    if valence > 2:
        np.testing.assert_allclose(normals, np.broadcast_to(normals[:1], normals.shape), rtol=0, atol=1e-12)
        assert normals[0, 2] > 0.5
    flat = mesh.changed(positions=data.positions * [1.0, 1.0, 0.0])
    np.testing.assert_array_equal(at_vertex(flat, corners), np.broadcast_to([0.0, 0.0, 1.0], normals.shape))


# The valence, the sharp spokes, and how far the normal 20 levels down may be from the one at the vertex. What is left
# of bending there shrinks by a factor of some 0.7 a level or more; but only as one part in the number of levels where
# eigenvalues coincide; and several faces between the edges of a fixed vertex have different normals anyway.
SHARP_EDGES = {
    "dart": (5, [0], 10 * 0.7**20),
    "dart of valence 4": (4, [0], 10 * 0.7**20),
    "crease between three faces and two": (5, [0, 2], 10 * 0.7**20),
    "crease between three and three": (6, [0, 3], 10 * 0.7**20),
    "crease beside a single face": (4, [0, 1], 3 / 20),
    "fixed between two, two and one": (5, [0, 2, 4], 3 / 20),
    "fixed between three, one and one": (5, [0, 3, 4], 0.2),
}


@pytest.mark.parametrize("case", SHARP_EDGES)
def test_at_sharp_edges_are_what_the_normals_in_the_face_close_in_on(case: str) -> None:
    valence, spokes, tolerance = SHARP_EDGES[case]
    data = meshes.fan(valence, 3)
    around = sorted(
        {int(vertex) for edge in data.edges if 0 in edge for vertex in edge if vertex},
        key=lambda vertex: float(np.arctan2(*data.positions[vertex, 1::-1])) % (2 * np.pi),
    )
    mesh = smooth(meshes.creased(data, {(0, around[spoke]): 1.0 for spoke in spokes}))
    corners = np.flatnonzero(mesh.corner_vertices == 0)
    np.testing.assert_allclose(at_vertex(mesh, corners), at_vertex(mesh, corners, 2.0**-20), rtol=0, atol=tolerance)


def test_of_faces_without_area_are_not_nan() -> None:
    data = meshes.grid(2, 2)
    for flat in (data.positions * np.array([1.0, 0.0, 0.0]), data.positions * 0.0):
        mesh = smooth(meshes.MeshData(flat, data.face_sizes, data.corner_vertices))
        normals = limit_normals(mesh, uniform_points(mesh, 2))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=0, atol=1e-14)


# Sums of some twenty terms in double precision, of coordinates up to about 10.
ROUNDING = 1e-13


@pytest.mark.parametrize(("seed", "smooth_corners"), combinations(range(6), [True, False]))
def test_limits_from_rings_are_those_by_refinement(seed: int, smooth_corners: bool) -> None:
    data = meshes.with_random_creases(meshes.landscape(9, 8, seed=seed), seed=seed, share=0.1 * (seed + 1))
    mesh = meshes.build(data, smooth_corners=smooth_corners)
    for _ in range(3):
        mesh = subdivide(mesh)
        expected = limit_positions(mesh)[mesh.corner_vertices].reshape(-1, 4, 3)[:, 1:]
        np.testing.assert_allclose(limits_of_new_vertices(mesh, mesh.face_count), expected, rtol=0, atol=ROUNDING)
