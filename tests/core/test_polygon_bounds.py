# SPDX-License-Identifier: GPL-3.0-or-later
"""How thick polygons are, against ways to draw them: none is farther from the fan than that, nor the fan from it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.polygon_bounds import (
    HEIGHT_ROUNDING,
    line_turns,
    polygon_thickness,
)
from tests import polygon_loops as loops
from tests.drawn_levels import points_of
from tests.polygon_loops import Loop
from tests.thorough import each

ROUNDING = 1e-12

# So many triangulations are looked for, at random.
WAYS = 5

seeds = st.integers(0, 2**32 - 1)
# Quick, and few of the loops are nearly refused or nearly taken.
often = settings(max_examples=5 * settings().max_examples)
shapes = {
    "unevenness": st.sampled_from([0.0, 0.05, 0.2, 0.6]),
    "height": st.sampled_from([0.0, 0.05, 0.3, 1.0]),
    "bent_share": st.sampled_from([0.0, 0.4, 1.0]),
}


def assert_near(drawn: FloatArray, other: FloatArray, thickness: float) -> None:
    """Both ways, (T, 3, 3) each."""
    assert loops.farthest(points_of(drawn, loops.STEPS).reshape(-1, 3), other) <= thickness
    assert loops.farthest(other.reshape(-1, 3), drawn) <= thickness


@often
@given(seed=seeds, size=st.integers(5, 9), **shapes)
def test_a_region_is_a_polygon_that_never_meets_itself(
    seed: int, size: int, unevenness: float, height: float, bent_share: float
) -> None:
    """It can be cut into triangles that face its normal, and turns left but for middles that dent its sides; so
    whatever is not and does not is refused."""
    loop = loops.random_loop(seed, size, unevenness, height, bent_share)
    thickness, normal = loop.thickness()
    assert np.linalg.norm(normal) == pytest.approx(1)
    if np.isfinite(thickness):
        assert loops.is_simple(loop.vertices, normal)
        # Where middles lie on straight sides, cutting at random often ends with three of them in one line.
        assert unevenness == 0 or loops.drawn_ways(loop.vertices, normal, tries=20)
        assert thickness == pytest.approx(np.ptp(loop.vertices @ normal), abs=ROUNDING)


@often
@given(
    seed=seeds,
    size=st.integers(5, 12),
    unevenness=st.sampled_from([0.0, 0.05, 0.2]),
    height=st.sampled_from([0.0, 0.05, 0.3]),
)
def test_convex_polygons_are_regions(seed: int, size: int, unevenness: float, height: float) -> None:
    """Plain ones that turn left everywhere and go round once; all others are refused."""
    loop = loops.random_loop(seed, size, unevenness, height, bent_share=0.0)
    thickness, normal = loop.thickness()
    flat = loops.seen_along(loop.vertices, normal)
    around = np.stack([np.roll(flat, 1, axis=0), flat, np.roll(flat, -1, axis=0)], axis=1)
    convex = all(loops.doubled_area(corner) > 0 for corner in around) and loops.is_simple(loop.vertices, normal)
    assert np.isfinite(thickness) == convex


@given(seed=seeds, size=st.integers(5, 9), **shapes)
def test_no_way_to_draw_it_is_farther_from_the_fan_than_it_is_thick(
    seed: int, size: int, unevenness: float, height: float, bent_share: float
) -> None:
    loop = loops.random_loop(seed, size, unevenness, height, bent_share)
    thickness, normal = loop.thickness()
    if np.isfinite(thickness):
        fan = loops.facet_triangles(loop.facets)
        allowed = thickness + loops.twist_error(loop.facets) + ROUNDING
        for way in loops.drawn_ways(loop.vertices, normal, WAYS):
            assert_near(loop.vertices[np.array(way)], fan, allowed)


@often
@given(seed=seeds, size=st.integers(5, 9), tilt=st.floats(-2.0, 2.0), **shapes)
def test_a_fan_that_faces_a_direction_covers_a_region_once_along_it(
    seed: int, size: int, tilt: float, unevenness: float, height: float, bent_share: float
) -> None:
    """Also where the region is one along Blender's line alone: both directions are in a cone where the fan faces."""
    loop = loops.random_loop(seed, size, unevenness, height, bent_share)
    thickness, normal = loop.thickness(np.array([[1.0, tilt, 0.0], [0.0, 1.0, tilt], [0.0, 0.0, 1.0]]))
    spokes = loops.seen_along(loop.vertices - loop.corners.mean(axis=0), normal)
    following = np.roll(spokes, -1, axis=0)
    sines = spokes[:, 0] * following[:, 1] - spokes[:, 1] * following[:, 0]
    if np.isfinite(thickness) and (sines > 0).all():
        assert np.arctan2(sines, (spokes * following).sum(axis=1)).sum() == pytest.approx(2 * np.pi)


UNEVEN = np.array([[1.0, 0.0, 30.0], [0.0, 1.0, -20.0], [0.0, 0.0, 1.0]])

# Too uneven for Blender's triangles to be known.
TOO_UNEVEN = np.diag([1.0, 1.0, 1e-5])


@pytest.mark.parametrize("seed", each(range(60), range(20)))
def test_whatever_triangles_are_drawn(seed: int) -> None:
    """Between the vertices of a polygon: one ear after another is cut off, wherever it is."""
    loop = loops.random_loop(seed, 5 + seed % 5, 0.1, 0.05, bent_share=0.5)
    bound, _ = loop.thickness(TOO_UNEVEN)
    assert_near(
        loop.vertices[np.array(loops.cut(len(loop.vertices), np.random.default_rng(seed)))],
        loops.facet_triangles(loop.facets),
        bound + loops.twist_error(loop.facets) + ROUNDING,
    )
    assert np.isfinite(bound) or np.any(loop.bent)


def dented(*offset: float) -> Loop:
    """The unit square, the middle of its first side moved by so much."""
    square = loops.plain(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]))
    square.middles[0] += np.array(offset)
    return Loop(square.corners, square.middles, np.arange(4) == 0)


def test_a_dent_counts_unless_blender_is_known_to_see_it() -> None:
    loop, reach = dented(0.0, 0.1, 0.0), np.hypot(0.5, 0.5)
    line = UNEVEN @ UNEVEN.T @ [0, 0, 1]
    cosine = line[2] / np.linalg.norm(line)
    # A flat polygon has no thickness but its rounding, which grows where Blender's line of sight is tilted.
    assert loop.thickness()[0] == pytest.approx(HEIGHT_ROUNDING * reach, rel=1e-9, abs=0)
    assert loop.thickness(UNEVEN)[0] == pytest.approx(HEIGHT_ROUNDING * reach / cosine, rel=1e-9, abs=0)
    assert loop.thickness(TOO_UNEVEN)[0] == pytest.approx(0.1)


@pytest.mark.parametrize("stretch", [1.0, 20.0, 346.0])
@pytest.mark.parametrize("offset", [0.0, 3.0, 370.0])
def test_lines_are_as_near_to_blender_s_as_told(stretch: float, offset: float) -> None:
    """Blender's sum of Newell, in single precision, from coordinates as they are; seen in the scene by the matrix."""
    generator, count = np.random.default_rng(7), 400
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    axes = turn @ np.diag([stretch, 1.0, 1.0]) @ np.linalg.qr(generator.normal(size=(3, 3)))[0]
    angles = np.sort(generator.uniform(0, 2 * np.pi, (count, 7)), axis=1)
    flat = np.stack([np.cos(angles), np.sin(angles), generator.normal(0, 0.02, angles.shape)], axis=-1)
    places = flat @ np.linalg.qr(generator.normal(size=(count, 3, 3)))[0] + generator.uniform(-1, 1, 3) * offset
    stored = places.astype(np.float32)
    before, sums = np.roll(stored, 1, axis=1), np.zeros((count, 3), dtype=np.float32)
    for number in range(7):
        a, b = before[:, number], stored[:, number]
        for axis in range(3):
            i, j = (axis + 1) % 3, (axis + 2) % 3
            sums[:, axis] += (a[:, i] - b[:, i]) * (a[:, j] + b[:, j])
    seen = sums.astype(np.float64) @ axes.T
    of_blender = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    corners = places @ axes.T
    middles, centroids = (corners + np.roll(corners, -1, axis=1)) / 2, corners.mean(axis=1, keepdims=True) + 0 * corners
    facets = np.stack([corners, middles, centroids, np.roll(middles, 1, axis=1)]).reshape(4, -1, 3)
    starts = 7 * np.arange(count)
    # Newell in double precision, and the line that it points along in the scene.
    spokes = corners - centroids
    newell = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    lines = newell @ axes @ axes.T
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    off = np.linalg.norm(lines - np.sign(np.einsum("ij,ij->i", lines, of_blender))[:, None] * of_blender, axis=1)
    told = line_turns(facets, starts, axes, float(np.abs(places).max()))
    assert np.all(off <= told)
    # Where nothing is stretched it is little, even as far from the origin as that.
    assert stretch > 1 or np.median(told) <= 0.01


def test_a_stretched_polygon_far_from_its_origin_is_not_compared_along_blender_s_line() -> None:
    """2 wide, 370 off, stretched 346 times: in single precision the line is turned by more than the polygon allows."""
    angles = np.linspace(0, 2 * np.pi, 7)[:-1]
    flat = np.stack([np.cos(angles), np.sin(angles), 1e-3 * (-1.0) ** np.arange(6)], axis=1)
    axes = np.diag([1.0, 346.0, 1.0])
    loop = loops.plain(flat @ axes)
    # A dent, which only the line that Blender looks along makes good for.
    loop.middles[0] += 0.1 * (loop.corners.mean(axis=0) - loop.middles[0])
    given = loop.facets, np.arange(6) == 0, np.array([0]), axes
    near, far = (polygon_thickness(*given, largest=largest)[0] for largest in (0.0, 370.0))
    assert near < 0.1 * far
