# SPDX-License-Identifier: GPL-3.0-or-later
"""The certified depth against brute force, and its formulas against splines refined step by step."""

import tracemalloc
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices
from ccdepth_addon.core.bounds.rounding import rounding_allowance, smallest_tolerance
from ccdepth_addon.core.depth.face_depths import VERTICES, face_depths
from ccdepth_addon.core.depth.tolerance import FaceDepths
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.validation import InvalidMeshError
from tests import brute_force, meshes, nets
from tests.core.test_face_depths import both_vertices
from tests.core.test_norm_bounds import fan_positions
from tests.meshes import build, diagonal
from tests.thorough import combinations


def certified(mesh: PolygonMesh, tolerance: float, vertices: str) -> FaceDepths:
    return face_depths(mesh, tolerance, "CERTIFIED", vertices)


CASES = meshes.AWKWARD | {
    "torus": lambda: meshes.torus(8, 5),
    **{f"valence {n}": (lambda n=n: meshes.fan(n)) for n in (2, 3, 5, 6, 7, 8, 12)},
    "valence 64": lambda: meshes.fan(64, 1),
    "valences 3 and 9": lambda: meshes.bumpy(meshes.trapezohedron(9), 0.05),
}
# Those that have corners to make round.
OPEN = ("valence 5", "landscape", "landscape with random creases", "flipped face")

# Those with creases, or edges that count as creases: there bounds may miss the least depth by more than a level.
SHARP = [name for name in CASES if any(word in name for word in ("crease", "two cubes", "bow", "fin", "flip", "soup"))]

# Levels of samples below the facets'.
DEEPER = 3


@pytest.mark.parametrize(("half", "vertices"), combinations([0, 1], VERTICES))
def test_depths_are_the_least_ones(half: int, vertices: str) -> None:
    """Never below the least depth, and on 99.5 % of all the faces equal to it; wherever it is said to be exact."""
    total = brute_force.Comparison()
    for name, smooth_corners in [*((name, False) for name in CASES), *((name, True) for name in OPEN)][half::2]:
        mesh = build(CASES[name](), smooth_corners=smooth_corners)
        measured = brute_force.Levels(mesh)
        levels = 3 if mesh.face_count < 15 else 2 if mesh.face_count < 60 else 1
        sampled = np.array([measured.distances(level, vertices, DEEPER) for level in range(levels + 1)])
        before = np.zeros(mesh.face_count, dtype=int)
        for relative in (1.0, 0.1, 0.03, 0.01, 0.003, 0.001, 1e-4):
            tolerance = relative * diagonal(mesh)
            found = certified(mesh, tolerance, vertices)
            assert np.all(found.depths >= before), name
            before = found.depths
            # The proved distance is no less than any sample, and what is said to be reached can be found.
            assert np.all((found.distances <= found.bounds) & (found.bounds <= tolerance)), name
            for level, distances in enumerate(sampled):
                here = found.depths == level
                assert np.all(distances[here] <= found.bounds[here]), name
                # Samples miss the largest distance; the search for it ends, too, somewhat below it.
                missed = np.flatnonzero(here & (found.distances > distances * (1 + 1e-9) + 1e-12))
                if len(missed):
                    closely = brute_force.reached(mesh, missed, level, vertices)
                    assert np.all(found.distances[missed] <= closely * (1 + 1e-3) + 1e-12), name
            if relative == 1e-4:
                # Fine tolerances end; their depths are beyond what is sampled.
                continue
            compared = brute_force.compare(mesh, sampled, found, tolerance, vertices)
            assert compared.below == 0, name
            assert compared.wrongly_exact == 0, name
            assert compared.more_above == 0 or name in SHARP, name
            if relative == 1.0:
                # A tolerance as large as the mesh.
                assert np.all((found.depths == 0) & found.exact), name
            else:
                total += compared
    assert total.faces > 1000
    assert total.equal_share >= 0.995


def assert_patch_is_safe(points: FloatArray, tolerance: float, vertices: str) -> None:
    mesh, face = nets.net_mesh(points), np.array([0])
    found = certified(mesh, max(tolerance, smallest_tolerance(mesh)), vertices)
    depth, bound, distance = int(found.depths[0]), found.bounds[0], found.distances[0]
    assert distance <= bound <= max(tolerance, smallest_tolerance(mesh))
    if depth <= 5:
        closely = float(brute_force.reached(mesh, face, depth, vertices)[0])
        assert closely <= bound
        assert distance <= closely * (1 + 1e-3) + 1e-12
        if found.exact[0] and depth:
            # The search ends somewhat below the largest distance.
            assert brute_force.reached(mesh, face, depth - 1, vertices)[0] > tolerance * (1 - 1e-3)


@st.composite
def patch_points(draw: st.DrawFn) -> FloatArray:
    """(2n + 8, 3): any points at all, or some off a flat net by less and less."""
    valence = draw(st.integers(3, 12))
    count = 2 * valence + 8
    seed = draw(st.integers(0, 2**32 - 1))
    scale = draw(st.sampled_from([1.0, 0.3, 0.01]))
    drawn = np.random.default_rng(seed).uniform(-1, 1, (count, 3))
    few = draw(arrays(np.float64, (4, 3), elements=st.floats(-1, 1, width=32)))
    drawn[draw(st.lists(st.integers(0, count - 1), min_size=4, max_size=4, unique=True))] = few
    return drawn if scale == 1.0 else fan_positions(valence) + scale * drawn


@given(points=patch_points(), exponent=st.floats(-3, 0.3), vertices=st.sampled_from(list(Vertices)))
def test_random_patches(points: FloatArray, exponent: float, vertices: str) -> None:
    with suppress(InvalidMeshError):
        assert_patch_is_safe(points, 10**exponent, vertices)


@both_vertices
@pytest.mark.parametrize("valence", [64, 360])
def test_random_patches_of_large_valence(valence: int, vertices: str) -> None:
    points = np.random.default_rng(valence).uniform(-1, 1, (2 * valence + 8, 3))
    for tolerance in (0.5, 0.1):
        assert_patch_is_safe(points, tolerance, vertices)


@both_vertices
def test_tolerances_next_to_the_distance(vertices: str) -> None:
    """Just below the distance of its facets a face needs a level more, just above it none."""
    for data in (meshes.cube(), meshes.fan(5), meshes.torus(7, 5)):
        mesh = build(data, smooth_corners=False)
        for level in range(2):
            distance = float(brute_force.reached(mesh, np.array([0]), level, vertices)[0])
            for share, depth in ((0.999, level + 1), (0.99999, level + 1), (1.001, level)):
                assert certified(mesh, share * distance, vertices).depths[0] == depth


@both_vertices
def test_planar_n_gons_need_nothing_where_it_is_true(vertices: str) -> None:
    """A hexagon in a plane, with quads around it, whose parameters are not evenly spaced."""
    angles = np.pi / 3 * np.arange(6)
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(6)])
    quads = [[i, 6 + i, 6 + (i + 1) % 6, (i + 1) % 6] for i in range(6)]
    mesh = build(meshes.from_faces(np.concatenate([ring, 2 * ring]), [list(range(6)), *quads]), smooth_corners=False)
    sampled = np.array([brute_force.Levels(mesh).distances(level, vertices, 5) for level in range(2)])
    for tolerance in (0.2, 0.02):
        compared = brute_force.compare(mesh, sampled, certified(mesh, tolerance, vertices), tolerance, vertices)
        assert compared.equal == compared.faces
    assert np.all(certified(mesh, 1.001 * sampled[0].max(), vertices).depths == 0)


@pytest.mark.parametrize(("vertices", "distance"), [("CONTROL", 1 / 3), ("LIMIT", 1 / 4)])
def test_tolerances_that_are_the_distance(vertices: str, distance: float) -> None:
    """Over z = x² all facets are as far from the surface, along a line in each of them: no bound tells the two apart.

    One level more is the price, and neither time nor memory.
    """
    mesh = build(meshes.bent(meshes.grid(24, 24), lambda x, y, _: (x, y, x**2)), smooth_corners=False)
    for level in range(4):
        tracemalloc.start()
        found = certified(mesh, distance / 4**level, vertices)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert np.all(found.depths <= level + 1)
        assert peak < 400e6


def test_rounding_decides_no_level() -> None:
    """Quads of a paraboloid z = (x² + y²) / 8 are off by 1/16 at their middles, and by a quarter of it at level 1."""
    mesh = build(meshes.bent(meshes.grid(5, 5), lambda x, y, _: (x, y, (x * x + y * y) / 8)))
    distance, allowance, middle = 1 / 64, rounding_allowance(mesh), 12
    for beyond, depth, is_exact in ((-2.0, 2, True), *((near, 2, False) for near in (-0.5, 0.0, 0.5)), (2.0, 1, True)):
        found = certified(mesh, distance + beyond * allowance, "LIMIT")
        assert (found.depths[middle], found.exact[middle]) == (depth, is_exact), beyond
