# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds by feet against dense samples of whole surfaces, both ways, at several levels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.distance.face_feet import FaceFeet
from ccdepth_addon.core.distance.foot_bounds import foot_bounds
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import regular_nets
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.brute_force import linear_children
from tests.triangle_distances import distances

# Levels that are compared, and how many levels deeper the surface is sampled.
LEVELS, DEEPER = 2, 2

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


class Surface:
    """A closed mesh of quads, all regular, after some steps, and its levels."""

    def __init__(self, data: meshes.MeshData, steps: int) -> None:
        self.mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
        for _ in range(steps):
            self.mesh = subdivide(self.mesh).mesh
        self.levels = [self.mesh]
        self.parameters = [np.tile(SQUARE, (self.mesh.face_count, 1))]
        for _ in range(LEVELS + DEEPER):
            self.parameters.append(linear_children(self.levels[-1], self.parameters[-1]))
            self.levels.append(subdivide(self.levels[-1]).mesh)

    def drawn(self, level: int, vertices: Vertices, is_turned: np.ndarray) -> tuple[FloatArray, IndexArray, IndexArray]:
        """Positions, (T, 3) triangles, and (T,) the face each belongs to."""
        mesh = self.levels[level]
        quads, parameters = mesh.corner_vertices.reshape(-1, 4), self.parameters[level].reshape(-1, 4, 2)
        owners = np.arange(len(quads)) // 4**level
        # From the corner whose diagonal runs the right way in the face.
        rises = ((parameters[:, 2] - parameters[:, 0]).prod(axis=1) > 0) != is_turned[owners]
        quads = np.where(rises[:, None], quads, np.roll(quads, -1, axis=1))
        triangles = quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        positions = mesh.positions if vertices is Vertices.CONTROL else limit_positions(mesh)
        return positions, triangles, np.repeat(owners, 2)

    def touching(self, values: FloatArray) -> FloatArray:
        """(F,): the largest of each face and of those that share a vertex with it."""
        at_vertices = np.full(self.mesh.vertex_count, -np.inf)
        corners = self.mesh.corner_vertices.reshape(-1, 4)
        for column in corners.T:
            np.maximum.at(at_vertices, column, values)
        return at_vertices[corners].max(axis=1)

    def bounds(self, vertices: Vertices, is_turned: np.ndarray) -> list[FloatArray]:
        """(F,) of each level."""
        faces = np.arange(self.mesh.face_count)
        found = foot_bounds(regular_nets(self.mesh, faces), vertices, is_turned)
        around = self.touching(found.curvature), self.touching(found.speed)
        return [found.at(level, *around) for level in range(LEVELS)]


def largest(owners: IndexArray, values: FloatArray, count: int) -> FloatArray:
    found = np.zeros(count)
    np.maximum.at(found, owners, values)
    return found


def inside(positions: FloatArray, triangles: IndexArray, steps: int = 4) -> FloatArray:
    """(T, n, 3): points all over the triangles."""
    i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1))
    weights = np.stack([i, j, steps - i - j], axis=-1)[i + j <= steps] / steps
    return np.einsum("sc,tci->tsi", weights, positions[triangles])


def sampled(
    surface: Surface, level: int, vertices: Vertices, is_turned: np.ndarray
) -> tuple[FloatArray, FloatArray, float]:
    """(F,) how far the triangles of each face are from the surface, (F,) the other way, and how far the fine triangles
    that stand for the surface may be off it."""
    count = surface.mesh.face_count
    never = np.zeros(count, dtype=bool)
    fine, fine_triangles, _ = surface.drawn(level + DEEPER, Vertices.LIMIT, never)
    coarse, coarse_triangles, _ = surface.drawn(level + DEEPER - 1, Vertices.LIMIT, never)
    # A level takes about three quarters off.
    off = float(distances(fine, coarse, coarse_triangles).max()) / 2
    positions, triangles, owners = surface.drawn(level, vertices, is_turned)
    points = inside(positions, triangles)
    to_surface = distances(points.reshape(-1, 3), fine, fine_triangles).reshape(len(points), -1).max(axis=1)
    of_faces = surface.levels[level + DEEPER].corner_vertices
    to_mesh = distances(fine, positions, triangles)[of_faces]
    return (
        largest(owners, to_surface, count),
        largest(np.arange(len(of_faces)) // 4 ** (level + DEEPER + 1), to_mesh, count),
        off,
    )


def assert_holds(surface: Surface, vertices: Vertices, is_turned: np.ndarray) -> list[FloatArray]:
    """Both ways, at all levels; the parts of the bounds that are reached."""
    shares = []
    for level, bounds in enumerate(surface.bounds(vertices, is_turned)):
        to_surface, to_mesh, off = sampled(surface, level, vertices, is_turned)
        proved = np.isfinite(bounds)
        assert np.all(to_surface[proved] <= bounds[proved] + off)
        around = surface.touching(bounds)
        known = np.isfinite(around)
        assert np.all(to_mesh[known] <= around[known] + off)
        shares.append((to_surface + off)[proved] / bounds[proved])
    return shares


MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "even": lambda: meshes.torus(6, 4),
    "bumpy": lambda: meshes.bumpy(meshes.torus(5, 4), 0.1),
    "uneven": lambda: uneven(meshes.torus(6, 5)),
}


def uneven(data: meshes.MeshData) -> meshes.MeshData:
    """Some vertices far along the surface: faces thin beside wide ones."""
    angles = np.arctan2(data.positions[:, 1], data.positions[:, 0])
    turn = 0.3 * np.sin(3 * angles)
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y, z = data.positions.T
    return replace(data, positions=np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=1))


@pytest.mark.parametrize("vertices", Vertices)
@pytest.mark.parametrize("name", MESHES)
def test_bounds_hold_both_ways_and_are_near_what_is_reached(name: str, vertices: Vertices) -> None:
    surface = Surface(MESHES[name](), 2)
    is_turned = np.random.default_rng(1).random(surface.mesh.face_count) < 0.3
    shares = assert_holds(surface, vertices, is_turned)
    # At level 1 nearly every face has a bound, and half of them are less than twice too large, or two and a half times.
    assert len(shares[1]) >= 0.9 * surface.mesh.face_count
    assert np.median(shares[1]) > (0.5 if vertices is Vertices.LIMIT else 0.4)


@pytest.mark.parametrize("vertices", Vertices)
@pytest.mark.parametrize("name", MESHES)
def test_parts_of_faces_hold_where_whole_faces_do_not_decide(name: str, vertices: Vertices) -> None:
    """Both ways, at limits about what is reached, where parts are needed."""
    surface = Surface(MESHES[name](), 2)
    every = np.arange(surface.mesh.face_count)
    drawn = np.random.default_rng(2).random(len(every)) < 0.5
    feet = FaceFeet.of(surface.mesh, vertices, drawn, lambda: None)
    whole = surface.bounds(vertices, drawn)[1]
    reached = np.zeros((2, len(every)))
    for is_turned in (drawn, ~drawn)[: 1 if vertices is Vertices.LIMIT else 2]:
        to_surface, to_mesh, off = sampled(surface, 1, vertices, is_turned)
        reached = np.maximum(reached, [to_surface, to_mesh])
    by_parts = 0
    for limit in np.quantile(reached[0], np.linspace(0.1, 1.0, 10)):
        bounds = np.full(len(every), np.inf)
        for found in feet.bounds(every, 1, vertices, limit, lambda: None):
            bounds[found.faces] = np.where(found.bounds <= limit, found.bounds, np.inf)
            # What is said to be beyond the limit is no more than likely, but what is within it must not be.
            assert not np.any(found.is_open & (found.bounds <= limit))
        proved, around = np.isfinite(bounds), surface.touching(bounds)
        assert np.all(reached[0][proved] <= bounds[proved] + off)
        known = np.isfinite(around)
        assert np.all(reached[1][known] <= around[known] + off)
        by_parts += np.count_nonzero(proved & (whole > limit))
    assert by_parts > 0.1 * len(every)


@given(
    seed=st.integers(0, 10_000),
    size=st.sampled_from([0.02, 0.1, 0.3, 1.0]),
    vertices=st.sampled_from(list(Vertices)),
)
def test_bounds_hold_on_any_closed_surface(seed: int, size: float, vertices: Vertices) -> None:
    """Folded and self-intersecting ones as well."""
    surface = Surface(meshes.bumpy(meshes.torus(5, 4), size, seed), 1)
    assert_holds(surface, vertices, np.random.default_rng(seed).random(surface.mesh.face_count) < 0.5)


# Constants of single faces


GRID = np.stack(np.meshgrid(np.arange(-1.0, 3.0), np.arange(-1.0, 3.0), indexing="ij"), axis=-1)


def basis(t: FloatArray) -> list[FloatArray]:
    """(4, n) each: values, first and second derivatives of the uniform cubic B-splines over [0, 1]."""
    values = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    slopes = np.stack([-3 * (1 - t) ** 2, 9 * t**2 - 12 * t, -9 * t**2 + 6 * t + 3, 3 * t**2]) / 6
    return [values, slopes, np.stack([1 - t, 3 * t - 2, 1 - 3 * t, t])]


def derivative(nets: FloatArray, places: FloatArray, along_u: int, along_v: int) -> FloatArray:
    """(n, P, 3) of nets (4, 4, P, 3) at places (n, 2)."""
    return np.einsum("in,jn,ijpd->npd", basis(places[:, 0])[along_u], basis(places[:, 1])[along_v], nets)


def errors(nets: FloatArray, level: int, vertices: Vertices, turned: bool) -> FloatArray:
    """(n, P, 3): what a level's triangles are off the surface at equal parameters, all over the face."""
    size, found = 0.5**level, []
    corners = SQUARE[:, ::-1] * [1, -1] + [0, 1] if turned else SQUARE
    i, j = np.meshgrid(np.arange(9), np.arange(9))
    weights = np.stack([i, j, 8 - i - j], axis=-1)[i + j <= 8] / 8
    for left in np.arange(2**level):
        for low in np.arange(2**level):
            for triangle in ([0, 1, 2], [0, 2, 3]):
                places = (corners[triangle] + [left, low]) * size
                drawn = derivative(nets, places, 0, 0)
                if vertices is Vertices.CONTROL:
                    drawn = drawn - size**2 / 6 * (derivative(nets, places, 2, 0) + derivative(nets, places, 0, 2))
                    drawn = drawn + size**4 / 36 * derivative(nets, places, 2, 2)
                inner = weights @ places
                found.append(np.einsum("sc,cpd->spd", weights, drawn) - derivative(nets, inner, 0, 0))
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
        flat = (
            flat + generator.normal(size=(4, 4, count, 2)) * 0.03 + 0.04 * flat**2 * generator.normal(size=(count, 2))
        )
        heights = heights * (10.0 if kind == "bent" else 2.0)
    turned = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    return np.concatenate([flat, heights[..., None]], axis=-1) @ turned


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("vertices", Vertices)
@pytest.mark.parametrize("kind", ["quadratic", "cubic", "uneven", "bent"])
def test_constants_bound_what_samples_of_a_face_show(kind: str, vertices: Vertices, turned: bool) -> None:
    nets = nets_of(kind, 300, np.random.default_rng(5))
    found = foot_bounds(nets, vertices, np.full(300, turned))
    proved = np.isfinite(found.curvature)
    assert proved.mean() > 0.6
    places = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 7)]), axis=-1).reshape(-1, 2)
    along_u, along_v = derivative(nets, places, 1, 0), derivative(nets, places, 0, 1)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    jacobians = np.stack([along_u, along_v], axis=-1)
    inverses = np.linalg.pinv(jacobians)
    # The unit's last digits are rounding.
    assert np.all(np.linalg.norm(inverses, axis=-1).max(axis=(0, 2)) <= found.speed * (1 + 1e-9))
    second = [(normals * derivative(nets, places, *each)).sum(axis=-1) for each in ((2, 0), (1, 1), (0, 2))]
    shapes = np.stack([second[0], second[1], second[1], second[2]], axis=-1).reshape(*second[0].shape, 2, 2)
    # In an orthonormal frame of the tangent plane.
    orthonormal = np.linalg.inv(np.linalg.qr(jacobians)[1])
    curvatures = np.abs(np.linalg.eigvalsh(orthonormal.swapaxes(-1, -2) @ shapes @ orthonormal)).max(axis=(0, 2))
    assert np.all(curvatures <= found.curvature * (1 + 1e-9))
    for level in range(3):
        off = errors(nets, level, vertices, turned)
        size = 0.5**level
        assert np.all(np.linalg.norm(off, axis=-1).max(axis=0) <= found.reach * size**2 * (1 + 1e-9))
        along = np.abs(np.einsum("npd,qpd->nqp", off, normals)).max(axis=(0, 1))
        slow = found.plain * size**2 + found.fourth * size**4
        fast = found.second * size**2 + found.third * size**3 + found.fourth * size**4
        assert np.all(along <= np.minimum(slow, fast) * (1 + 1e-9))
        if kind == "quadratic":
            # Nothing but second derivatives, which are the same everywhere: what is proved is there.
            np.testing.assert_allclose(along, np.minimum(slow, fast), rtol=0.02, atol=1e-9)


@pytest.mark.parametrize("vertices", Vertices)
def test_planes_are_off_by_nothing_however_parameters_run(vertices: Vertices) -> None:
    grid = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(16, 2)
    warped = grid + np.random.default_rng(3).uniform(-0.15, 0.15, (16, 2)) + 0.05 * grid**2
    turned = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    nets = (np.column_stack([warped, np.zeros(16)]) @ turned).reshape(4, 4, 1, 3)
    found = foot_bounds(nets, vertices, np.zeros(1, dtype=bool))
    for level in range(4):
        assert found.at(level, found.curvature, found.speed)[0] < 1e-7


def test_nothing_is_proved_where_the_surface_has_no_tangent_plane() -> None:
    grid = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1)
    collapsed, folded_in_the_middle, folded_beside_it = grid.copy(), grid.copy(), grid.copy()
    collapsed[:, :, 1] = 0.0
    folded_in_the_middle[2:] = grid[1::-1]
    folded_beside_it[3] = grid[0]
    nets = np.stack([collapsed, folded_in_the_middle, folded_beside_it, 0 * grid], axis=2)
    found = foot_bounds(nets, Vertices.LIMIT, np.zeros(4, dtype=bool))
    assert np.all(np.isinf(found.at(3, found.curvature, found.speed)))


@pytest.mark.parametrize("level", [1, 2])
def test_parts_are_bounded_along_the_diagonal_that_they_are_drawn_with(level: int) -> None:
    """z = k (x - y)² is even along one diagonal, and curved four times as much along the other as along the sides."""
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(meshes.grid(9, 9)), smooth_corners=True)
    x, y, _ = mesh.positions.T
    mesh = mesh.changed(positions=np.column_stack([x, y, 1e-4 * (x - y) ** 2]))
    along = mesh.positions[mesh.corner_vertices.reshape(-1, 4)]
    is_even = np.abs(along[:, 2, 2] - along[:, 0, 2]) < 1e-9
    drawn = np.arange(mesh.face_count) % 2 == 1
    side = np.linalg.norm((along[:, 1] - along[:, 0])[:, :2], axis=1) * 0.5**level
    # On the curved diagonal the chord is k (2s)² / 4 above the surface, on a side k s² / 4.
    reached = 1e-4 * side**2 * np.where(is_even == drawn, 1.0, 0.25)
    feet = FaceFeet.of(mesh, Vertices.LIMIT, drawn, lambda: None)
    inside = np.all(
        np.abs(along[:, :, :2].mean(axis=1) - mesh.positions[:, :2].mean(axis=0)) < 3.0 * side[0] * 2**level, axis=1
    )
    assert np.count_nonzero(inside & (is_even == drawn)) > 5
    for limit in 1e-4 * side[0] ** 2 * np.array([0.3, 0.5, 0.9, 1.1]):
        for found in feet.bounds(np.arange(mesh.face_count), level, Vertices.LIMIT, limit, lambda: None):
            proved = (found.bounds <= limit) & inside[found.faces]
            assert np.all(found.bounds[proved] >= 0.999 * reached[found.faces][proved])
