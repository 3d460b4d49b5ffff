# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds along the surface where rounding could take something from them; ``test_adaptive`` has the surface itself."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_bounds.star_bounds import THINNEST, star_bounds
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_bounds import ErrorBounds
from ccdepth_addon.core.arrays.types import FloatArray

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
    return star_bounds(apart, triangles, normal, tangential, closed, wanted, rounding)


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
