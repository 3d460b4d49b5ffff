# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of the limit surface against Blender's own Subdivision Surface modifier with Use Limit Surface on."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests.blender import scene
from tests.blender.test_subdivision_oracle import OBJECTS, nearest_points
from tests.uniform import uniform_points

LEVELS = 3

# With this the modifier's patches are exact but in a neighbourhood of irregular vertices too small to have any points.
HIGHEST_QUALITY = 10

# Blender works in single precision: a dozen and more products and sums, each rounded by half an ulp of the largest
# coordinate; of the three coordinates together.
ULPS = 6

# Where a sharpness ends at a vertex, Blender's libraries approximate (see ``limit_positions``): at darts by the limit
# of a smooth vertex.
APPROXIMATED_SHARE = 0.05
APPROXIMATED = 1e-4


@pytest.fixture(autouse=True)
def empty_scene() -> None:
    scene.clear()


@pytest.mark.parametrize("name", OBJECTS)
def test_points_are_where_the_modifier_has_them(name: str) -> None:
    blender_object = OBJECTS[name]()
    mesh = apply_boundary_rule(scene.polygon_mesh_of(blender_object.data), smooth_corners=True)
    own = np.unique(limit_values(mesh, mesh.positions, uniform_points(mesh, LEVELS)).round(12), axis=0)
    distances = nearest_distances(own, limit_of_the_modifier(blender_object))
    size = np.abs(own).max()
    has_creases = np.any(mesh.vertex_sharpness > 0) or np.any(mesh.edge_sharpness[mesh.edge_face_counts == 2] > 0)
    beyond = distances > ULPS * np.finfo(np.float32).eps * size
    assert beyond.mean() <= (APPROXIMATED_SHARE if has_creases else 0.0)
    assert distances.max() <= APPROXIMATED * size


def limit_of_the_modifier(blender_object: bpy.types.Object) -> np.ndarray:
    modifier = scene.add_subdivision(blender_object, LEVELS)
    modifier.use_limit_surface = True
    modifier.quality = HIGHEST_QUALITY
    data = scene.evaluated_mesh_data(blender_object)
    return data.positions[np.unique(data.corner_vertices)]


def nearest_distances(own: np.ndarray, blenders: np.ndarray) -> np.ndarray:
    return np.linalg.norm(own[nearest_points(own, blenders)] - blenders, axis=1)
