# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons however they are cut, and in whatever space: no farther from their fan than ``polygon_thickness`` says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from ccdepth_addon.core.adaptive.leaf_bounds.polygon_bounds import HEIGHT_ROUNDING, is_folded, polygon_thickness
from ccdepth_addon.core.arrays.types import FloatArray

UNEVEN = np.array([[1.0, 0.0, 30.0], [0.0, 1.0, -20.0], [0.0, 0.0, 1.0]])

# Points along each side of a patch, to measure distances with.
STEPS = 24


def fan_of(corners: FloatArray, middles: FloatArray) -> FloatArray:
    """(4, C, 3): the bilinear quads between a polygon's vertices and its centroid."""
    centroids = np.broadcast_to(corners.mean(axis=0), corners.shape)
    return np.stack([corners, middles, centroids, np.roll(middles, 1, axis=0)])


def thickness(corners: FloatArray, middles: FloatArray, bent: list[bool], axes: FloatArray) -> float:
    [found] = polygon_thickness(fan_of(corners, middles), np.array(bent), np.array([0]), axes)
    return float(found)


def dented(rng: np.random.Generator, sides: int) -> tuple[FloatArray, FloatArray, list[bool]]:
    """A polygon that is nearly flat and regular, some sides of which are bent, inwards as well as outwards."""
    angles = 2 * np.pi * (np.arange(sides) + rng.uniform(-0.1, 0.1, sides)) / sides
    corners = np.stack([np.cos(angles), np.sin(angles), rng.uniform(-0.05, 0.05, sides)], axis=1)
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    bent = (rng.uniform(size=sides) < 0.5).tolist()
    return corners, np.where(np.array(bent)[:, None], middles + rng.uniform(-0.1, 0.1, middles.shape), middles), bent


def cut_at_random(rng: np.random.Generator, count: int) -> list[tuple[int, int, int]]:
    """Triangles between the vertices of a polygon: one ear after another, wherever it is."""
    left, found = list(range(count)), []
    while len(left) > 3:
        at = int(rng.integers(len(left)))
        found.append((left[at - 1], left[at], left[(at + 1) % len(left)]))
        del left[at]
    return [*found, (left[0], left[1], left[2])]


def points_of_quads(quads: FloatArray) -> FloatArray:
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 1, STEPS)] * 2))
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v])
    return np.einsum("ks,kci->csi", weights, quads).reshape(-1, 3)


def points_of_triangles(triangles: FloatArray) -> FloatArray:
    """triangles: (T, 3, 3). As quads whose last two corners are one."""
    return points_of_quads(triangles[:, [0, 1, 2, 2]].swapaxes(0, 1))


@pytest.mark.parametrize("seed", range(60))
def test_whatever_triangles_are_drawn(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, middles, bent = dented(rng, int(rng.integers(3, 8)))
    # Too uneven for Blender's triangles to be known.
    bound = thickness(corners, middles, bent, np.diag([1.0, 1.0, 1e-5]))
    order = [point for pair in zip(corners, middles, strict=True) for point in pair]
    vertices = np.array([point for place, point in enumerate(order) if place % 2 == 0 or bent[place // 2]])
    mesh = points_of_triangles(vertices[np.array(cut_at_random(rng, len(vertices)))])
    fan = points_of_quads(fan_of(corners, middles))
    farthest = max(cKDTree(fan).query(mesh)[0].max(), cKDTree(mesh).query(fan)[0].max())
    # The points of the other are so far apart.
    assert farthest <= bound + 1.5 / STEPS
    assert np.isfinite(bound) or any(bent)


def test_a_dent_counts_unless_blender_is_known_to_see_it() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    middles[0] += (0.0, 0.1, 0.0)
    bent = [True, False, False, False]
    reach = np.hypot(0.5, 0.5)
    line = UNEVEN @ UNEVEN.T @ [0, 0, 1]
    cosine = line[2] / np.linalg.norm(line)
    # A flat polygon has no thickness but its rounding, which grows where Blender's line of sight is tilted.
    assert thickness(corners, middles, bent, np.eye(3)) == pytest.approx(HEIGHT_ROUNDING * reach, rel=1e-9, abs=0)
    assert thickness(corners, middles, bent, UNEVEN) == pytest.approx(HEIGHT_ROUNDING * reach / cosine, rel=1e-9, abs=0)
    assert thickness(corners, middles, bent, np.diag([1.0, 1.0, 1e-5])) == pytest.approx(0.1)


def test_along_the_line_that_blender_looks_along() -> None:
    """The middle is seen within its side from above, and beyond it from where Blender looks."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    middles[0] += (0.0, 0.1, 0.01)
    bent = [True, False, False, False]
    even = thickness(corners, middles, bent, np.eye(3))
    assert 0.005 < even < 0.015
    assert thickness(corners, middles, bent, 7 * np.diag([1.0, -1.0, 1.0])) == pytest.approx(even)
    assert thickness(corners, middles, bent, UNEVEN) == pytest.approx(np.hypot(even, 0.1), rel=1e-2)


def test_folded_where_blender_draws() -> None:
    quad = np.array([[0.0, 0, 0], [1, 0, 0.05], [1, 1, 0], [0, 1, 0.05]])[:, None]
    assert not is_folded(quad, np.eye(3))[0]
    assert is_folded(quad, np.diag([1.0, 1.0, 0.01]))[0]
    assert not is_folded(quad, np.diag([0.01, 0.01, 1.0]))[0]
