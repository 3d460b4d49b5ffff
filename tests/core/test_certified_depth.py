# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth against brute force, and its formulas against splines refined step by step."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.facet_bounds import facet_error, later_bounds, sampled_error
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.bounds.rounding import smallest_tolerance
from ccdepth_addon.core.depth import certified_depth
from ccdepth_addon.core.depth.face_depths import VERTICES, DepthResult, face_depths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from ccdepth_addon.core.surface.bicubic import (
    HALVES,
    SPLINE_HALVES,
    bilinear_coefficients,
    both_ways,
    patch_coefficients,
)
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from ccdepth_addon.core.surface.stencils import apply_stencils, patch_stencils
from tests import brute_force, meshes, nets

both_vertices = pytest.mark.parametrize("vertices", VERTICES)


def build(data: meshes.MeshData, smooth_corners: bool = False) -> PolygonMesh:
    return apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=smooth_corners)


def certified(mesh: PolygonMesh, tolerance: float, vertices: str) -> DepthResult:
    return face_depths(mesh, tolerance, "CERTIFIED", vertices)


def diagonal(mesh: PolygonMesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.positions, axis=0)))


# Meshes, with the number of levels that are measured by brute force

SMOOTH: dict[str, tuple[Callable[[], meshes.MeshData], int]] = {
    "cube": (meshes.cube, 3),
    "torus": (lambda: meshes.torus(8, 5), 2),
    "valence 2": (lambda: meshes.fan(2), 3),
    "valence 3": (lambda: meshes.fan(3), 3),
    "valence 5": (lambda: meshes.fan(5), 3),
    "valence 6": (lambda: meshes.fan(6), 3),
    "valence 7": (lambda: meshes.fan(7), 2),
    "valence 8": (lambda: meshes.fan(8), 2),
    "valence 12": (lambda: meshes.fan(12), 2),
    "valence 64": (lambda: meshes.fan(64, 1), 1),
    "valences 3 and 9": (lambda: meshes.bumpy(meshes.trapezohedron(9), 0.05), 3),
    "cylinder": (lambda: meshes.cylinder(7), 3),
    "triangles": (lambda: meshes.bumpy(meshes.bipyramid(5), 0.1), 3),
    "triangles and quads": (meshes.triangles_and_quads, 3),
    "landscape": (lambda: meshes.landscape(6, 6), 2),
}
SHARP: dict[str, tuple[Callable[[], meshes.MeshData], int]] = {
    "creased cube": (meshes.creased_cube, 3),
    "corner creased cube": (meshes.corner_creased_cube, 3),
    "creased landscape": (lambda: meshes.with_random_creases(meshes.landscape(5, 5)), 2),
    "creased cylinder": (lambda: meshes.with_random_creases(meshes.cylinder(6), share=0.6), 3),
    "creased valence 2": (lambda: meshes.with_random_creases(meshes.valence_two(), seed=5, share=0.8), 2),
    "two cubes": (meshes.two_cubes_sharing_an_edge, 3),
    "fin through": (meshes.fin_through, 2),
    "flipped face": (meshes.flipped_face, 2),
    "soup": (meshes.face_soup, 2),
    "creased soup": (lambda: meshes.with_random_creases(meshes.face_soup(2), seed=2, share=0.1), 2),
}
# Those that have corners to make round.
OPEN = ("valence 5", "landscape", "creased landscape", "flipped face")

RELATIVE_TOLERANCES = (0.1, 0.03, 0.01, 0.003, 0.001)

# Levels of samples below the facets'.
DEEPER = 3


@both_vertices
def test_depths_are_the_least_ones(vertices: str) -> None:
    """Never below the least depth, and on 99.5 % of all the faces equal to it; wherever it is said to be exact."""
    total = brute_force.Comparison()
    cases = SMOOTH | SHARP
    for name, smooth_corners in [*((name, False) for name in cases), *((name, True) for name in OPEN)]:
        data, levels = cases[name]
        mesh = build(data(), smooth_corners)
        measured = brute_force.Levels(mesh)
        sampled = np.array([measured.distances(level, vertices, DEEPER) for level in range(levels + 1)])
        for relative in RELATIVE_TOLERANCES:
            tolerance = relative * diagonal(mesh)
            found = certified(mesh, tolerance, vertices)
            compared = brute_force.compare(mesh, sampled, found, tolerance, vertices)
            assert compared.below == 0, name
            assert compared.wrongly_exact == 0, name
            assert compared.more_above == 0 or name in SHARP, name
            assert_between_its_distances(mesh, sampled, found, tolerance, vertices)
            total += compared
    assert total.faces > 1500
    assert total.equal_share >= 0.995


def assert_between_its_distances(
    mesh: PolygonMesh, sampled: FloatArray, found: DepthResult, tolerance: float, vertices: str
) -> None:
    """The proved distance is no less than any sample, and what is said to be reached can be found."""
    assert np.all(found.bounds <= tolerance)
    assert np.all(found.distances <= found.bounds)
    for level, distances in enumerate(sampled):
        here = found.depths == level
        assert np.all(distances[here] <= found.bounds[here])
        # Samples miss the largest distance; the search for it ends, too, somewhat below it.
        missed = np.flatnonzero(here & (found.distances > distances * (1 + 1e-9) + 1e-12))
        if len(missed):
            closely = brute_force.reached(mesh, missed, level, vertices)
            assert np.all(found.distances[missed] <= closely * (1 + 1e-3) + 1e-12)


@both_vertices
@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("fan", lambda: meshes.fan(360, 1)),
        ("bipyramid", lambda: meshes.bumpy(meshes.bipyramid(360), 1e-3)),
    ],
)
def test_valence_360(name: str, data: Callable[[], meshes.MeshData], vertices: str) -> None:
    """On the facets of each depth, closely measured; a few dozen of the faces stand for all."""
    mesh = build(data())
    tolerance = 0.01 * diagonal(mesh)
    found = certified(mesh, tolerance, vertices)
    some = np.arange(mesh.face_count) % 23 == 0
    for level in np.unique(found.depths).tolist():
        faces = np.flatnonzero(some & (found.depths == level))
        if len(faces) and level < 5:
            assert np.all(brute_force.reached(mesh, faces, level, vertices) <= found.bounds[faces])
            disproved = faces[found.exact[faces]]
            if level and len(disproved):
                assert np.all(brute_force.reached(mesh, disproved, level - 1, vertices) > tolerance)


# Single patches


def patch_result(points: FloatArray, tolerance: float, vertices: str) -> tuple[PolygonMesh, int, float, float, bool]:
    """What is found of the patch of a net: its mesh, and depth, proved and reached distance, and exactness."""
    mesh = nets.net_mesh(points)
    found = certified(mesh, max(tolerance, smallest_tolerance(mesh)), vertices)
    return mesh, int(found.depths[0]), float(found.bounds[0]), float(found.distances[0]), bool(found.exact[0])


def assert_patch_is_safe(points: FloatArray, tolerance: float, vertices: str) -> None:
    mesh, depth, bound, distance, exact = patch_result(points, tolerance, vertices)
    assert distance <= bound <= max(tolerance, smallest_tolerance(mesh))
    if depth <= 5:
        closely = float(brute_force.reached(mesh, np.array([0]), depth, vertices)[0])
        assert closely <= bound
        assert distance <= closely * (1 + 1e-3) + 1e-12
        if exact and depth:
            before = brute_force.reached(mesh, np.array([0]), depth - 1, vertices)[0]
            # The search ends somewhat below the largest distance.
            assert before > tolerance * (1 - 1e-3)


valences = st.sampled_from([3, 4, 5, 6, 7, 8, 9, 10, 11, 12])
coordinates = st.floats(-1, 1, width=32)


@st.composite
def patch_points(draw: st.DrawFn) -> FloatArray:
    """(2n + 8, 3): any points at all, or some off a flat or curved net by less and less."""
    valence = draw(valences)
    count = 2 * valence + 8
    seed = draw(st.integers(0, 2**32 - 1))
    scale = draw(st.sampled_from([1.0, 0.3, 0.01]))
    drawn = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    few = draw(arrays(np.float64, (4, 3), elements=coordinates))
    drawn[draw(st.lists(st.integers(0, count - 1), min_size=4, max_size=4, unique=True))] = few
    if scale == 1.0:
        return drawn
    return flat_net(valence) + scale * drawn


def flat_net(valence: int) -> FloatArray:
    """(2n + 8, 3): a net laid out in a plane, its first ring regular."""
    angles = np.pi * np.arange(2 * valence) / valence
    # V₂ and every other one of the ring are spokes; V₄ and V₆ carry the patch.
    ring = np.column_stack([np.cos(-angles), np.sin(-angles), np.zeros(2 * valence)])
    ring[1::2] *= np.sqrt(2)
    points = np.concatenate([np.zeros((1, 3)), ring, np.zeros((7, 3))])
    v1, v6, v5, v4 = (points[nets.ring(valence, number) - 1] for number in (1, 6, 5, 4))
    v3, v7 = points[2], points[nets.ring(valence, 7) - 1]
    outer = [2 * v5 - v1, 2 * v5 - v4, 2 * v6 - v1, 2 * v7 - v6, 2 * v5 - v6, 2 * v4 - v1, 2 * v3 - v4]
    points[2 * valence + 1 :] = outer
    return points


@settings(max_examples=40, deadline=None)
@given(points=patch_points(), exponent=st.floats(-3, 0.3), vertices=st.sampled_from(VERTICES))
def test_random_patches(points: FloatArray, exponent: float, vertices: str) -> None:
    with suppress(InvalidMeshError):
        assert_patch_is_safe(points, 10**exponent, vertices)


@both_vertices
@pytest.mark.parametrize("valence", [64, 360])
def test_random_patches_of_large_valence(valence: int, vertices: str) -> None:
    generator = np.random.default_rng(valence)
    points = generator.uniform(-1, 1, (2 * valence + 8, 3))
    for tolerance in (0.5, 0.1):
        assert_patch_is_safe(points, tolerance, vertices)


@both_vertices
@pytest.mark.parametrize("share", [0.999, 0.99999, 1.001])
def test_tolerances_next_to_the_distance(share: float, vertices: str) -> None:
    """Just below the distance of its facets a face needs a level more, just above it none."""
    for data in (meshes.cube(), meshes.fan(5), meshes.torus(7, 5)):
        mesh = build(data)
        face = np.array([0])
        for level in range(2):
            distance = float(brute_force.reached(mesh, face, level, vertices)[0])
            found = certified(mesh, share * distance, vertices)
            assert found.depths[0] == (level if share > 1 else level + 1)


# Depth 0


@both_vertices
def test_planar_and_evenly_spaced_needs_nothing(vertices: str) -> None:
    for smooth_corners in (False, True):
        mesh = build(meshes.grid(7, 6), smooth_corners)
        found = certified(mesh, smallest_tolerance(mesh), vertices)
        round_corners = [0, 6, 35, 41] if smooth_corners else []
        np.testing.assert_array_equal(np.flatnonzero(found.depths), round_corners)
        assert np.all(found.exact[found.depths == 0])


@both_vertices
def test_planar_n_gons_need_nothing_where_it_is_true(vertices: str) -> None:
    """A hexagon in a plane, with quads around it, whose parameters are not evenly spaced."""
    data = flat_hexagon()
    mesh = build(data)
    for tolerance in (0.2, 0.02):
        sampled = np.array([brute_force.Levels(mesh).distances(level, vertices, 5) for level in range(2)])
        found = certified(mesh, tolerance, vertices)
        compared = brute_force.compare(mesh, sampled, found, tolerance, vertices)
        assert compared.equal == compared.faces
    far = sampled[0].max()
    assert np.all(certified(mesh, 1.001 * far, vertices).depths == 0)


def flat_hexagon() -> meshes.MeshData:
    """A hexagon in a plane, and a ring of quads around it."""
    angles = np.pi / 3 * np.arange(6)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    quads = [[i, 6 + i, 6 + (i + 1) % 6, (i + 1) % 6] for i in range(6)]
    return meshes.from_faces(np.concatenate([ring, 2 * ring]), [list(range(6)), *quads])


@both_vertices
def test_a_tolerance_as_large_as_the_mesh_needs_nothing(vertices: str) -> None:
    for name, (data, _) in (SMOOTH | SHARP).items():
        mesh = build(data())
        found = certified(mesh, diagonal(mesh), vertices)
        assert np.all(found.depths == 0), name
        assert np.all(found.exact), name


# What must not matter, and what must end


@both_vertices
@pytest.mark.parametrize("exponent", [-30, 30])
def test_tiny_and_huge_meshes(exponent: int, vertices: str) -> None:
    """A power of two changes nothing but the unit, to the last bit."""
    scale = 2.0**exponent
    for data in (meshes.fan(5), meshes.creased_cube(), meshes.cylinder(5)):
        mesh = build(data)
        scaled = build(replace(data, positions=scale * data.positions))
        expected, found = certified(mesh, 0.02, vertices), certified(scaled, 0.02 * scale, vertices)
        np.testing.assert_array_equal(found.depths, expected.depths)
        np.testing.assert_array_equal(found.bounds, scale * expected.bounds)


@both_vertices
def test_refining_the_mesh_itself_gives_the_same(vertices: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Patches of valences too large for stencils are refined with their neighbours instead."""
    cases = [meshes.fan(5), meshes.fan(12), meshes.bumpy(meshes.trapezohedron(9), 0.05), meshes.cylinder(7)]
    built = [build(data) for data in cases]
    expected = [certified(mesh, 0.01, vertices) for mesh in built]
    monkeypatch.setattr(certified_depth, "LARGEST_STENCIL_VALENCE", 2)
    for mesh, before in zip(built, expected, strict=True):
        found = certified(mesh, 0.01, vertices)
        np.testing.assert_array_equal(found.depths, before.depths)
        np.testing.assert_array_equal(found.exact, before.exact)


def parabolic(side: int) -> meshes.MeshData:
    """A grid over z = x², whose facets are all as far from the surface, along a line in each of them."""
    data = meshes.grid(side, side)
    x, y, _ = data.positions.T
    return meshes.MeshData(np.stack([x, y, x**2], axis=1), data.face_sizes, data.corner_vertices)


@pytest.mark.parametrize(("vertices", "distance"), [("CONTROL", 1 / 3), ("LIMIT", 1 / 4)])
def test_tolerances_that_are_the_distance(vertices: str, distance: float) -> None:
    """No bound tells the two apart, on any face. One level more is the price, and neither time nor memory."""
    mesh = build(parabolic(24))
    for level in range(4):
        tracemalloc.start()
        found = certified(mesh, distance / 4**level, vertices)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert np.all(found.depths <= level + 1)
        assert peak < 400e6


@both_vertices
def test_groups_of_undecided_pieces_do_not_matter(vertices: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [build(data) for data in (meshes.landscape(6, 6), meshes.fan(5), meshes.creased_cube())]
    expected = [certified(mesh, 0.01, vertices) for mesh in cases]
    monkeypatch.setattr(certified_depth, "MOST_PIECES", 3)
    for mesh, before in zip(cases, expected, strict=True):
        found = certified(mesh, 0.01, vertices)
        np.testing.assert_array_equal(found.depths, before.depths)
        np.testing.assert_array_equal(found.exact, before.exact)


@both_vertices
@pytest.mark.parametrize("name", [*SMOOTH, *SHARP])
def test_fine_tolerances_end(name: str, vertices: str) -> None:
    """Each of them ends, below the tolerance, with depths that do not fall."""
    mesh = build((SMOOTH | SHARP)[name][0]())
    before = np.zeros(mesh.face_count, dtype=int)
    for relative in (1e-2, 1e-4):
        tolerance = relative * diagonal(mesh)
        found = certified(mesh, tolerance, vertices)
        assert np.all(found.depths >= before)
        assert np.all((found.bounds <= tolerance) & (found.distances <= found.bounds))
        before = found.depths


# Formulas: nets (4, 4, P, 3), the splines refined by their own two-scale rule


def random_nets(count: int, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).uniform(-1, 1, (4, 4, count, 3))


def spline_weights(x: float) -> FloatArray:
    """(4,): the cubic B-splines of a segment."""
    return np.array([(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3]) / 6


def surface(net: FloatArray, u: float, v: float) -> FloatArray:
    """(P, 3): S(u, v)."""
    return np.einsum("i,j,ij...->...", spline_weights(u), spline_weights(v), net)


def refined_once(points: FloatArray) -> FloatArray:
    """The points of a cubic B-spline along the first axis with a knot between any two: n of them become 2n - 3."""
    finer = np.zeros((2 * len(points) - 3, *points.shape[1:]))
    finer[::2] = (points[:-1] + points[1:]) / 2
    finer[1::2] = (points[:-2] + 6 * points[1:-1] + points[2:]) / 8
    return finer


def vertices_of(net: FloatArray, vertices: str, levels: int) -> FloatArray:
    """(2ʲ + 1, 2ʲ + 1, P, 3): the vertices of the facets over the patch after so many levels."""
    points = net
    for _ in range(levels):
        points = refined_once(refined_once(points).swapaxes(0, 1)).swapaxes(0, 1)
    if vertices == "CONTROL":
        return points[1:-1, 1:-1]
    for _ in range(2):
        points = ((points[:-2] + 4 * points[1:-1] + points[2:]) / 6).swapaxes(0, 1)
    return points


def facet_point(corners: FloatArray, u: float, v: float) -> FloatArray:
    """(P, 3): the bilinear facet over its place in a grid of vertices."""
    count = len(corners) - 1
    i, j = (min(int(x * count), count - 1) for x in (u, v))
    s, t = u * count - i, v * count - j
    low = (1 - s) * corners[i, j] + s * corners[i + 1, j]
    high = (1 - s) * corners[i, j + 1] + s * corners[i + 1, j + 1]
    return (1 - t) * low + t * high


def distances(net: FloatArray, vertices: str, levels: int, steps: int) -> FloatArray:
    """(P,): the largest ‖L - S‖ at steps + 1 places each way in every facet."""
    corners = vertices_of(net, vertices, levels)
    weights = np.array([spline_weights(x) for x in np.linspace(0, 1, 2**levels * steps + 1)])
    values = np.einsum("ai,bj,ijpd->abpd", weights, weights, net)
    facets = corners
    for _ in range(2):
        between = [facets[:-1] + (facets[1:] - facets[:-1]) * s for s in np.arange(steps) / steps]
        inner = np.stack(between, axis=1).reshape(-1, *facets.shape[1:])
        facets = np.concatenate([inner, facets[-1:]]).swapaxes(0, 1)
    return np.linalg.norm(facets - values, axis=-1).max(axis=(0, 1))


def second_differences(net: FloatArray) -> FloatArray:
    """Along the first axis: (2, …) second derivatives at the knots, which are 1 apart."""
    return net[:-2] - 2 * net[1:-1] + net[2:]


def derivatives(net: FloatArray, u: float, v: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(P, 3) each: S_uu, S_vv, S_uuvv."""
    line_u, line_v = np.array([1 - u, u]), np.array([1 - v, v])
    along_u = second_differences(net)
    along_v = second_differences(net.swapaxes(0, 1)).swapaxes(0, 1)
    both = second_differences(along_u.swapaxes(0, 1)).swapaxes(0, 1)
    return (
        np.einsum("i,j,ij...->...", line_u, spline_weights(v), along_u),
        np.einsum("i,j,ij...->...", spline_weights(u), line_v, along_v),
        np.einsum("i,j,ij...->...", line_u, line_v, both),
    )


@both_vertices
@pytest.mark.parametrize("levels", [0, 1, 2, 3])
def test_the_closed_form(levels: int, vertices: str) -> None:
    """L - S as docs/methods.md has it, at random places."""
    net, h = random_nets(5), 0.5**levels
    corners = vertices_of(net, vertices, levels)
    for u, v in np.random.default_rng(2).uniform(0, 1, (40, 2)).tolist():
        (low_u, s, star_u, alpha), (low_v, t, star_v, beta) = (_weights(x, h, vertices) for x in (u, v))
        assert low_u + h * s == pytest.approx(u)
        assert low_v + h * t == pytest.approx(v)
        a = derivatives(net, star_u, v)[0]
        b = derivatives(net, u, star_v)[1]
        r = derivatives(net, star_u, star_v)[2]
        if vertices == "CONTROL":
            expected = -(h**2 / 6) * (alpha * a + beta * b) + h**4 / 36 * alpha * beta * r
        else:
            expected = h**2 / 8 * (alpha * a + beta * b) + h**4 / 64 * alpha * beta * r
        found = facet_point(corners, u, v) - surface(net, u, v)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def _weights(x: float, h: float, vertices: str) -> tuple[float, float, float, float]:
    """The facet's beginning, the place in it, the place between its knots that counts, and the weight α."""
    low = np.floor(x / h) * h
    s = (x - low) / h
    if vertices == "CONTROL":
        near, far = (1 - s) ** 3, s**3
    else:
        # E_u: the inner cubic Bernsteins, each taking a third of the other knot's derivative.
        first, second = 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s)
        near, far = (2 * first + second) * 4 / 9, (first + 2 * second) * 4 / 9
    return low, s, (low * near + (low + h) * far) / (near + far), near + far


@both_vertices
def test_the_weights_are_between_the_documented_limits(vertices: str) -> None:
    places = np.linspace(0, 1, 2001)[1:-1].tolist()
    found = np.array([_weights(s, 1.0, vertices) for s in places])
    s, star, alpha = found[:, 1], found[:, 2], found[:, 3]
    expected = (1 - s) ** 3 + s**3 if vertices == "CONTROL" else 4 * s * (1 - s)
    np.testing.assert_allclose(alpha, expected, atol=1e-12)
    mismatch = np.abs(alpha * (star - s)).max()
    largest = np.sqrt(3) / 18 * (1 if vertices == "CONTROL" else 4 / 3)
    assert 0.999 * largest < mismatch <= largest * (1 + 1e-12)


@both_vertices
@pytest.mark.parametrize("levels", range(6))
def test_bounds_and_samples_of_later_levels(levels: int, vertices: str) -> None:
    """Between the sampled and the proved distance lies the true one."""
    net = np.concatenate([random_nets(40), smooth_nets(40)], axis=2)
    kind = Vertices(vertices)
    upper = later_bounds(net, kind).at(levels)
    lower = sampled_error(net, kind, levels)
    dense = distances(net, vertices, levels, 16 if levels < 3 else 8)
    assert np.all(dense <= upper * (1 + 1e-12))
    # Between samples at 16ths (8ths) of a facet a distance can be larger by about a hundredth (some hundredths).
    assert np.all(lower <= dense * (1.015 if levels < 3 else 1.05))
    # On nets like those of modelled surfaces the two meet, the closer the more levels follow.
    smooth = slice(40, None)
    assert np.median(upper[smooth] / dense[smooth]) < 1 + 0.5 * 0.6**levels
    assert np.median(dense[smooth] / lower[smooth]) < 1.1


def smooth_nets(count: int) -> FloatArray:
    """Nets of gently curved surfaces, a little uneven."""
    generator = np.random.default_rng(7)
    i, j = np.mgrid[:4, :4]
    bent = generator.uniform(-0.3, 0.3, (3, count))
    heights = bent[0] * (i**2)[..., None] + bent[1] * (j**2)[..., None] + bent[2] * (i * j)[..., None]
    flat = [np.broadcast_to(x[..., None], heights.shape) for x in (i, j)]
    return np.stack([*flat, heights], axis=-1) + generator.uniform(-0.02, 0.02, (4, 4, count, 3))


@both_vertices
def test_the_error_of_an_own_facet(vertices: str) -> None:
    net = random_nets(6)
    corners = vertices_of(net, vertices, 0)
    coefficients = facet_error(net, Vertices(vertices))
    for u, v in np.random.default_rng(3).uniform(0, 1, (20, 2)).tolist():
        expected = surface(net, u, v) - facet_point(corners, u, v)
        np.testing.assert_allclose(bernstein(coefficients, u, v), expected, atol=1e-12)


def bernstein(coefficients: FloatArray, u: float, v: float) -> FloatArray:
    """(P, 3): the value of (4, 4, P, 3) Bernstein coefficients."""
    along_u, along_v = (np.array([(1 - x) ** 3, 3 * x * (1 - x) ** 2, 3 * x**2 * (1 - x), x**3]) for x in (u, v))
    return np.einsum("i,j,ij...->...", along_u, along_v, coefficients)


def test_coefficients_and_halves() -> None:
    """Patches and bilinear facets in Bernstein form, and both forms cut in four."""
    net = random_nets(7)
    coefficients = patch_coefficients(net)
    corners = np.random.default_rng(5).uniform(-1, 1, (4, 7, 3))
    square = corners[[[0, 3], [1, 2]]]
    nets_of_quarters = both_ways(SPLINE_HALVES, net)
    quarters = both_ways(HALVES, coefficients)
    np.testing.assert_allclose(patch_coefficients(nets_of_quarters), quarters, atol=1e-12)
    for u, v in np.random.default_rng(6).uniform(0, 1, (20, 2)).tolist():
        np.testing.assert_allclose(bernstein(coefficients, u, v), surface(net, u, v), atol=1e-12)
        facet = bernstein(bilinear_coefficients(corners), u, v)
        np.testing.assert_allclose(facet, facet_point(square, u, v), atol=1e-12)
        for number, (a, b) in enumerate([(0, 0), (0, 1), (1, 0), (1, 1)]):
            of_quarter = bernstein(quarters[:, :, 7 * number : 7 * (number + 1)], u, v)
            expected = surface(net, (a + u) / 2, (b + v) / 2)
            np.testing.assert_allclose(of_quarter, expected, atol=1e-12)


# Stencils


@pytest.mark.parametrize("valence", [3, 5, 8, 64, 360])
def test_stencils_are_one_subdivision(valence: int) -> None:
    """The nets of the four children, and the corners' limits, against those read off the refined mesh."""
    mesh = build(meshes.fan(valence, 3))
    faces = np.flatnonzero(classify_patches(mesh).kinds == PatchKind.EXTRAORDINARY)
    corners = classify_patches(mesh).extraordinary_corners[faces]
    assert np.all(mesh.corner_vertices[corners] == 0)
    around = corners[:, None] + np.arange(4)
    fine = subdivide(mesh).mesh
    net = extraordinary_nets(mesh, corners, valence)
    stencils = patch_stencils(valence)
    # The child at a corner has the corner's number.
    refined = extraordinary_nets(fine, 4 * corners, valence)
    np.testing.assert_allclose(apply_stencils(stencils.refined, net), refined, atol=1e-12)
    regular = apply_stencils(stencils.regular, net).reshape(3, 4, 4, -1, 3)
    for child in range(3):
        np.testing.assert_allclose(regular[child], regular_nets(fine, around[:, child + 1]), atol=1e-12)
    limits = limit_positions(mesh)[mesh.corner_vertices[around.T]]
    np.testing.assert_allclose(apply_stencils(stencils.limits, net), limits, atol=1e-12)
    for matrix in (stencils.refined, stencils.regular, stencils.limits):
        assert matrix.min() > -1e-15
        np.testing.assert_allclose(matrix.sum(axis=1), 1, atol=1e-12)


def test_the_flat_net_is_flat() -> None:
    """The layout that random patches are off by: quads all turning the same way."""
    for valence in (3, 4, 5, 8, 12):
        mesh = nets.net_mesh(flat_net(valence))
        quads: NDArray[np.float64] = mesh.positions[mesh.corner_vertices].reshape(-1, 4, 3)
        turns = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])[:, 2]
        assert np.all(turns > 0) or np.all(turns < 0)
