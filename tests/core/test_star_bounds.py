# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds along the surface: where rounding could take something from them, and by stars of several rings;
``test_adaptive`` has the surface itself."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive import neighbour_bounds
from ccdepth_addon.core.adaptive.leaf_bounds.star_bounds import THINNEST, star_bounds
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_bounds import ErrorBounds
from ccdepth_addon.core.adaptive.planner import subdivide_adaptively
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.arrays.types import BoolArray, FloatArray, IndexArray
from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.core.test_halves import triangles_of
from tests.triangle_distances import distances

pytestmark = pytest.mark.thorough

SIDES = 6
TRIANGLES = np.array([(0, 1 + i, 1 + (i + 1) % SIDES) for i in range(SIDES)])


def star(heights: FloatArray) -> FloatArray:
    """(7, 3): a hexagon's centre and its corners at heights (6,) around it."""
    angles = np.arange(SIDES) * 2 * np.pi / SIDES
    return np.concatenate([np.zeros((1, 3)), np.stack([np.cos(angles), np.sin(angles), heights], axis=1)])


def normals_of(points: FloatArray) -> FloatArray:
    a, b, c = points[TRIANGLES].swapaxes(0, 1)
    return unit(np.cross(b - a, c - a))


def unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def largest_tilts(points: FloatArray) -> FloatArray:
    """(6,): of each triangle against any other, by sines: cosines do not tell small angles."""
    normals = normals_of(points)
    sines = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=2)
    return np.arcsin(sines).max(axis=1)


def tilts_by_the_mean(points: FloatArray) -> FloatArray:
    """(6,): at most so much, by way of the mean of all normals."""
    normals = normals_of(points)
    sines = np.linalg.norm(np.cross(normals, unit(normals.sum(axis=0))), axis=1)
    return np.arcsin(sines) + np.arcsin(sines).max()


def bounds_of(points: FloatArray, normal: FloatArray, tangential: FloatArray, rounding: float = 0.0) -> FloatArray:
    """(6,): with the centre's star alone, as if the corners had no triangle but its own."""
    # Each corner is made one of a triangle's own, whose star is that triangle, so that the centre decides.
    apart = np.concatenate([points[:1], points[TRIANGLES[:, 1:]].reshape(-1, 3)])
    own = np.arange(1, 1 + 2 * SIDES).reshape(SIDES, 2)
    triangles = np.column_stack([np.zeros(SIDES, dtype=np.intp), own])
    closed, wanted = np.ones(len(apart), dtype=bool), np.ones(SIDES, dtype=bool)
    return star_bounds(apart, triangles, normal, tangential, closed, wanted, rounding).bounds


def promised(tilts: FloatArray, normal: float, tangential: float) -> FloatArray:
    """N / cos Θ + 2 tan Θ (T + N sin Θ), docs/adaptive.md."""
    return normal / np.cos(tilts) + 2 * np.tan(tilts) * (tangential + normal * np.sin(tilts))


@pytest.mark.parametrize("height", [1e-12, 1e-10, 3e-9, 1e-8, 1e-7, 1e-5, 1e-2])
def test_small_tilts_count(height: float) -> None:
    """A cosine of 1 is that of all angles up to 2e-8; the distance across is large here, and that along none."""
    points = star(height * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found = bounds_of(points, np.zeros(SIDES), np.full(SIDES, 0.1))
    assert np.all(found >= promised(largest_tilts(points), 0.0, 0.1))
    assert np.all(found <= (1 + 1e-6) * promised(tilts_by_the_mean(points) + 2e-9, 0.0, 0.1))


def test_what_is_hardly_across_counts() -> None:
    """The root of |E|² - (n · E)² is nothing but rounding where E is nearly along n."""
    generator = np.random.default_rng(1)
    points = star(0.5 * generator.random(SIDES))
    tilts = tilts_by_the_mean(points)
    normals = unit(generator.normal(size=(400, 3)))
    across = unit(np.cross(normals, generator.normal(size=(400, 3))))
    for ratio in 10.0 ** np.arange(-10, -5):
        vectors = 0.01 * (normals + ratio * across)
        error_bounds = ErrorBounds.of(vectors[None], np.zeros(1, dtype=np.intp), normals[None])
        for normal, tangential in zip(error_bounds.normal.tolist(), error_bounds.tangential.tolist(), strict=True):
            found = bounds_of(points, np.full(SIDES, normal), np.full(SIDES, tangential))
            assert np.all(found >= promised(tilts, 0.01, 0.01 * ratio))


def test_triangles_without_a_direction_have_no_bound() -> None:
    points = star(np.zeros(SIDES))
    assert np.all(np.isfinite(bounds_of(points, np.zeros(SIDES), np.zeros(SIDES))))
    # The second corner of a triangle is moved nearly onto the side from its third to its first.
    points[2] = points[3] / 2 + [0.0, 0.0, 0.1 * THINNEST]
    found = bounds_of(points, np.zeros(SIDES), np.zeros(SIDES))
    assert np.all(np.isinf(found))


def test_rounding_counts_as_often_as_it_may() -> None:
    """What is off by so much more, along and across, has no larger bound; nor has what turns with its vertices."""
    generator = np.random.default_rng(2)
    for _ in range(20):
        points = star(0.5 * generator.random(SIDES))
        normal, tangential = 0.05 * generator.random((2, SIDES))
        found = bounds_of(points, normal, tangential, rounding=1e-3)
        for _ in range(20):
            moved = points + 1e-4 * generator.uniform(-1, 1, points.shape)
            assert np.all(bounds_of(moved, normal + 1e-3, tangential + 1e-3) <= found)


def disc(rings: int, generator: np.random.Generator, steepness: float) -> tuple[FloatArray, IndexArray]:
    """(V, 3) vertices and (T, 3) triangles of a triangular grid with so many rings around its centre, vertex 0; uneven,
    and with slopes of about the steepness."""
    span = range(-rings, rings + 1)
    places = sorted(((i, j) for i in span for j in span if abs(i + j) <= rings), key=lambda place: place != (0, 0))
    numbers = {place: number for number, place in enumerate(places)}
    steps = (((1, 0), (0, 1)), ((0, 1), (-1, 1)))
    cells = [((i, j), *((i + k, j + m) for k, m in step)) for i, j in places for step in steps]
    triangles = [[numbers[place] for place in cell] for cell in cells if all(place in numbers for place in cell)]
    plane = np.array(places) @ np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]])
    plane += 0.1 * generator.uniform(-1, 1, plane.shape)
    return np.column_stack([plane, steepness * generator.uniform(-0.5, 0.5, len(places))]), np.array(triangles)


def vertices_within(triangles: IndexArray, vertex: int, edges: int) -> set[int]:
    """So many edges away at most."""
    found = {vertex}
    for _ in range(edges):
        found |= {other for triangle in triangles.tolist() if found & set(triangle) for other in triangle}
    return found


def closed_vertices(triangles: IndexArray) -> BoolArray:
    """(V,) of a disc: those inside, around which there are as many triangles as vertices."""
    around = np.bincount(triangles.ravel())
    return np.array([len(vertices_within(triangles, vertex, 1)) - 1 == around[vertex] for vertex in range(len(around))])


def room_of(points: FloatArray, triangles: IndexArray, corner: int, rings: int) -> float:
    """How far points of a triangle, nearest to the corner, are from the border of so many rings at least: a third of
    the least height over the corner, and half of that over one vertex of each further ring, on the worst way."""
    a, b, c = points[triangles].swapaxes(0, 1)
    doubled = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    heights = doubled[:, None] / np.stack([np.linalg.norm(side, axis=1) for side in (c - b, a - c, b - a)], axis=1)

    def least(vertex: int) -> float:
        return float(heights[triangles == vertex].min())

    def outwards(vertex: int, further: int) -> float:
        if not further:
            return 0.0
        beside = vertices_within(triangles, vertex, 1) - {vertex}
        return min(least(other) / 2 + outwards(other, further - 1) for other in beside)

    return least(corner) / 3 + outwards(corner, rings - 1)


@pytest.mark.parametrize("rings", [1, 2, 3])
def test_each_ring_adds_room(rings: int) -> None:
    """In a plane, where nothing but the room decides."""
    points, triangles = disc(5, np.random.default_rng(3), 0.0)
    closed, normal = closed_vertices(triangles), np.zeros(len(triangles))
    for number in np.flatnonzero((triangles == 0).any(axis=1)):
        room = min(room_of(points, triangles, corner, rings) for corner in triangles[number].tolist())
        wanted = np.arange(len(triangles)) == number
        for part, is_bounded in ((1 - 1e-6, True), (1 + 1e-6, False)):
            across = np.full(len(triangles), part * room)
            found = star_bounds(points, triangles, normal, across, closed, wanted, rings=rings)
            assert np.isfinite(found.bounds[0]) == is_bounded
            assert np.isfinite(found.with_room[0])


@pytest.mark.parametrize("rings", [1, 2, 3])
def test_all_stars_in_the_rings_are_closed(rings: int) -> None:
    points, triangles = disc(5, np.random.default_rng(4), 0.0)
    number = int(np.flatnonzero((triangles == 0).any(axis=1))[0])
    corners = triangles[number].tolist()
    room = min(room_of(points, triangles, corner, rings) for corner in corners)
    normal, across = np.zeros(len(triangles)), np.full(len(triangles), 0.999 * room)
    wanted = np.arange(len(triangles)) == number
    inside = set[int]().union(*(vertices_within(triangles, corner, rings - 1) for corner in corners))
    assert len(inside) < np.count_nonzero(closed_vertices(triangles))
    for vertex in range(len(points)):
        closed = closed_vertices(triangles)
        closed[vertex] = False
        found = star_bounds(points, triangles, normal, across, closed, wanted, rings=rings)
        assert np.isfinite(found.bounds[0]) == (vertex not in inside)


@pytest.mark.parametrize("rings", [1, 2, 3])
def test_the_largest_errors_and_tilts_in_the_rings_count(rings: int) -> None:
    """Wherever they are, and nothing beyond; so far across that fewer rings are not wide enough."""
    points, triangles = disc(5, np.random.default_rng(6), 0.01)
    closed, number = closed_vertices(triangles), int(np.flatnonzero((triangles == 0).any(axis=1))[0])
    corners, wanted = triangles[number].tolist(), np.arange(len(triangles)) == number
    most, least = (
        min(room_of(points, triangles, corner, r) if r else 0.0 for corner in corners) for r in (rings, rings - 1)
    )
    across = np.full(len(triangles), (most + least) / 2)
    reached = [np.isin(triangles, [*vertices_within(triangles, corner, rings - 1)]).any(axis=1) for corner in corners]
    a, b, c = points[triangles].swapaxes(0, 1)
    normals = unit(np.cross(b - a, c - a))
    sines = np.linalg.norm(np.cross(normals, normals[number]), axis=1)
    for other in range(len(triangles)):
        normal = np.full(len(triangles), 1e-3)
        normal[other] = 1e-2
        found = star_bounds(points, triangles, normal, across, closed, wanted, rings=rings).bounds[0]
        own = [promised(np.arcsin(sines[part].max()), normal[part].max(), across[0]) for part in reached]
        assert found >= max(own)
        far = across.copy()
        normal[other] = far[other] = 1e3
        counts = any(part[other] for part in reached)
        for along, sideways in ((normal, across), (np.full(len(triangles), 1e-3), far)):
            bound = star_bounds(points, triangles, along, sideways, closed, wanted, rings=rings).bounds[0]
            assert np.isinf(bound) if counts else bound <= found


def test_moved_discs_are_as_near_as_is_promised() -> None:
    """A surface that is the mesh itself, moved across by up to its triangles' width, with distances from samples."""
    generator, narrow = np.random.default_rng(5), 0
    weights = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    for steepness in (0.02, 0.1, 0.3):
        for _ in range(6):
            points, triangles = disc(6, generator, steepness)
            angle, length = generator.uniform(0, 2 * np.pi), generator.uniform(0.1, 1.2)
            move = length * np.array([np.cos(angle), np.sin(angle), 0.05 * generator.uniform(-1, 1)])
            a, b, c = points[triangles].swapaxes(0, 1)
            along = unit(np.cross(b - a, c - a)) @ move
            arguments = (points, triangles, np.abs(along), np.sqrt(move @ move - along**2), closed_vertices(triangles))
            wanted = np.ones(len(triangles), dtype=bool)
            found = star_bounds(*arguments, wanted, rings=4).bounds
            narrow += np.count_nonzero(np.isfinite(found) & np.isinf(star_bounds(*arguments, wanted).bounds))
            bounded = np.flatnonzero(np.isfinite(found))
            samples = np.einsum("sk,tki->tsi", weights, points[triangles[bounded]])
            for moved in (samples - move, samples + move):
                off = distances(moved.reshape(-1, 3), points, triangles).reshape(samples.shape[:2])
                # What both are rounded by.
                assert np.all(off.max(axis=1) <= found[bounded] + 1e-12)
    assert narrow > 100


def test_a_nearly_flat_pole_needs_fewer_faces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen quads around a vertex on a paraboloid, so flat that hardly anything is off but along the surface."""
    data = meshes.fan(16, 1)
    data.positions[:, 2] = -0.05 * (data.positions[:, :2] ** 2).sum(axis=1)
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True)
    request = AdaptiveRequest(1e-3, Mode.ADAPTIVE, Transitions.TRIANGLES, 10_000)
    found = subdivide_adaptively(mesh, request, mesh.positions)
    measured = measure_deviation(mesh, found.mesh.positions, triangles_of(found), accuracy=0.05)
    assert measured.reached <= found.bounds.max() <= request.limit
    monkeypatch.setattr(neighbour_bounds, "MORE_RINGS", (1,))
    assert len(found.bounds) < 0.7 * len(subdivide_adaptively(mesh, request, mesh.positions).bounds)
