# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds by feet against dense samples of whole surfaces, both ways, at several levels; and of single faces."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccdepth_addon.core.arrays.types import BoolArray, FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.distance.face_feet import FaceFeet
from ccdepth_addon.core.distance.foot_bounds import foot_bounds
from ccdepth_addon.core.distance.leaf_feet import leaf_feet
from ccdepth_addon.core.distance.middle_distances import middle_distances, rates_of
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, regular_nets
from tests import meshes, nets
from tests.brute_force import SQUARE
from tests.drawn_levels import largest_around, points_of, sampled
from tests.thorough import combinations
from tests.triangle_distances import point_to_triangles

# Levels that are compared.
LEVELS = 2

both_vertices = pytest.mark.parametrize("vertices", Vertices)


def uneven(data: meshes.MeshData) -> meshes.MeshData:
    """Some vertices far along the surface: faces thin beside wide ones."""
    x, y, _ = data.positions.T
    turn = 0.3 * np.sin(3 * np.arctan2(y, x))
    cosine, sine = np.cos(turn), np.sin(turn)
    return meshes.bent(data, lambda x, y, z: (cosine * x - sine * y, sine * x + cosine * y, z))


# Closed meshes of quads, all of them regular.
MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "even": lambda: meshes.torus(6, 4),
    "bumpy": lambda: meshes.bumpy(meshes.torus(5, 4), 0.1),
    "uneven": lambda: uneven(meshes.torus(6, 5)),
}


def smooth(data: meshes.MeshData, steps: int) -> PolygonMesh:
    return nets.refined(meshes.build(data), steps)


def by_component(net: FloatArray) -> FloatArray:
    """(16, 3, P) of nets (4, 4, P, 3)."""
    return np.moveaxis(net.reshape(16, -1, 3), 2, 1)


def bounds_of(mesh: PolygonMesh, vertices: Vertices, is_turned: BoolArray) -> list[FloatArray]:
    """(F,) of each level."""
    found = foot_bounds(by_component(regular_nets(mesh, np.arange(mesh.face_count))), vertices, is_turned)
    around = largest_around(mesh, found.curvature), largest_around(mesh, found.speed)
    return [found.at_level(level, *around) for level in range(LEVELS)]


def assert_both_ways(mesh: PolygonMesh, bounds: FloatArray, there: FloatArray, back: FloatArray, off: float) -> None:
    """No triangle is farther than the bound of its face, no part of the surface than the bounds around."""
    around = largest_around(mesh, bounds)
    assert np.all((there <= bounds + off) | np.isinf(bounds))
    assert np.all((back <= around + off) | np.isinf(around))


def assert_holds(mesh: PolygonMesh, vertices: Vertices, is_turned: BoolArray) -> list[FloatArray]:
    """At all levels; the parts of the bounds that are reached."""
    shares = []
    for level, bounds in enumerate(bounds_of(mesh, vertices, is_turned)):
        there, back, step = sampled(mesh, level, vertices, is_turned)
        # A level takes about three quarters off.
        assert_both_ways(mesh, bounds, there, back, step / 2)
        proved = np.isfinite(bounds)
        shares.append((there + step / 2)[proved] / bounds[proved])
    return shares


@pytest.mark.parametrize(("name", "vertices"), combinations(MESHES, Vertices))
def test_bounds_hold_both_ways_and_are_near_what_is_reached(name: str, vertices: Vertices) -> None:
    mesh = smooth(MESHES[name](), 2)
    shares = assert_holds(mesh, vertices, np.random.default_rng(1).random(mesh.face_count) < 0.3)
    # At level 1 nearly every face has a bound, and half of them are less than twice too large, or two and a half times.
    assert len(shares[1]) >= 0.9 * mesh.face_count
    assert np.median(shares[1]) > (0.5 if vertices is Vertices.LIMIT else 0.4)


@pytest.mark.parametrize(("name", "vertices"), combinations(MESHES, Vertices))
def test_parts_of_faces_hold_where_whole_faces_do_not_decide(name: str, vertices: Vertices) -> None:
    """At limits about what is reached, where parts are needed."""
    mesh = smooth(MESHES[name](), 2)
    every = np.arange(mesh.face_count)
    drawn = np.random.default_rng(2).random(len(every)) < 0.5
    feet = FaceFeet.of(mesh, vertices, drawn, lambda: None)
    whole, by_parts = bounds_of(mesh, vertices, drawn)[1], 0
    there, back, step = sampled(mesh, 1, vertices, drawn)
    for limit in np.quantile(there, np.linspace(0.1, 1.0, 10)):
        bounds = np.full(len(every), np.inf)
        for found in feet.bounds(every, 1, vertices, limit, lambda: None):
            bounds[found.faces] = np.where(found.bounds <= limit, found.bounds, np.inf)
            # What is said to be beyond the limit is no more than likely, but what is within it must not be.
            assert not np.any(found.is_open & (found.bounds <= limit))
        assert_both_ways(mesh, bounds, there, back, step / 2)
        by_parts += np.count_nonzero(np.isfinite(bounds) & (whole > limit))
    assert by_parts > 0.1 * len(every)


@both_vertices
def test_parts_are_tried_alike_wherever_the_surface_bends_to(vertices: Vertices) -> None:
    """Turned inside out, faces bend to the other side of their normals."""
    mesh = smooth(meshes.bumpy(meshes.torus(8, 6), 0.1, 3), 2)
    every, drawn = np.arange(mesh.face_count), np.zeros(mesh.face_count, dtype=bool)
    limit = float(np.median(bounds_of(mesh, vertices, drawn)[1])) / 1.5
    proved = np.zeros((2, mesh.face_count), dtype=bool)
    for own, positions in zip(proved, (mesh.positions, -mesh.positions), strict=True):
        feet = FaceFeet.of(mesh.changed(positions=positions), vertices, drawn, lambda: None)
        for found in feet.bounds(every, 1, vertices, limit, lambda: None):
            own[found.faces] = found.bounds <= limit
    assert np.any(proved)
    assert np.array_equal(*proved)


# Each samples a surface densely: so half as many as elsewhere.
@settings(max_examples=settings().max_examples // 2)
@given(seed=st.integers(0, 10_000), size=st.sampled_from([0.02, 0.1, 0.3, 1.0]), vertices=st.sampled_from([*Vertices]))
def test_bounds_hold_on_any_closed_surface(seed: int, size: float, vertices: Vertices) -> None:
    """Folded and self-intersecting ones as well."""
    mesh = smooth(meshes.bumpy(meshes.torus(5, 4), size, seed), 1)
    assert_holds(mesh, vertices, np.random.default_rng(seed).random(mesh.face_count) < 0.5)


GRID = np.stack(np.meshgrid(np.arange(-1.0, 3.0), np.arange(-1.0, 3.0), indexing="ij"), axis=-1)


def derivative(net: FloatArray, places: FloatArray, along_u: int, along_v: int) -> FloatArray:
    """(n, P, 3) of nets (4, 4, P, 3) at places (n, 2)."""
    along, across = (nets.spline_derivatives(each) for each in places.T)
    return np.einsum("in,jn,ijpd->npd", along[along_u], across[along_v], net)


def drawn(net: FloatArray, places: FloatArray, size: float, vertices: Vertices) -> FloatArray:
    """(n, P, 3): the vertices of a level whose leaves have this size, at places (n, 2)."""
    found = derivative(net, places, 0, 0)
    if vertices is Vertices.CONTROL:
        found = found - size**2 / 6 * (derivative(net, places, 2, 0) + derivative(net, places, 0, 2))
        found = found + size**4 / 36 * derivative(net, places, 2, 2)
    return found


def corners_of_triangles(level: int, turned: bool = False) -> FloatArray:
    """(T, 3, 2): where the triangles of a level over a face have their corners."""
    square = SQUARE[:, ::-1] * [1, -1] + [0, 1] if turned else SQUARE
    leaves = np.stack(np.meshgrid(*2 * [np.arange(2**level)]), axis=-1).reshape(-1, 1, 2)
    return (np.concatenate([square[[0, 1, 2]] + leaves, square[[0, 2, 3]] + leaves])) * 0.5**level


def errors(net: FloatArray, level: int, vertices: Vertices, turned: bool) -> FloatArray:
    """(n, P, 3): what a level's triangles are off the surface at equal parameters, all over the face."""
    weights, found = points_of(np.eye(3)[None], 8)[0], []
    for places in corners_of_triangles(level, turned):
        flat = np.einsum("sc,cpd->spd", weights, drawn(net, places, 0.5**level, vertices))
        found.append(flat - derivative(net, weights @ places, 0, 0))
    return np.concatenate(found)


def nets_of(kind: str, count: int, generator: np.random.Generator) -> FloatArray:
    """(4, 4, count, 3), in any position."""
    flat = np.broadcast_to(GRID[:, :, None], (4, 4, count, 2))
    u, v = np.moveaxis(flat, -1, 0)
    a, b, c = generator.normal(size=(3, count)) * 0.01
    heights = a * u * u + b * v * v + 2 * c * u * v
    if kind == "cubic":
        heights = heights + generator.normal(size=(4, 4, count)) * 0.01
    if kind in ("uneven", "bent"):
        moved = generator.normal(size=(4, 4, count, 2)) * 0.03 + 0.04 * flat**2 * generator.normal(size=(count, 2))
        flat = flat + moved
        heights = heights * (10.0 if kind == "bent" else 2.0)
    turned = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    return np.concatenate([flat, heights[..., None]], axis=-1) @ turned


@both_vertices
@pytest.mark.parametrize(("kind", "turned"), combinations(["quadratic", "cubic", "uneven", "bent"], [False, True]))
def test_constants_bound_what_samples_of_a_face_show(kind: str, turned: bool, vertices: Vertices) -> None:
    net = nets_of(kind, 100, np.random.default_rng(5))
    found = foot_bounds(by_component(net), vertices, np.full(100, turned))
    assert np.isfinite(found.curvature).mean() > 0.6
    places = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 7)]), axis=-1).reshape(-1, 2)
    along_u, along_v = derivative(net, places, 1, 0), derivative(net, places, 0, 1)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    jacobians = np.stack([along_u, along_v], axis=-1)
    # The unit's last digits are rounding.
    fastest = np.linalg.norm(np.linalg.pinv(jacobians), axis=-1).max(axis=(0, 2))
    assert np.all(fastest <= found.speed * (1 + 1e-9))
    second = [(normals * derivative(net, places, *each)).sum(axis=-1) for each in ((2, 0), (1, 1), (0, 2))]
    shapes = np.stack([second[0], second[1], second[1], second[2]], axis=-1).reshape(*second[0].shape, 2, 2)
    # In an orthonormal frame of the tangent plane.
    orthonormal = np.linalg.inv(np.linalg.qr(jacobians)[1])
    curvatures = np.abs(np.linalg.eigvalsh(orthonormal.swapaxes(-1, -2) @ shapes @ orthonormal)).max(axis=(0, 2))
    assert np.all(curvatures <= found.curvature * (1 + 1e-9))
    for level in range(3):
        size = 0.5**level
        # Of control points nothing tells which diagonal is drawn.
        diagonals = [turned] if vertices is Vertices.LIMIT else [False, True]
        off = np.concatenate([errors(net, level, vertices, each) for each in diagonals])
        assert np.all(np.linalg.norm(off, axis=-1).max(axis=0) <= found.reach * size**2 * (1 + 1e-9))
        along = np.abs(np.einsum("npd,qpd->nqp", off, normals)).max(axis=(0, 1))
        bounds = found.second * size**2 + found.fourth * size**4
        assert np.all(along <= bounds * (1 + 1e-9))
        if kind == "quadratic":
            # Nothing but second derivatives, which are the same everywhere: what is proved is there.
            np.testing.assert_allclose(along, bounds, rtol=0.02, atol=1e-9)


@both_vertices
@pytest.mark.parametrize("kind", ["quadratic", "cubic", "uneven", "bent"])
def test_bounds_of_a_leaf_are_hardly_more_than_samples_show(kind: str, vertices: Vertices) -> None:
    """κ and α are one number here, so that what they add is known."""
    net, curvature, longest = nets_of(kind, 300, np.random.default_rng(6)), 1e-3, 0.05
    constants = np.full(300, curvature), np.ones(300)
    bounds, short, reached = leaf_feet(by_component(net), vertices, *constants, longest)
    off = errors(net, 0, vertices, False)
    places = points_of(SQUARE[[[0, 1, 2], [0, 2, 3]]], 8).reshape(-1, 2)
    normals = np.cross(derivative(net, places, 1, 0), derivative(net, places, 0, 1))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    along, farthest = np.abs((off * normals).sum(axis=-1)).max(axis=0), np.linalg.norm(off, axis=-1).max(axis=0)
    expected = along + curvature * farthest**2
    proved = np.isfinite(bounds)
    assert proved.mean() > 0.9
    assert np.all(expected[proved] <= bounds[proved] * (1 + 1e-9))
    assert np.median(bounds[proved] / expected[proved]) < 1.1
    assert np.all(2 * farthest[np.isfinite(short)] <= longest)
    assert np.all(short[np.isfinite(short)] == bounds[np.isfinite(short)])
    # At some of the samples, in frames that are turned a little against the normals there.
    assert np.median(np.abs(reached - along) / along) < 0.1


@both_vertices
def test_planes_are_off_by_nothing_however_parameters_run(vertices: Vertices) -> None:
    grid = GRID.reshape(16, 2) + 1
    warped = grid + np.random.default_rng(3).uniform(-0.15, 0.15, (16, 2)) + 0.05 * grid**2
    turned = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    net = (np.column_stack([warped, np.zeros(16)]) @ turned).reshape(4, 4, 1, 3)
    found = foot_bounds(by_component(net), vertices, np.zeros(1, dtype=bool))
    for level in range(1, 4):
        assert found.at_level(level, found.curvature, found.speed)[0] < 1e-7
    # At level 0 the ways along the surface are too long for constants of second derivatives.
    assert leaf_feet(by_component(net), vertices, found.curvature, found.speed, 1.0)[0][0] < 1e-7


def test_nothing_is_proved_where_the_surface_has_no_tangent_plane() -> None:
    grid = np.concatenate([GRID, np.zeros((4, 4, 1))], axis=-1)
    collapsed, folded_in_the_middle, folded_beside_it = grid.copy(), grid.copy(), grid.copy()
    collapsed[:, :, 1] = 0.0
    folded_in_the_middle[2:] = grid[1::-1]
    folded_beside_it[3] = grid[0]
    net = np.stack([collapsed, folded_in_the_middle, folded_beside_it, 0 * grid], axis=2)
    found = foot_bounds(by_component(net), Vertices.LIMIT, np.zeros(4, dtype=bool))
    assert np.all(np.isinf(found.at_level(3, found.curvature, found.speed)))


@pytest.mark.parametrize("level", [1, 2])
def test_parts_are_bounded_along_the_diagonal_that_they_are_drawn_with(level: int) -> None:
    """z = k (x - y)² is even along one diagonal, and curved four times as much along the other as along the sides."""
    mesh = meshes.build(meshes.bent(meshes.grid(9, 9), lambda x, y, _: (x, y, 1e-4 * (x - y) ** 2)))
    along = mesh.positions[mesh.corner_vertices.reshape(-1, 4)]
    is_even = np.abs(along[:, 2, 2] - along[:, 0, 2]) < 1e-9
    drawn = np.arange(mesh.face_count) % 2 == 1
    # On the curved diagonal the chord is k (2s)² / 4 above the surface, on a side k s² / 4.
    side = 0.5**level
    reached = 1e-4 * side**2 * np.where(is_even == drawn, 1.0, 0.25)
    feet = FaceFeet.of(mesh, Vertices.LIMIT, drawn, lambda: None)
    inside = np.all(np.abs(along[:, :, :2].mean(axis=1) - mesh.positions[:, :2].mean(axis=0)) < 3.0, axis=1)
    assert np.count_nonzero(inside & (is_even == drawn)) > 5
    for limit in 1e-4 * side**2 * np.array([0.3, 0.5, 0.9, 1.1]):
        for found in feet.bounds(np.arange(mesh.face_count), level, Vertices.LIMIT, limit, lambda: None):
            proved = (found.bounds <= limit) & inside[found.faces]
            assert np.all(found.bounds[proved] >= 0.999 * reached[found.faces][proved])


@both_vertices
@pytest.mark.parametrize("kind", ["quadratic", "cubic", "uneven", "bent"])
def test_points_near_the_middle_are_as_far_from_a_level_over_their_face_as_said(kind: str, vertices: Vertices) -> None:
    net = nets_of(kind, 200, np.random.default_rng(8))
    rates = rates_of(net, 1.0)
    for level in range(3):
        size = 0.5**level
        places = np.array([[0.5, 0.5], [0.5, 0.0], [0.0, 0.5], [0.0, 0.0]]) * size + (0.5 if level else 0.0)
        points = derivative(net, places, 0, 0).reshape(-1, 3)
        corners = [drawn(net, each, size, vertices).swapaxes(0, 1) for each in corners_of_triangles(level)]
        off = np.min([point_to_triangles(points, np.tile(each, (4, 1, 1))) for each in corners], axis=0)
        found = middle_distances(net, rates, level, vertices)
        assert np.mean(found > 0) > 0.3
        # Where nothing is known of how far the level's points are apart.
        assert not np.any(middle_distances(net, 0 * rates, level, vertices))
        assert np.all(found <= off.reshape(4, -1).max(axis=0) * (1 + 1e-9))


def test_faces_beside_patches_of_other_kinds_have_no_feet() -> None:
    """Feet may go where nothing is known of the curvature."""
    mesh = meshes.build(meshes.grid(9, 9))
    middle = np.flatnonzero(mesh.edge_face_counts == 2)[mesh.edge_count // 2]
    sharpness = np.where(np.arange(mesh.edge_count) == middle, 0.5, mesh.edge_sharpness)
    mesh = mesh.changed(edge_sharpness=sharpness)
    patches = classify_patches(mesh)
    is_beside = largest_around(mesh, (patches.kinds == PatchKind.IRREGULAR).astype(float)) > 0
    feet = FaceFeet.of(mesh, Vertices.CONTROL, np.zeros(mesh.face_count, dtype=bool), lambda: None)
    inside = np.flatnonzero((patches.kinds == PatchKind.REGULAR) & patches.inside)
    np.testing.assert_array_equal(np.isfinite(feet.whole.curvature[feet.places[inside]]), ~is_beside[inside])
    assert 0 < np.count_nonzero(is_beside[inside]) < len(inside)


@both_vertices
@pytest.mark.parametrize("name", ["cube", "sphere"])
def test_bounds_hold_beside_extraordinary_faces(name: str, vertices: Vertices) -> None:
    """Every triangle is as near as its bound; the surface is where all faces around have bounds."""
    mesh = smooth(meshes.bumpy(meshes.cube() if name == "cube" else meshes.sphere(7, 4), 0.05, 4), 2)
    drawn = np.random.default_rng(5).random(mesh.face_count) < 0.5
    feet = FaceFeet.of(mesh, vertices, drawn, lambda: None)
    is_extraordinary = classify_patches(mesh).kinds == PatchKind.EXTRAORDINARY
    is_beside = (largest_around(mesh, is_extraordinary.astype(float)) > 0) & (feet.places >= 0)
    # Nearer to the extraordinary vertex the surface is curved more than any regular face around.
    regular = np.flatnonzero(feet.places >= 0)
    own = np.zeros(mesh.face_count)
    own[regular] = foot_bounds(by_component(regular_nets(mesh, regular)), vertices, drawn[regular]).curvature
    assert np.any((feet.whole.curvature[feet.places] > largest_around(mesh, own))[is_beside])
    bounds = np.full(mesh.face_count, np.inf)
    for found in feet.bounds(np.arange(mesh.face_count), 2, vertices, np.inf, lambda: None):
        bounds[found.faces] = found.bounds
    assert np.count_nonzero(np.isfinite(bounds) & is_beside) > 5
    there, back, step = sampled(mesh, 2, vertices, drawn)
    assert_both_ways(mesh, bounds, there, back, step / 2)
