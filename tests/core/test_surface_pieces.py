# SPDX-License-Identifier: GPL-3.0-or-later
"""Pieces of the surface over the triangles of templates: all of it is there, over the right triangles."""

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.surface_pieces import (
    SOME,
    TilesOverTriangles,
    parts_of,
    pieces_by_corners,
    pieces_over,
    quarter_keys,
)
from ccdepth_addon.core.adaptive.template_rows import barycentric_rows
from ccdepth_addon.core.adaptive.templates import (
    COUNTS,
    COUNTS_OF_TRIANGLE,
    QUAD_POINTS,
    TRIANGLE_COUNTS,
    TRIANGLE_POINTS,
    TRIANGLES,
    TRIANGLES_OF_TRIANGLE,
)
from ccdepth_addon.core.distance.leaf_surfaces import Tiles
from ccdepth_addon.core.surface.squares import Squares

WHOLE = (0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
# The upper right quarter, counted from the centre on, and the lower right one from the corner on, as around
# extraordinary vertices.
QUARTER = (0.5, 0.5, 0.5, 0.0, 0.0, 0.5)
CORNER = (1.0, 0.0, 0.0, 0.5, -0.5, 0.0)
NUMBERS = [16 * other + pattern for pattern in range(15) for other in range(COUNTS[pattern])]


def area(points: np.ndarray) -> float:
    """Of a convex polygon with corners (n, 2)."""
    x, y = points.T
    return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2


@pytest.mark.parametrize("place", [WHOLE, QUARTER, CORNER])
def test_pieces_of_quads_are_all_of_a_square_and_over_their_triangles(place: tuple[float, ...]) -> None:
    """The identity of the parameters stands for the surface: hull points are then places, and what is drawn too."""
    numbers = np.array(place)
    one, axes = np.ones(1, dtype=np.intp), numbers[2:].reshape(1, 2, 2)
    squares = Squares(0 * one, numbers[None, :2], axes)
    along = np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])
    square = np.column_stack([numbers[:2] + along @ axes[0], np.zeros(16)])
    tiles, first = Tiles(squares, square[:, None]), 0 * one
    for number in NUMBERS:
        points = TRIANGLES[number, : TRIANGLE_COUNTS[number]]
        drawn, total = np.pad(QUAD_POINTS[points], ((0, 0), (0, 0), (0, 1))), 0.0
        over = TilesOverTriangles.of(np.array([number]), squares)
        pieces = [each for _, each, _ in pieces_by_corners(drawn, tiles, over, first)]
        for triangle in over.triangles[over.shares == SOME].tolist():
            parts = parts_of(number, triangle, place, are_bicubic=True)
            pieces += [pieces_over(drawn, tiles, first, part, np.array([triangle])) for part in parts]
        for piece in pieces:
            np.testing.assert_allclose(piece.hulls, piece.flats, atol=1e-14)
            corners = drawn[piece.triangles[0], :, :2]
            rows, size = barycentric_rows(corners)
            weights = np.pad(piece.flats[:, 0, :2], ((0, 0), (0, 1)), constant_values=1.0) @ rows / size
            assert weights.min() >= -1e-14
            rows = {16: [0, 12, 15, 3], 28: [0, 21, 27]}[len(weights)]
            total += area(weights[rows] @ corners)
        assert total == pytest.approx(abs(np.linalg.det(axes[0])), abs=1e-14)


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
        key, is_found = int(quarter_keys(pattern, quarter)), np.zeros(len(u), dtype=bool)
        for triangle, points in enumerate(TRIANGLES_OF_TRIANGLE[pattern, : COUNTS_OF_TRIANGLE[pattern]]):
            within = np.all(places @ np.linalg.inv(TRIANGLE_POINTS[points]) >= 0, axis=1)
            for part in parts_of(key, triangle, WHOLE, are_bicubic=True):
                square = part.rows @ np.array([(i / 3, j / 3) for i in range(4) for j in range(4)])
                low, high = square.min(axis=0), square.max(axis=0)
                on = (low[0] <= u) & (u <= high[0]) & (low[1] <= v) & (v <= high[1])
                is_found |= on & within
                np.testing.assert_allclose(part.weights.sum(axis=1), 1, atol=1e-14)
        assert np.all(is_found)
