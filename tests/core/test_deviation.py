# SPDX-License-Identifier: GPL-3.0-or-later
"""Deviations against dense samples of both sides, and against distances that are known."""

import tracemalloc
from functools import cache
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from ccdepth_addon.core.adaptive.planner import AdaptiveRequest, Mode, subdivide_adaptively
from ccdepth_addon.core.arrays.types import FloatArray, IndexArray
from ccdepth_addon.core.deviation import Deviation, KeptProofs, measure_deviation
from ccdepth_addon.core.deviation.bezier_pieces import bezier_pieces
from ccdepth_addon.core.deviation.leaf_samples import ON_GRID
from ccdepth_addon.core.deviation.mesh_to_surface import Facets
from ccdepth_addon.core.deviation.surface_to_mesh import nearest_triangles
from ccdepth_addon.core.deviation.triangles import Triangles
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, nets, soundness
from tests.brute_force import quad_places
from tests.core import test_adaptive
from tests.drawn_levels import points_of
from tests.thorough import combinations, each
from tests.triangle_distances import distances

ACCURACY = 0.05

# Of adaptive results.
TOLERANCE = 1e-3

# Steps along the sides of triangles.
STEPS = 6

NAMES = ["cube", "torus", "landscape", "valences 2 and 12", "valences 3 and 7", "n-gons", "triangles", "Möbius strip"]
NAMES += ["random creases", "creased cube", "n-gons with creases", "three faces on an edge", "collapsed faces"]
MESHES = {name: test_adaptive.MESHES[name] for name in NAMES}


def result(control: PolygonMesh, level: int, *, limit: bool) -> tuple[FloatArray, IndexArray]:
    """A level of the control mesh as triangles, those of a face all together."""
    mesh = nets.refined(control, level)
    triangles = mesh.corner_vertices.reshape(-1, 4)[:, [[0, 1, 2], [2, 3, 0]]].reshape(-1, 3)
    return limit_positions(mesh) if limit else mesh.positions, triangles


@cache
def fine(name: str) -> tuple[FloatArray, IndexArray]:
    """The surface as triangles with their corners on it, so many that they are hardly off."""
    control = meshes.build(MESHES[name]())
    return result(control, fine_level(control), limit=True)


def fine_level(control: PolygonMesh) -> int:
    return 4 if control.face_count < 30 else 3


def sampled(name: str, positions: FloatArray, triangles: IndexArray) -> tuple[FloatArray, FloatArray]:
    """(F,) from the surface of each face to the mesh, whose points are really on it: reached; (T,) back, about."""
    surface, surface_triangles = fine(name)
    faces = meshes.build(MESHES[name]()).face_sizes
    there = distances(surface, positions, triangles)[surface_triangles].max(axis=1)
    ends = np.cumsum(faces) * (len(there) // faces.sum())
    points = points_of(positions[triangles], STEPS)
    back = distances(points.reshape(-1, 3), surface, surface_triangles)
    return np.maximum.reduceat(there, [0, *ends[:-1]]), back.reshape(len(triangles), -1).max(axis=1)


def off_surface(control: PolygonMesh, level: int) -> float:
    """How far triangles of a level with corners on the surface are off it, about: what another level changes."""
    deeper, _ = result(control, level + 1, limit=True)
    return 2 * float(distances(deeper, *result(control, level, limit=True)).max())


def assert_sound(found: Deviation) -> None:
    assert found.proved >= found.reached >= 0
    assert found.face_bounds.max() == found.proved
    assert found.triangle_bounds.max() == found.proved
    between = np.linalg.norm(found.worst_point - found.worst_nearest)
    # The nearest point of the surface is known to a hundredth.
    assert between == pytest.approx(found.reached, rel=0.011, abs=1e-9)


@pytest.mark.parametrize(("name", "limit"), combinations(MESHES, [False, True]))
def test_deviation_lies_where_samples_say(name: str, limit: bool) -> None:
    control = meshes.build(MESHES[name]())
    positions, triangles = result(control, 1, limit=limit)
    found = measure_deviation(control, positions, triangles, accuracy=ACCURACY)
    assert_sound(found)
    assert found.accuracy_met
    assert found.proved <= (1 + ACCURACY) * found.reached
    there, back = sampled(name, positions, triangles)
    # Points of the surface are exact but for rounding; those of the mesh are compared with a fine mesh in its place.
    off = off_surface(control, fine_level(control))
    assert np.all(found.face_bounds >= there - 1e-12)
    assert np.all(found.triangle_bounds >= back - off)
    # Samples this dense reach nearly everything.
    assert found.reached <= 1.02 * max(there.max(), back.max()) + off


@pytest.mark.parametrize("name", [*MESHES, "saddle"])
def test_the_surface_is_as_near_to_its_pieces_and_their_triangles_as_said(name: str) -> None:
    """At equal parameters, from whichever corner a piece is counted."""
    pieces = bezier_pieces(meshes.build(MESHES.get(name, saddle)()), 0, lambda: None)
    count, facets = pieces.unit_count, Facets.of(pieces, np.arange(pieces.unit_count))
    mesh = nets.refined(pieces.unit_mesh, 4)
    points = limit_positions(mesh)[mesh.corner_vertices].reshape(count, -1, 3)
    u, v = quad_places(4)[:, :, None].swapaxes(0, 1)
    a, b, c, d = facets.corners[:, :, None].swapaxes(0, 1)
    off = []
    for _ in range(4):
        bernstein = [np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]) for t in (u, v)]
        smooth = np.einsum("ni,nj,fdij->fnd", *bernstein, pieces.coefficients[:count].reshape(-1, 3, 4, 4))
        flat = np.where(u >= v, a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d))
        off.append([np.linalg.norm(each - points, axis=2).max(axis=1) for each in (smooth, flat)])
        u, v = v, 1 - u
    turns, every = np.argmin(off, axis=0)[0], np.arange(count)
    smooth, flat = np.array(off)[turns, :, every].T
    assert np.all(smooth <= pieces.excess[:count] + 1e-12)
    assert np.all(flat <= facets.off + 1e-12)


def saddle() -> meshes.MeshData:
    """Inside, the surface is bilinear over every face: its triangles are off by all of what is said."""
    return meshes.bent(meshes.grid(5, 5), lambda x, y, _: (x, y, x * y))


@pytest.mark.parametrize("away", [0.0, 0.3, 30.0])
def test_the_nearest_triangle_is_found_however_far_it_is(away: float) -> None:
    control = meshes.build(meshes.torus(9, 6))
    mesh, places = Triangles.of(*result(control, 1, limit=True)), result(control, 2, limit=False)[0] + away
    found = nearest_triangles(mesh, places)
    every = [mesh.distances(places, np.full(len(places), which))[0] for which in range(mesh.count)]
    np.testing.assert_array_equal(found.distances, np.maximum(np.transpose(every) - mesh.slack, 0).min(axis=1))


@pytest.mark.parametrize("count", each([20, 60], [20]))
def test_a_square_that_is_its_own_surface_is_off_by_nothing(count: int) -> None:
    """The nearest triangle of each of its points is at hardly any distance, and has to be found by its box. Of the
    first sides the sixth has it beyond its box, by rounding."""
    generator = np.random.default_rng(1)
    for side in (10.0 ** generator.uniform(-5, 5, 60)).tolist()[:count]:
        corners = side * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype=float)
        data = meshes.MeshData(corners, np.array([4]), np.array([0, 1, 3, 2]))
        control = meshes.build(data, smooth_corners=False)
        made = corners * (1 + 2.0**-52 * generator.integers(-1, 2, corners.shape))
        found = measure_deviation(control, made, np.array([[0, 1, 3], [0, 3, 2]]), accuracy=0.02, enough=side / 14)
        assert found.reached <= 1e-12 * side
        assert found.proved <= side / 14


@pytest.mark.parametrize("height", [1e-6, 0.01, 3.0])
def test_lifted_plane(height: float) -> None:
    """Every point of either is so far from the other, and none farther, though the spacing is uneven."""
    control = meshes.build(meshes.bent(meshes.grid(3, 2), lambda x, y, z: (x**2.5, y, z)))
    positions, triangles = result(control, 3, limit=True)
    found = measure_deviation(control, positions + np.array([0, 0, height]), triangles, accuracy=0.2)
    at_border = measure_deviation(control, positions, triangles, accuracy=0.2).proved
    assert_sound(found)
    assert height * (1 - 1e-9) - 1e-12 <= found.proved <= 1.2 * np.hypot(height, at_border) + 1e-12
    assert found.reached <= np.hypot(height, at_border) + 1e-12


def test_triangles_beyond_the_border_are_as_far_as_they_reach() -> None:
    control = meshes.build(meshes.grid(4, 4), smooth_corners=False)
    positions, triangles = result(control, 1, limit=True)
    positions = positions + 0.1 * (positions - 2) * [1.0, 1.0, 0.0]
    beyond = np.linalg.norm(np.maximum(np.abs(positions - 2)[:, :2] - 2, 0), axis=1)[triangles].max(axis=1)
    found = measure_deviation(control, positions, triangles)
    assert np.all(found.triangle_bounds >= beyond - 1e-12)
    assert np.sqrt(0.08) <= found.proved <= (1 + ACCURACY) * np.sqrt(0.08)


@pytest.mark.parametrize("slope", [1.0, 5.0])
def test_a_steep_triangle_beyond_the_border_is_as_far_as_its_highest_side(slope: float) -> None:
    """Along the surface's normal the border is beside the triangle's middle, but lower than the triangle's plane."""
    control = meshes.build(meshes.grid(3, 3), smooth_corners=False)
    flap = [(x, y, slope * (0.005 - x)) for x, y in ((-0.01, 1), (-0.01, 2), (0.0005, 1.5))]
    positions = np.array([(0, 0, 0), (3, 0, 0), (3, 3, 0), (0, 3, 0), *flap])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    distance = np.hypot(flap[0][0], flap[0][2])
    for enough in (0.0, 0.6, 0.9):
        found = measure_deviation(control, positions, triangles, enough=enough * distance)
        assert found.triangle_bounds[2] >= distance * (1 - 1e-12)


@pytest.mark.parametrize("seed", each(range(400), short=[161, 233]))
def test_triangles_near_a_border_are_as_far_as_samples_say(seed: int) -> None:
    generator = np.random.default_rng(seed)
    control = meshes.build(meshes.bumpy(meshes.grid(3, 2), 0.3, seed), smooth_corners=seed % 2 == 0)
    surface, surface_triangles = result(control, 5, limit=True)
    fine = nets.refined(control, 5)
    border = surface[np.unique(fine.edge_vertices[fine.edge_face_counts == 1])]
    sizes = 10.0 ** generator.uniform(-3, -0.5, (60, 1, 1))
    steep = generator.normal(size=(60, 3, 3)) * [1, 1, generator.choice([0.1, 1, 5])]
    corners = border[generator.integers(0, len(border), (60, 1))] + sizes * steep
    points = points_of(corners, STEPS)
    back = distances(points.reshape(-1, 3), surface, surface_triangles).reshape(60, -1).max(axis=1)
    for enough in (0.0, float(np.median(back)), 0.9 * float(back.max())):
        found = measure_deviation(control, corners.reshape(-1, 3), np.arange(180).reshape(-1, 3), enough=enough)
        assert np.all(found.triangle_bounds >= back - off_surface(control, 5))


def test_a_spike_of_the_mesh_and_a_part_missing_from_it_are_reached() -> None:
    """What only one of the two has counts as much: a hole, whose border is as far off as its middle is from it."""
    control = meshes.build(meshes.grid(4, 4), smooth_corners=False)
    positions, triangles = result(control, 1, limit=True)
    spiked = positions.copy()
    spiked[np.argmin(np.linalg.norm(positions - [2, 2, 0], axis=1)), 2] = 0.7
    outside = (np.abs(positions[triangles].mean(axis=1) - [2, 2, 0]) > 1).any(axis=1)
    spike = measure_deviation(control, spiked, triangles)
    hole = measure_deviation(control, positions, triangles[outside])
    for found, distance, rounding, from_surface in ((spike, 0.7, 0.0, False), (hole, 1.0, 1e-9, True)):
        assert_sound(found)
        assert found.accuracy_met
        assert found.surface_to_mesh == from_surface
        assert found.reached <= distance + 1e-9
        assert found.proved >= distance - rounding
    assert spike.reached == pytest.approx(0.7, rel=0.01)


# Each measures a surface and samples it densely: so a third as many as elsewhere.
@settings(max_examples=settings().max_examples // 3)
@given(
    seed=st.integers(0, 10_000),
    level=st.integers(0, 1),
    noise=st.sampled_from([0.0, 0.01, 0.2]),
    bumps=st.sampled_from([0.2, 1.0]),
)
def test_any_triangles_next_to_any_surface(seed: int, level: int, noise: float, bumps: float) -> None:
    """The bounds hold for what has nothing to do with the surface's parameters; bumps as large as faces fold these."""
    generator = np.random.default_rng(seed)
    control = meshes.build(meshes.with_random_creases(meshes.bumpy(meshes.landscape(3, 2), bumps, seed), seed))
    positions, triangles = result(control, level + 1, limit=bool(seed % 2))
    positions = positions + generator.normal(size=positions.shape) * noise
    triangles = triangles[generator.random(len(triangles)) < 0.95]
    found = measure_deviation(control, positions, triangles, accuracy=0.2, max_pieces=60_000)
    assert found.proved >= found.reached
    surface = result(control, 4, limit=True)
    to_mesh = distances(surface[0], positions, triangles, found.proved)
    assert found.proved >= to_mesh.max() - 1e-12
    worst = distances(found.worst_point[None], positions, triangles, 0.0)
    assert not found.surface_to_mesh or found.reached <= worst + 1e-12
    back = distances(points_of(positions[triangles], STEPS).reshape(-1, 3), *surface)
    assert found.proved >= back.max() - off_surface(control, 4)


@pytest.mark.parametrize("seed", each(range(1, 12), short=[1]))
def test_adaptive_results_of_thin_triangles_are_decided(seed: int) -> None:
    """Needles at the border of random points, where the surface is folded, with default settings."""
    points = np.random.default_rng(seed).random((60, 2))
    heights = 0.05 * np.sin(6 * points[:, 0]) * np.cos(5 * points[:, 1])
    triangles = Delaunay(points).simplices.tolist()
    control = meshes.build(meshes.from_faces(np.column_stack([points, heights]), triangles))
    request = AdaptiveRequest(TOLERANCE, Mode.ADAPTIVE, 100_000)
    made = subdivide_adaptively(control, request, control.positions).mesh
    corners = soundness.drawn(made)
    found = measure_deviation(control, made.positions, corners, limit=TOLERANCE)
    assert_sound(found)
    assert found.proved <= TOLERANCE
    surface, _ = result(control, 4, limit=True)
    # Long triangles may be nearest though their middles are not.
    assert distances(surface, made.positions, corners, found.proved).max() <= found.proved + 1e-12


@pytest.mark.parametrize("name", each(["torus", "random creases", "landscape", "n-gons"], short=["torus"]))
def test_what_is_proved_of_one_mesh_holds_of_the_next(name: str) -> None:
    """With vertices moved by up to three times the distance asked for, and back, and with triangles missing."""
    generator = np.random.default_rng(1)
    control = meshes.build(MESHES[name]())
    plain, whole = result(control, 2, limit=True)
    enough, proofs, verdicts = 2 * off_surface(control, 2), KeptProofs(), set()
    for moved, missing in ((0, 0), (3, 0), (0, 0), (5, 0), (0, 3), (40, 0), (2, 1), (0, 0)):
        positions = plain.copy()
        chosen = generator.choice(len(plain), moved)
        positions[chosen] += 3 * enough * generator.uniform(-1, 1, (moved, 3)) / np.sqrt(3)
        triangles = np.delete(generator.permutation(whole), np.arange(missing), axis=0)
        found = measure_deviation(control, positions, triangles, enough=enough, proofs=proofs)
        there, back = sampled(name, positions, triangles)
        assert np.all(found.face_bounds >= there - 1e-12)
        assert np.all(found.triangle_bounds >= back - off_surface(control, fine_level(control)))
        assert_pieces_are_within(proofs, positions, triangles)
        alone = measure_deviation(control, positions, triangles, enough=enough)
        assert (found.proved <= enough) == (alone.proved <= enough)
        verdicts.add(found.proved <= enough)
    assert len(verdicts) == 2


@pytest.mark.parametrize("start", [1.7, 2.1])
def test_pieces_keep_no_bound_where_a_strip_is_gone(start: float) -> None:
    """A strip narrower than pieces of a flat surface, which is so far below that no boxes meet."""
    control = meshes.build(meshes.grid(4, 4), smooth_corners=False)
    positions = np.array([[x, y, 0.5] for x in (0.0, start, start + 0.05, 4.0) for y in (0.0, 4.0)])
    triangles, proofs = np.concatenate([[[i, i + 2, i + 3], [i, i + 3, i + 1]] for i in (0, 2, 4)]), KeptProofs()
    for each_mesh in (triangles, triangles[[0, 1, 4, 5]]):
        measure_deviation(control, positions, each_mesh, enough=0.51, proofs=proofs)
        assert_pieces_are_within(proofs, positions, each_mesh)


def assert_pieces_are_within(proofs: KeptProofs, positions: FloatArray, triangles: IndexArray) -> None:
    """Samples of every piece without an excess are within the piece's bound."""
    surface = proofs.last.surface
    leaves = surface.pieces.leaves()
    leaves = leaves[surface.pieces.excess[leaves] == 0]
    points = (surface.pieces.coefficients[leaves] @ ON_GRID.T).swapaxes(1, 2) + proofs.origin
    found = distances(points.reshape(-1, 3), positions, triangles).reshape(len(leaves), -1).max(axis=1)
    assert np.all(found <= surface.upper[leaves] + 1e-12)


@cache
def hills(level: int) -> tuple[PolygonMesh, FloatArray, IndexArray]:
    """A landscape, and a mesh of it."""
    control = meshes.build(meshes.landscape(4, 3))
    return control, *result(control, level, limit=True)


def test_limits_leave_a_valid_bound() -> None:
    """And a tolerance that is far above is met early."""
    met, exact = measure_deviation(*hills(3), tolerance=1000.0), measure_deviation(*hills(3))
    assert met.accuracy_met
    assert met.proved <= 1.0
    for limits in ({"max_pieces": 1}, {"max_pieces": 2000}, {"time_limit": 0.0}):
        found = measure_deviation(*hills(3), **limits)
        assert found.proved >= exact.reached
        assert not found.accuracy_met
        assert found.face_bounds.max() == found.triangle_bounds.max() == found.proved


def test_a_limit_near_the_distance_is_decided() -> None:
    """Nearer than the accuracy would tell, and on either side of the distance, which is known to a millionth."""
    known = measure_deviation(*hills(3), accuracy=1e-6)
    assert known.accuracy_met
    beyond, short = known.proved * (1 + 1e-5), known.reached * (1 - 1e-5)
    for enough in (0.0, beyond):
        assert measure_deviation(*hills(3), accuracy=ACCURACY, limit=beyond, enough=enough).proved <= beyond
    too_far = measure_deviation(*hills(3), accuracy=ACCURACY, limit=short, enough=short)
    assert too_far.accuracy_met
    assert short < too_far.reached <= known.proved
    for found in (too_far, measure_deviation(*hills(3), enough=beyond, accuracy=ACCURACY)):
        assert known.reached <= found.proved <= (1 + ACCURACY) * known.proved


def test_progress_is_told_often_and_may_stop() -> None:
    """Whoever presses Esc is heard soon."""
    with pytest.raises(LookupError):
        measure_deviation(*hills(2), progress=Mock(side_effect=LookupError))
    told: list[float] = []
    measure_deviation(*hills(5), accuracy=1.0, progress=told.append)
    assert told == sorted(told)
    assert 0 <= told[0] <= told[-1] <= 1
    assert sum(fraction == 0 for fraction in told) > 5
    # A fifth of a second or less apart.
    assert len(told) > 20
    assert any(0 < fraction < 0.5 for fraction in told)
    assert any(0.5 < fraction < 1 for fraction in told)


def test_degenerate_triangles_change_nothing() -> None:
    control, positions, triangles = hills(1)
    folded = np.concatenate([triangles, triangles[:5][:, [0, 1, 1]], triangles[:3][:, [0, 0, 0]]])
    plain = measure_deviation(control, positions, triangles)
    found = measure_deviation(control, positions, folded)
    assert found.accuracy_met
    assert found.proved == pytest.approx(plain.proved, rel=ACCURACY)


def test_a_point_of_the_border_may_be_off_all_boxes_by_rounding() -> None:
    corners = np.array(
        [
            [0.0, 0.0, 0.0],
            [-0.12696151435375214, -0.05629945546388626, -0.01631905883550644],
            [-0.10455115139484406, -0.06694618612527847, -0.15394024550914764],
            [0.022410361096262932, -0.010646732524037361, -0.1376211792230606],
        ]
    )
    quad = apply_boundary_rule(polygon_mesh(corners, np.array([4]), np.arange(4)), smooth_corners=False)
    found = measure_deviation(quad, corners, np.array([[0, 1, 2], [0, 2, 3], [2, 2, 2]]), tolerance=1e-3)
    assert found.proved <= 1e-3


def test_bad_input() -> None:
    control = meshes.build(meshes.cube())
    positions, triangles = result(control, 1, limit=True)
    with pytest.raises(ValueError, match="no triangles"):
        measure_deviation(control, positions, triangles[:0])
    broken = positions.copy()
    broken[3, 1] = np.nan
    with pytest.raises(ValueError, match="finite"):
        measure_deviation(control, broken, triangles)
    flat_face = control.changed(positions=np.zeros_like(control.positions))
    with pytest.raises(InvalidMeshError):
        measure_deviation(flat_face, positions, triangles)


def test_distances_of_any_number_of_places_take_little_memory() -> None:
    """At a pole of hundreds of faces there are millions of pairs of places and facets."""
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]])
    facets = Facets(np.zeros(1, dtype=np.intp), corners, np.zeros(1), np.ones(1), np.ones(1))
    places, which = np.full((500_000, 3), 0.5), np.zeros(500_000, dtype=np.intp)
    tracemalloc.start()
    off, nearest = facets.distances(places, which)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert np.all(off == 0.5)
    # What is returned, and as much again for what is in between.
    assert peak < 2 * (off.nbytes + nearest.nbytes)
