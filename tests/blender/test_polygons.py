# SPDX-License-Identifier: GPL-3.0-or-later
"""Polygons as Blender triangulates them, against what is promised of them: a region, and not far from the fan."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import polygon_loops as loops
from tests.polygon_loops import Loop
from tests.thorough import combinations

pytestmark = pytest.mark.every_blender

# Coordinates of some units in single precision.
ROUNDING = 2e-6

# So many polygons that are regions, of so many drawn at random.
REGIONS = 4
SEEDS = range(200)

# How uneven, and how high.
SHAPES = [(0.05, 0.05), (0.2, 0.3), (0.3, 0.1)]


def single(loop: Loop) -> Loop:
    """The loop as Blender holds it; straight sides stay straight."""
    corners = loop.corners.astype(np.float32).astype(np.float64)
    straight = loops.plain(corners).middles
    middles = np.where(loop.bent[:, None], loop.middles.astype(np.float32), straight)
    return Loop(corners, middles, loop.bent)


def triangles_of(vertices: np.ndarray) -> np.ndarray:
    """(T, 3): what Blender draws the polygon as."""
    mesh = bpy.data.meshes.new("Polygon")
    mesh.from_pydata(vertices.tolist(), [], [list(range(len(vertices)))])
    mesh.calc_loop_triangles()
    return np.array([triangle.vertices[:] for triangle in mesh.loop_triangles])


@pytest.mark.parametrize(("size", "shape"), combinations([3, 4, 5, 6, 8], SHAPES))
def test_blender_draws_the_region_and_is_no_farther_than_it_is_thick(size: int, shape: tuple[float, float]) -> None:
    regions = 0
    for seed in SEEDS:
        loop = single(loops.random_loop(seed, size, *shape, bent_share=0.4))
        thickness, normal = loop.thickness()
        if not np.isfinite(thickness):
            continue
        if regions == REGIONS:
            break
        regions += 1
        vertices = loop.vertices
        triangles = triangles_of(vertices)
        flat = loops.seen_along(vertices, normal)
        areas = [loops.doubled_area(flat[triangle]) for triangle in triangles]
        # A vertex on a side of the triangles is on either side of it by rounding.
        assert min(areas) > -ROUNDING
        x, y = flat.T
        assert sum(areas) == pytest.approx(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        drawn = vertices[triangles]
        fan = loops.facet_triangles(loop.facets)
        allowed = thickness + loops.twist_error(loop.facets) + ROUNDING
        assert loops.farthest(loops.samples_of(drawn), fan) <= allowed
        assert loops.farthest(fan.reshape(-1, 3), drawn) <= allowed
    assert regions == REGIONS
