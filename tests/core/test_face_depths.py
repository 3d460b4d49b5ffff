# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths of faces: the published numbers and formulas, every kind of face, and what must not matter."""

import itertools
from dataclasses import replace
from functools import cache, reduce
from itertools import cycle, product
from math import ceil, log
from time import process_time
from unittest.mock import Mock

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Method, Vertices, first_order_rate
from ccdepth_addon.core.bounds.rounding import rounding_allowance, smallest_tolerance
from ccdepth_addon.core.depth.face_depths import METHODS, VERTICES, ToleranceError, face_depths
from ccdepth_addon.core.depth.tolerance import FaceDepths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh, polygon_mesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches
from tests import meshes, nets
from tests.brute_force import Levels
from tests.meshes import build
from tests.proved_bounds import level_bounds
from tests.thorough import cases

# What they bound is compared at equal parameters; ``test_distance_depth`` has the other one.
EQUAL_METHODS = [method for method in METHODS if method != "DISTANCE"]
every_method = pytest.mark.parametrize("method", EQUAL_METHODS)
both_vertices = pytest.mark.parametrize("vertices", VERTICES)

# Brute force looks at these levels.
LEVELS = 4


def pole_mesh(valence: int, bumps: float = 0.1) -> PolygonMesh:
    """A closed mesh of quads with one extraordinary corner each at the most, of valence 3 or ``valence``."""
    return nets.refined(build(meshes.bumpy(meshes.trapezohedron(valence), bumps)), 1)


def test_printed_examples() -> None:
    mesh = pole_mesh(5)
    for valence, size, depths in ((3, 0.16, [2, 7, 13, 19]), (5, 0.81 * 25 / 18, [7, 14, 21, 28])):
        norms = {face: norm for face, (n, norm) in nets.published_norms(mesh).items() if n == valence}
        for face in sorted(norms)[:6]:
            scaled = mesh.changed(positions=mesh.positions * (size / norms[face]))
            found = [face_depths(scaled, 10.0**-digits, "SECOND_ORDER", "CONTROL") for digits in (1, 2, 3, 4)]
            assert [result.depths[face] for result in found] == depths


@pytest.mark.parametrize("valence", [3, 4, 5, 6, 7, 8, 12, 64])
def test_depths_are_the_formulas(valence: int) -> None:
    """Of all faces of closed meshes, and of those inside an open one; limit vertices need no more levels."""
    cases = [(pole_mesh(valence), {3, valence}), (nets.refined(pole_mesh(valence), 1), {3, 4, valence})]
    if valence == 4:
        cases = [(build(meshes.bumpy(meshes.torus(12, 8), 0.1)), {4}), (build(meshes.fan(7, 4)), {4, 7})]
    for mesh, valences in cases:
        norms = nets.published_norms(mesh)
        assert {n for n, _ in norms.values()} == valences
        assert len(norms) == mesh.face_count or valences == {4, 7}
        for tolerance in (0.3, 0.2, 0.0123, 0.002, 0.00077, 0.000031):
            depths, limit = (face_depths(mesh, tolerance, "SECOND_ORDER", each).depths for each in VERTICES)
            expected = [nets.published_depth(*norm, tolerance) for norm in norms.values()]
            np.testing.assert_array_equal(depths[list(norms)], expected)
            assert np.all((limit <= depths)[list(norms)])


@pytest.mark.parametrize("valence", [3, 5, 8, 12])
def test_first_order_depths_are_its_formula(valence: int) -> None:
    points = np.random.default_rng(valence).normal(size=(2 * valence + 8, 3))
    longest = max(np.linalg.norm(points[a] - points[b]) for a, b in nets.net_edges(valence))
    z = {3: 1, 5: 25 / 18, 8: 25 / 18, 12: 2 * (144 - 96 + 46) / 144}[valence]
    for tolerance in (0.2, 0.0123, 0.00077):
        expected = max(0, ceil(log(2 * longest / (z * tolerance), 1 / first_order_rate(valence))))
        depths, limit = (face_depths(nets.net_mesh(points), tolerance, "FIRST_ORDER", each).depths for each in VERTICES)
        assert limit[0] <= depths[0] == expected


@pytest.mark.parametrize("method", ["CERTIFIED", "SHARP", "SECOND_ORDER"])
@both_vertices
def test_a_flat_regular_grid_needs_nothing(method: str, vertices: str) -> None:
    """Nothing is off there but by rounding, which second-order norms find as well; first-order ones see any edge."""
    mesh = build(meshes.grid(6, 5), smooth_corners=False)
    allowance, inside = rounding_allowance(mesh), [7, 8, 9, 10, 13, 14, 15, 16, 19, 20, 21, 22]
    for tolerance in (smallest_tolerance(mesh), 0.1):
        result = face_depths(mesh, tolerance, method, vertices)
        assert np.all(result.depths == 0)
        for bounds in (result.bounds, level_bounds(mesh, tolerance, method, vertices, 0)):
            assert np.all(bounds < 1e-9)
            assert np.all((bounds[inside] >= allowance) & (bounds[inside] < 2 * allowance))


QUADS = [name for name, data in meshes.AWKWARD.items() if np.all(data().face_sizes == 4)]
OPEN = ("landscape", "single quad", "bow tie", "landscape with random creases", "collapsed n-gons")


@cache
def sampled(name: str, vertices: str, *, smooth_corners: bool = False) -> tuple[PolygonMesh, FloatArray]:
    """The mesh, and (LEVELS, F) distances by brute force."""
    mesh = build(meshes.AWKWARD[name](), smooth_corners=smooth_corners)
    levels = Levels(mesh)
    return mesh, np.array([levels.distances(level, vertices, 2) for level in range(LEVELS)])


SHORT = [*((name, False) for name in meshes.AWKWARD), *((name, True) for name in OPEN)]


@pytest.mark.parametrize(
    ("name", "smooth_corners", "vertices"),
    cases(
        product(meshes.AWKWARD, [False, True], VERTICES),
        [(*one, vertices) for one, vertices in zip(SHORT, cycle(VERTICES), strict=False)],
    ),
)
@every_method
def test_every_face_has_a_depth_and_is_no_farther_than_proved(
    name: str, smooth_corners: bool, method: str, vertices: str
) -> None:
    """Facets against the limit surface on all faces of depths up to 3."""
    mesh, distances = sampled(name, vertices, smooth_corners=smooth_corners)
    faces, allowance = np.arange(mesh.face_count), rounding_allowance(mesh)
    shallower, seen = np.zeros(mesh.face_count, dtype=int), 0
    for tolerance in (1000.0, 2.0, 0.5, 0.1, 0.03):
        result = face_depths(mesh, tolerance, method, vertices)
        assert result.depths.shape == result.bounds.shape == (mesh.face_count,)
        assert result.depths.dtype == np.int32
        # Finer tolerances never make a depth less.
        assert np.all((result.depths >= shallower) & (result.depths < 60))
        shallower = result.depths
        # By norms n-gons are never left as they are.
        assert method == "CERTIFIED" or np.all(result.depths[mesh.face_sizes != 4] >= 1)
        # No bound is nearer to what is reached than the allowance for rounding, but where it is the tolerance itself.
        assert np.all(result.bounds >= np.minimum(result.distances + allowance, tolerance))
        assert np.all(result.bounds <= tolerance)
        # Every level is near enough where that is proved, and for lasting faces from their depths on.
        for level in range(LEVELS if tolerance in (0.5, 0.03) else 0):
            bounds = level_bounds(mesh, tolerance, method, vertices, level)
            assert np.all((distances[level] <= bounds) & (bounds >= allowance))
            assert np.all((bounds <= tolerance) | np.isinf(bounds))
            due = result.lasting & (result.depths <= level)
            assert np.all(distances[level][due] <= tolerance)
            assert np.all(np.isfinite(bounds[due | (result.depths == level)]))
        shallow = result.depths < LEVELS
        at_depth = distances[np.minimum(result.depths, LEVELS - 1), faces]
        assert np.all(at_depth[shallow] <= result.bounds[shallow])
        seen += np.count_nonzero(shallow) if tolerance < 1000.0 else 0
    assert seen


SETTINGS = list(product([0.3, 0.0007], ["SECOND_ORDER", "FIRST_ORDER"], VERTICES))


# In the short suite those in which each meets each of the others.
@pytest.mark.parametrize(("tolerance", "method", "vertices"), cases(SETTINGS, [SETTINGS[i] for i in (0, 3, 5, 6)]))
def test_irregular_faces_are_as_deep_as_their_patches(tolerance: float, method: str, vertices: str) -> None:
    """Where all the descendants of a face after s steps have come from patches: s, or as deep as the deepest patch and
    the steps to it."""
    counted = 0
    for name, data in meshes.AWKWARD.items():
        mesh = build(data(), smooth_corners=False)
        found = face_depths(mesh, tolerance, method, vertices).depths
        fine, bases, known = mesh, np.arange(mesh.face_count), np.zeros(mesh.face_count, dtype=bool)
        expected, complete = np.zeros(mesh.face_count, dtype=int), np.zeros(mesh.face_count, dtype=bool)
        for steps in range(4):
            new = (classify_patches(fine).kinds != PatchKind.IRREGULAR) & ~known
            if np.any(new):
                depths = face_depths(fine, tolerance, method, vertices).depths
                np.maximum.at(expected, bases[new], steps + depths[new])
            known |= new
            now = (np.bincount(bases, ~known) == 0) & ~complete
            # Supports may prove from level 2 on what has no patches yet.
            early = (found >= 2) & (found < steps)
            assert np.all((found == np.maximum(expected, steps)) | early | ~now), name
            counted += np.count_nonzero(now) if steps else 0
            complete |= now
            if np.all(complete):
                break
            bases, known = bases[fine.corner_faces], known[fine.corner_faces]
            fine = subdivide(fine)
    assert counted > 30


TOLERANCE = 0.0123


@cache
def everything() -> meshes.MeshData:
    """One mesh with all kinds of faces."""
    parts = [
        meshes.with_random_creases(meshes.landscape(6, 6), share=0.15),
        meshes.bumpy(meshes.cylinder(7), 0.1),
        meshes.bumpy(meshes.sphere(5, 2), 0.1),
        meshes.with_random_creases(meshes.face_soup(), share=0.1),
        meshes.fan(12),
        meshes.fan(5, 3),
        meshes.valence_two(),
    ]
    moved = [meshes.moved(part, 9.0 * number) for number, part in enumerate(parts)]
    return reduce(lambda whole, part: meshes.welded(whole, part, {}), moved)


@cache
def expected_of(method: str, vertices: str) -> FaceDepths:
    return face_depths(build(everything()), TOLERANCE, method, vertices)


def assert_same(found: FaceDepths, expected: FaceDepths, order: object = slice(None)) -> None:
    np.testing.assert_array_equal(found.depths, expected.depths[order])
    np.testing.assert_array_equal(found.exact, expected.exact[order])
    np.testing.assert_allclose(found.bounds, expected.bounds[order], rtol=1e-9, atol=1e-12)


@every_method
@both_vertices
def test_size_place_turn_and_side_do_not_matter(method: str, vertices: str) -> None:
    data = everything()
    mesh, expected = build(data), expected_of(method, vertices)
    assert len(np.unique(expected.depths)) > 3
    # A power of two changes nothing but the unit, to the last bit.
    for scale in (2.0**-30, 2.0**30):
        found = face_depths(mesh.changed(positions=mesh.positions * scale), TOLERANCE * scale, method, vertices)
        np.testing.assert_array_equal(found.depths, expected.depths)
        np.testing.assert_array_equal(found.bounds, scale * expected.bounds)
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    placed = mesh.changed(positions=mesh.positions @ turn + [3.0, -20.0, 7.0])
    # Rounding, and the allowance for it, grow with the distance from the origin.
    found = face_depths(placed, TOLERANCE, method, vertices)
    np.testing.assert_array_equal(found.depths, expected.depths)
    np.testing.assert_allclose(found.bounds, expected.bounds, rtol=1e-9, atol=1e-10)
    turned_over = meshes.from_faces(data.positions, [face[::-1] for face in data.faces])
    other_side = build(meshes.creased(turned_over, data.edge_creases, data.vertex_creases))
    assert_same(face_depths(other_side, TOLERANCE, method, vertices), expected)


@every_method
def test_order_and_beginning_of_faces_do_not_matter(method: str) -> None:
    data, generator = everything(), np.random.default_rng(1)
    order = generator.permutation(len(data.faces))
    number = generator.permutation(len(data.positions))
    turned = [np.roll(number[data.faces[face]], generator.integers(9)).tolist() for face in order.tolist()]
    shuffled = replace(
        meshes.from_faces(data.positions[np.argsort(number)], turned),
        edge_creases={(int(number[a]), int(number[b])): crease for (a, b), crease in data.edge_creases.items()},
        vertex_creases={int(number[v]): crease for v, crease in data.vertex_creases.items()},
    )
    found = face_depths(build(shuffled), TOLERANCE, method, "CONTROL")
    assert_same(found, expected_of(method, "CONTROL"), order)


@every_method
@both_vertices
def test_progress_rises_to_the_end_and_may_stop_it(method: str, vertices: str) -> None:
    """The mesh is left as it was."""
    mesh, expected = build(everything()), expected_of(method, vertices)
    arrays = [mesh.positions, mesh.corner_vertices, mesh.corner_edges, mesh.edge_sharpness, mesh.vertex_sharpness]
    before = [array.copy() for array in arrays]
    with pytest.raises(LookupError):
        face_depths(mesh, TOLERANCE, method, vertices, Mock(side_effect=LookupError))
    fractions: list[float] = []
    result = face_depths(mesh, TOLERANCE, method, vertices, fractions.append)
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] == 1
    np.testing.assert_array_equal(result.depths, expected.depths)
    np.testing.assert_array_equal(result.bounds, expected.bounds)
    for array, copy in zip(arrays, before, strict=True):
        np.testing.assert_array_equal(array, copy)


@every_method
def test_tolerances_that_decide_nothing(method: str) -> None:
    for tolerance in (0.0, -0.1, np.nan, np.inf, -np.inf, 1e-12):
        with pytest.raises(ToleranceError, match="tolerance"):
            face_depths(build(meshes.cube()), tolerance, method, "CONTROL")
    mesh = build(meshes.trapezohedron(5))
    least = smallest_tolerance(mesh)
    # Single precision tells apart multiples of 2⁻²³ below 2; nothing smaller can mean anything at coordinates of 1. The
    # law has 16.5 roundings of 2⁻²⁴ at poles of five quads, for coordinates up to 1.7 long.
    assert 2**-24 < least < 1.75 * 16.5 * 2**-24
    assert np.all(face_depths(mesh, least, method, "CONTROL").bounds <= least)
    with pytest.raises(ToleranceError):
        face_depths(mesh, 0.99 * least, method, "CONTROL")
    assert smallest_tolerance(mesh.changed(positions=1000 * mesh.positions)) == pytest.approx(1000 * least)


def test_vertices_without_faces_do_not_count() -> None:
    data = meshes.trapezohedron(5)
    lost = np.array([[1e9, 0, 0], [np.nan, np.inf, 0]])
    with_lost = build(replace(data, positions=np.concatenate([data.positions, lost])))
    for method in ("SECOND_ORDER", "DISTANCE"):
        expected, found = (face_depths(mesh, 0.001, method, "CONTROL") for mesh in (build(data), with_lost))
        np.testing.assert_array_equal(found.depths, expected.depths)
    assert smallest_tolerance(with_lost) == smallest_tolerance(build(data))


def with_position(value: list[float]) -> meshes.MeshData:
    data = meshes.cube()
    return replace(data, positions=np.where((np.arange(8) == 3)[:, None], value, data.positions))


BAD_MESHES = {
    "nan": with_position([np.nan, 0, 0]),
    "infinity": with_position([0, np.inf, 0]),
    "repeated vertex": meshes.from_faces(meshes.grid(2, 1).positions, [[0, 1, 4, 3], [1, 2, 1, 4]]),
    "repeated neighbour": meshes.from_faces(meshes.grid(2, 1).positions, [[0, 1, 4, 3], [1, 2, 5, 5]]),
    "one point": meshes.from_faces(np.ones((4, 3)), [[0, 1, 2, 3]]),
    "one point and a loose vertex": meshes.from_faces([*np.ones((4, 3)), [2, 0, 0]], [[0, 1, 2, 3]]),
}


@every_method
def test_bad_meshes_are_refused(method: str) -> None:
    for data in BAD_MESHES.values():
        with pytest.raises(InvalidMeshError):
            face_depths(build(data), 0.1, method, "CONTROL")
    empty = polygon_mesh(np.zeros((2, 3)), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    with pytest.raises(InvalidMeshError, match="no faces"):
        face_depths(empty, 0.1, method, "CONTROL")


def test_unknown_names_are_refused() -> None:
    mesh = build(meshes.cube())
    for names in (("NONE", "CONTROL"), ("SECOND_ORDER", "NONE")):
        with pytest.raises(ValueError, match="NONE"):
            face_depths(mesh, 0.1, *names)
    assert set(METHODS) >= {Method.SECOND_ORDER, Method.FIRST_ORDER}
    assert set(VERTICES) == {Vertices.CONTROL, Vertices.LIMIT}


# Seconds of processor time: ten times what was measured, and a fifth of what it was with a report for each level.
LONGEST = 1.0


def test_first_order_around_a_large_pole() -> None:
    mesh = meshes.to_polygon_mesh(meshes.trapezohedron(5000))
    times: list[float] = []

    def note(fraction: float) -> None:
        times.append(process_time())
        if len(times) > 60:
            raise LookupError(fraction)

    with pytest.raises(LookupError):
        face_depths(mesh, 0.01, "FIRST_ORDER", "CONTROL", note)
    assert max(after - before for before, after in itertools.pairwise(times)) < LONGEST
