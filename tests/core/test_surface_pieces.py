# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface over the triangles of templates: all of it is there, over the right triangles; and sheets."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.surface_pieces import Part, parts_of, quad_keys, quarter_keys
from ccdepth_addon.core.adaptive.templates import (
    COUNTS,
    QUAD_POINTS,
    TRIANGLE_POINTS,
    TRIANGLES,
    TRIANGLES_OF_TRIANGLE,
)
from ccdepth_addon.core.distance.shells import Triangles

WHOLE = (0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
# The upper right quarter, counted from the centre on, as around an extraordinary vertex.
QUARTER = (0.5, 0.5, 0.5, 0.0, 0.0, 0.5)
NUMBERS = [16 * other + pattern for pattern in range(15) for other in range(COUNTS[pattern])]


def area(points: np.ndarray) -> float:
    """Of a convex polygon with corners (n, 2)."""
    x, y = points.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


def corners_of(part: Part, places: np.ndarray) -> np.ndarray:
    """(n, 2): a part's corners, in its triangle with corners at places (3, 2)."""
    drawn = part.weights[{4: [0, 1, 2, 3], 16: [0, 12, 15, 3], 28: [0, 21, 27]}[len(part.weights)]]
    found: np.ndarray = drawn @ places
    return found


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("place", [WHOLE, QUARTER])
def test_parts_of_quads_are_all_of_a_square_and_over_their_triangles(turn: int, place: tuple[float, ...]) -> None:
    """The identity of the parameters stands for the surface: hull points are then places, and what is drawn too."""
    along = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])
    square = np.array(place[:2]) + along @ np.array(place[2:]).reshape(2, 2)
    for number in NUMBERS:
        parts, total = parts_of(int(quad_keys(number, turn)), place, are_bicubic=True), 0.0
        for part in parts:
            triangle = TRIANGLES[number, part.triangle]
            places = QUAD_POINTS[(triangle + turn) % 4 + triangle // 4 * 4]
            hull = square if part.rows is None else part.rows @ square
            np.testing.assert_allclose(hull, part.weights @ places, atol=1e-14)
            assert part.weights.min() >= -1e-14
            total += area(corners_of(part, places))
        assert total == pytest.approx(place[2] * place[5], abs=1e-14)


@pytest.mark.parametrize("quarter", range(3))
def test_parts_of_triangles_are_all_of_a_quarter(quarter: int) -> None:
    """Parts that lines cut are there for each triangle that they meet, so nothing is left out: every place of the
    quarter is in a part over the triangle that it is in."""
    generator = np.random.default_rng(quarter)
    u, v = generator.uniform(0, 1, (2, 500))
    ring = np.roll(np.array([[1, 0, 0], [0.5, 0.5, 0], [1 / 3, 1 / 3, 1 / 3], [0.5, 0, 0.5]]), quarter, axis=1)
    bilinear = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
    # (500, 3): weights of the triangle's corners.
    places = bilinear @ ring
    for pattern in range(7):
        parts = parts_of(int(quarter_keys(pattern, quarter)), WHOLE, are_bicubic=True)
        inside = [np.linalg.inv(TRIANGLE_POINTS[triangle]) for triangle in TRIANGLES_OF_TRIANGLE[pattern]]
        within = np.stack([np.all(places @ each >= 0, axis=1) for each in inside])
        is_found = np.zeros(len(u), dtype=bool)
        for part in parts:
            square = part.rows @ np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])
            low, high = square.min(axis=0), square.max(axis=0)
            on = (low[0] <= u) & (u <= high[0]) & (low[1] <= v) & (v <= high[1])
            is_found |= on & within[part.triangle]
            np.testing.assert_allclose(part.weights.sum(axis=1), 1, atol=1e-14)
        assert np.all(is_found)


def test_sheets_that_meet_at_a_vertex_have_vertices_of_their_own() -> None:
    """Four wings at an edge, which is closed: each has the ends of the edge for itself, and its own normal there."""
    wings = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 0, 5]])
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    nothing = np.zeros((4, 3), dtype=np.intp)
    closed, unknown = np.ones((4, 3), dtype=bool), np.zeros(4, dtype=bool)
    found = Triangles.joined(points[wings], wings, nothing.copy(), nothing.copy(), closed, unknown)
    assert len(np.unique(found.vertices)) == 12
    np.testing.assert_array_equal(found.origins[found.vertices], wings)
    np.testing.assert_allclose(found.vectors[:4], np.repeat(found.normals[:4, None], 3, axis=1))
