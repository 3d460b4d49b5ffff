# SPDX-License-Identifier: GPL-3.0-or-later
"""Normals of the limit surface against differences between its points, and shapes whose normals are known."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.limit_normals import limit_normals
from ccdepth_addon.core.surface.surface_points import SurfacePoints
from tests import meshes
from tests.core.test_evaluation import build, every_mesh
from tests.core.test_face_depths import build as smooth
from tests.uniform import uniform_points

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
    found = at_vertex(subdivide(mesh).mesh, 4 * corners, 0.75)
    np.testing.assert_allclose(found, at_vertex(mesh, corners, 0.375), rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["cube", "cylinder", "triangles and quads", "trapezohedron", "bipyramid"])
def test_at_smooth_vertices_are_what_the_normals_around_close_in_on(name: str) -> None:
    """From every face at the vertex alike, though by another path: derivatives beside the vertex."""
    mesh = build(name)
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


def test_of_a_plane_are_square_to_it() -> None:
    for data in (meshes.grid(4, 3), meshes.creased(meshes.grid(4, 4), {(6, 7): 1.0, (7, 12): 0.5, (12, 13): 1.0})):
        mesh = smooth(data)
        normals = limit_normals(mesh, uniform_points(mesh, 2))
        np.testing.assert_allclose(normals, np.broadcast_to([0.0, 0.0, 1.0], normals.shape), rtol=0, atol=1e-9)


def test_of_a_cube_point_away_from_its_middle() -> None:
    mesh = smooth(meshes.cube())
    points = uniform_points(mesh, 3)
    positions = limit_values(mesh, mesh.positions, points)
    radial = positions / np.linalg.norm(positions, axis=1, keepdims=True)
    normals = limit_normals(mesh, points)
    assert np.einsum("ij,ij->i", normals, radial).min() > 0.9
    # By symmetry exactly so at the vertices.
    at_vertices = ~points.parameters.any(axis=1)
    np.testing.assert_allclose(normals[at_vertices], radial[at_vertices], rtol=0, atol=1e-14)


def test_at_creases_are_those_of_the_points_own_side() -> None:
    edges = {tuple(edge): 1.0 for edge in meshes.cube().edges.tolist()}
    mesh = smooth(meshes.creased(meshes.cube(), edges))
    points = uniform_points(mesh, 2)
    normals = limit_normals(mesh, points)
    faces = mesh.corner_faces[points.corners]
    centres = np.add.reduceat(mesh.positions[mesh.corner_vertices], mesh.face_starts[:-1]) / 4
    np.testing.assert_allclose(normals, centres[faces], rtol=0, atol=1e-12)


def test_of_faces_without_area_are_not_nan() -> None:
    data = meshes.grid(2, 2)
    for flat in (data.positions * np.array([1.0, 0.0, 0.0]), data.positions * 0.0):
        mesh = smooth(meshes.MeshData(flat, data.face_sizes, data.corner_vertices))
        normals = limit_normals(mesh, uniform_points(mesh, 2))
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=0, atol=1e-14)
