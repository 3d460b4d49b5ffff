# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances that vary: adaptive meshes against dense samples of the limit surface, with its tolerance evaluated apart.

Nearest points of triangles are found here by brute force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ccdepth_addon.core import (
    AdaptiveMesh,
    AdaptiveRequest,
    FloatArray,
    Mode,
    PolygonMesh,
    Pose,
    SurfacePoints,
    ToleranceError,
    Variation,
    common_level,
    face_depths,
    limit_values,
    pose_depths,
    subdivide_adaptively,
    uniform_level,
)
from ccdepth_addon.core.adaptive.planner import plan_within
from ccdepth_addon.core.bounds.norm_bounds import Method
from ccdepth_addon.core.depth.face_depths import groups_of
from tests import meshes, soundness
from tests.brute_force import Levels

MESHES: dict[str, Callable[[int], meshes.MeshData]] = {
    "landscape": lambda seed: meshes.landscape(4, 3, seed),
    "torus": lambda seed: meshes.bumpy(meshes.torus(7, 5), 0.1, seed),
    "n-gons": lambda seed: meshes.bumpy(meshes.cylinder(7), 0.1, seed),
    "creases": lambda seed: meshes.with_random_creases(meshes.landscape(3, 2, seed), seed),
    "valence 7": lambda seed: meshes.bumpy(meshes.trapezohedron(7), 0.05, seed),
    "hexagons": lambda seed: meshes.hexagons(2, 2, 0.2, seed),
}

# Distances are rounded a few times, to sixteen digits, and factors are powers of logarithms.
ROUNDED = 1 + 1e-9

# So many samples of the surface are taken along a side of a quarter of a face. The nearest sample of a point is
# so little farther than the nearest point of the surface, measured in tolerances.
SIDE, SPACED = 24, 1.03


def nearest(points: FloatArray, triangles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(P, 3) and (P,): the nearest points on triangles (M, 3, 3) of points (P, 3), and their distances: the foot in the
    plane where it is inside, and otherwise the nearest point of a side."""
    best, found = np.full(len(points), np.inf), np.zeros_like(points)
    for a, b, c in triangles:
        normal = np.cross(b - a, c - a)
        size = normal @ normal
        foot = points - ((points - a) @ normal / size)[:, None] * normal if size else np.repeat(a[None], len(points), 0)
        inside = np.ones(len(points), dtype=bool) if size else np.zeros(len(points), dtype=bool)
        for first, second in ((a, b), (b, c), (c, a)):
            inside &= np.cross(second - first, foot - first) @ normal >= 0
        candidates = [np.where(inside[:, None], foot, np.inf)]
        for first, second in ((a, b), (b, c), (c, a)):
            along = second - first
            part = np.clip((points - first) @ along / max(along @ along, 1e-300), 0, 1)
            candidates.append(first + part[:, None] * along)
        for each in candidates:
            distance = np.sqrt(((points - each) ** 2).sum(axis=1))
            is_nearer = distance < best
            best[is_nearer], found[is_nearer] = distance[is_nearer], each[is_nearer]
    return found, best


def dense(mesh: PolygonMesh, side: int) -> SurfacePoints:
    """Points of the surface, evenly in the quarters of all faces."""
    steps = (np.arange(side) + 0.5) / side
    u, v = (each.ravel() for each in np.meshgrid(steps, steps))
    corners = np.repeat(np.arange(mesh.corner_count), len(u))
    return SurfacePoints(corners, np.tile(np.stack([u, v], axis=1), (mesh.corner_count, 1)))


def factors_at(mesh: PolygonMesh, factors: FloatArray, points: SurfacePoints) -> FloatArray:
    """(N,): the factors at points: geometric means of a quarter's four."""
    found = np.empty(len(points.corners))
    for corner in range(mesh.corner_count):
        face = mesh.corner_faces[corner]
        start, end = mesh.face_starts[face], mesh.face_starts[face + 1]
        own = factors[start:end]
        place, size = corner - start, end - start
        after, before = own[(place + 1) % size], own[place - 1]
        four = own[place], np.sqrt(own[place] * after), np.prod(own) ** (1 / size), np.sqrt(own[place] * before)
        some = points.corners == corner
        u, v = points.parameters[some].T
        weights = (1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v
        found[some] = np.prod([each**weight for each, weight in zip(four, weights, strict=True)], axis=0)
    return found


def random_factors(mesh: PolygonMesh, rng: np.random.Generator) -> FloatArray:
    """Factors of vertices, as painted, or of faces, as by materials."""
    if rng.random() < 0.5:
        return 10.0 ** rng.random(mesh.vertex_count)[mesh.corner_vertices]
    return 10.0 ** rng.random(mesh.face_count)[mesh.corner_faces]


def made(mesh: PolygonMesh, limit: float, variation: Variation | None, **others: object) -> AdaptiveMesh:
    request = replace(AdaptiveRequest(limit, Mode.ADAPTIVE, 100_000, variation=variation), **others)
    return subdivide_adaptively(mesh, request, mesh.positions)


def drawn_triangles(found: AdaptiveMesh) -> FloatArray:
    return found.mesh.positions[soundness.drawn(found.mesh)]


def build(name: str, seed: int) -> PolygonMesh:
    return meshes.build(MESHES[name](seed))


SEEDS = [pytest.param(seed, marks=pytest.mark.thorough) for seed in range(2, 19)]


@pytest.mark.parametrize("seed", [1, *SEEDS])
@pytest.mark.parametrize("name", MESHES)
def test_surface_and_mesh_are_within_the_tolerance_of_the_surface_at_each_point(name: str, seed: int) -> None:
    mesh, rng = build(name, seed), np.random.default_rng(seed)
    factors, limit = random_factors(mesh, rng), 0.02 * meshes.diagonal(mesh)
    found = made(mesh, limit, Variation(factors))
    soundness.assert_sound(mesh, found.mesh)
    assert np.all(found.ratios <= 1)
    if np.diff(found.mesh.face_starts).max() > 4:
        pytest.skip("Blender chooses the triangles of polygons")
    triangles, samples = drawn_triangles(found), dense(mesh, SIDE)
    surface, own = limit_values(mesh, mesh.positions, samples), limit * factors_at(mesh, factors, samples)
    some = rng.choice(len(own), 200)
    distances = nearest(surface[some], triangles)[1]
    assert np.all(distances <= own[some] * found.ratios.max() * ROUNDED)
    chosen = triangles[rng.integers(len(triangles), size=200)]
    drawn = np.einsum("nk,nkd->nd", rng.dirichlet(np.full(3, 0.5), size=200), chosen)
    off = np.linalg.norm(drawn[:, None] - surface, axis=2) / own
    assert np.all(off.min(axis=1) <= SPACED)


@pytest.mark.parametrize("name", MESHES)
def test_equal_factors_change_nothing(name: str) -> None:
    mesh = build(name, 1)
    limit = 0.01 * meshes.diagonal(mesh)
    plain, even = made(mesh, limit, None), made(mesh, limit, Variation(np.ones(mesh.corner_count)))
    np.testing.assert_array_equal(plain.mesh.positions, even.mesh.positions)
    np.testing.assert_array_equal(plain.mesh.corner_vertices, even.mesh.corner_vertices)
    np.testing.assert_array_equal(plain.bounds, even.bounds)


def test_coarser_parts_have_fewer_faces() -> None:
    """Half of a torus at ten times the tolerance, with and without an angle."""
    mesh = build("torus", 1)
    factors = np.where(mesh.positions[mesh.corner_vertices, 0] > 0, 10.0, 1.0)
    limit = 2e-3 * meshes.diagonal(mesh)
    for angle in (0.0, 0.5):
        fine, varied = (made(mesh, limit, each, shading=angle) for each in (None, Variation(factors)))
        assert len(varied.bounds) < 0.7 * len(fine.bounds)
        assert np.all(varied.ratios <= 1)


def test_tolerances_below_rounding_are_refused() -> None:
    mesh = build("torus", 1)
    factors = np.where(mesh.positions[mesh.corner_vertices, 0] > 0, 1.0, 1e-3)
    with pytest.raises(ToleranceError, match="too fine"):
        made(mesh, 0.1, Variation(factors), rounding=1e-3)


def test_places_are_within_the_tolerances_of_all_leaves_that_touch() -> None:
    """A leaf's triangles may be near the surface of any of these. Here factors jump from face to face."""
    mesh = build("torus", 1)
    factors = np.random.default_rng(1).choice([1.0, 10.0], mesh.face_count)[mesh.corner_faces]
    request = AdaptiveRequest(1e-3 * meshes.diagonal(mesh), Mode.ADAPTIVE, 100_000, variation=Variation(factors))
    plan, _ = plan_within(mesh, request, lambda _: None)
    tree, leaves = plan.tree, plan.tree.leaves()
    around = dict.fromkeys(range(len(tree.vertex_edges)), np.inf)
    of_leaves = []
    for leaf in leaves.tolist():
        slots = tree.slots(np.array([leaf]))
        middles = tree.midpoints[tree.slot_edges[slots]]
        of_leaves.append([*tree.slot_vertices[slots].tolist(), *middles[middles >= 0].tolist()])
        for vertex in of_leaves[-1]:
            around[vertex] = min(around[vertex], request.limit * factors[mesh.face_starts[tree.base_faces[leaf]]])
    least = np.array([min(around[vertex] for vertex in own) for own in of_leaves])
    bounds = plan.along_surface.values[leaves]
    proved = np.isfinite(bounds) & np.isinf(np.minimum(plan.at_equal.values[leaves], plan.mapped.values[leaves]))
    assert proved.any()
    assert np.all(bounds[proved] <= least[proved] * ROUNDED)
    np.testing.assert_allclose(plan.limits_around(leaves, 1), least, rtol=1e-12)


@pytest.mark.parametrize("seed", [1, *SEEDS])
@pytest.mark.parametrize("method", ["CERTIFIED", "SHARP", "SECOND_ORDER"])
def test_depths_are_within_the_finest_tolerance_of_each_face(method: str, seed: int) -> None:
    mesh, rng = build("n-gons", seed), np.random.default_rng(seed)
    factors, tolerance = random_factors(mesh, rng), 0.01 * meshes.diagonal(mesh)
    finest = tolerance * np.array([factors[start:end].min() for start, end in _faces(mesh)])
    levels = Levels(mesh)
    found = face_depths(mesh, tolerance, method, "CONTROL", variation=Variation(factors))
    assert np.all(found.bounds <= finest)
    for depth in range(min(int(found.depths.max()), 4) + 1):
        own = found.depths == depth
        assert np.all(levels.distances(depth, "CONTROL", 2)[own] <= finest[own])
    shallow = face_depths(mesh, tolerance, method, "CONTROL")
    assert np.all(found.depths <= shallow.depths)
    # A level takes three quarters of a distance: smaller factors may lower no depth, but do on the first mesh.
    assert found.depths.sum() < shallow.depths.sum() or (seed > 1 and finest.max() < 4 * tolerance)


@pytest.mark.parametrize("method", [Method.DISTANCE, Method.CERTIFIED])
def test_groups_have_the_least_tolerance_of_all_faces_that_count(method: Method) -> None:
    """By distance the faces around a face count as well. Each face is in one group."""
    mesh, rng = build("n-gons", 1), np.random.default_rng(1)
    factors = 10.0 ** rng.random(mesh.corner_count)
    groups = groups_of(mesh, np.arange(mesh.face_count), 2.0, Variation(factors), method)
    corners = [{*mesh.corner_vertices[start:end].tolist()} for start, end in _faces(mesh)]
    own = [2 * factors[start:end].min() for start, end in _faces(mesh)]
    for faces, test in groups:
        for face in faces.tolist():
            touching = [other for other, each in enumerate(corners) if each & corners[face]]
            least = min(own[other] for other in touching) if method is Method.DISTANCE else own[face]
            assert least / 2**0.25 <= test.tolerance <= least
    np.testing.assert_array_equal(np.sort(np.concatenate([faces for faces, _ in groups])), np.arange(mesh.face_count))


def _faces(mesh: PolygonMesh) -> list[tuple[int, int]]:
    return [*zip(mesh.face_starts[:-1].tolist(), mesh.face_starts[1:].tolist(), strict=True)]


@pytest.mark.parametrize("seed", [1, *SEEDS])
@pytest.mark.parametrize("name", ["landscape", "torus"])
def test_the_level_for_all_faces_is_within_the_tolerance_at_each_point(name: str, seed: int) -> None:
    """By distance, both ways. The finest part lies where the surface is nearly flat or not, as it happens."""
    mesh, rng = build(name, seed), np.random.default_rng(seed)
    factors, tolerance = random_factors(mesh, rng), 4e-3 * meshes.diagonal(mesh)
    variation = Variation(factors)
    level = uniform_level(mesh, tolerance, "DISTANCE", "LIMIT", variation=variation)
    assert level <= uniform_level(mesh, tolerance, "DISTANCE", "LIMIT")
    levels = Levels(mesh)
    quads = levels.mesh(level).corner_vertices.reshape(-1, 4)
    triangles = levels.limits(level)[quads[:, [[0, 1, 2], [0, 2, 3]]]].reshape(-1, 3, 3)
    samples = dense(mesh, SIDE)
    surface, own = limit_values(mesh, mesh.positions, samples), tolerance * factors_at(mesh, factors, samples)
    some = rng.choice(len(own), 200)
    assert np.all(nearest(surface[some], triangles)[1] <= own[some])
    drawn = np.einsum(
        "nk,nkd->nd", rng.dirichlet(np.ones(3), size=200), triangles[rng.integers(len(triangles), size=200)]
    )
    off = np.linalg.norm(drawn[:, None] - surface, axis=2) / own
    # Faces are about a tenth of the diagonal wide: half the diagonal of four samples is less than 0.4 tolerances.
    assert np.all(off.min(axis=1) <= np.hypot(1, 0.4))
    pose = Pose(lambda: mesh, tolerance, variation)
    found = pose_depths([pose, pose], "DISTANCE", "LIMIT")
    assert common_level([([pose], "DISTANCE", "LIMIT", found)]) == level
    np.testing.assert_array_equal(
        found.depths, face_depths(mesh, tolerance, "DISTANCE", "LIMIT", variation=variation).depths
    )


def test_depths_below_rounding_are_refused() -> None:
    mesh = build("torus", 1)
    factors = np.where(mesh.positions[mesh.corner_vertices, 0] > 0, 1.0, 1e-12)
    with pytest.raises(ToleranceError, match="finer than"):
        face_depths(mesh, 0.1, "DISTANCE", "LIMIT", variation=Variation(factors))
