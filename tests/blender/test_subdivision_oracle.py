# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels 1 to 3, and points of the limit surface, against Blender's own Subdivision Surface modifier, mesh by mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from mathutils.kdtree import KDTree

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.evaluation import limit_values
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene
from tests.uniform import uniform_points

pytestmark = pytest.mark.every_blender

LEVELS = 3

# Blender computes in single precision: a level rounds the weights, their products with positions, and the sum. Each
# is worth about an ulp of the largest coordinate.
ULPS_PER_LEVEL = 3

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    **{name: data for name, data in meshes.AWKWARD.items() if "collapsed" not in name},
    "suzanne": scene.suzanne,
    "torus": lambda: meshes.torus(7, 5),
    "loose edges": meshes.loose_edge_at_a_face_vertex,
    "quad creased all round": lambda: meshes.creased(
        meshes.grid(1, 1), {(0, 1): 1.0, (1, 3): 1.0, (2, 3): 0.4, (0, 2): 0.4}, {0: 0.2}
    ),
    "valence 2 with three creases": lambda: meshes.creased(meshes.valence_two(), {(0, 1): 0.4, (0, 3): 0.6}, {0: 0.3}),
    "large landscape with random creases": lambda: meshes.with_random_creases(meshes.landscape(8, 8), share=0.5),
    "fin with random creases": lambda: meshes.with_random_creases(meshes.fin_through(), share=0.5),
    "suzanne with random creases": lambda: meshes.with_random_creases(scene.suzanne(), seed=3),
}


@pytest.mark.parametrize("boundary", ["ALL", "PRESERVE_CORNERS"])
@pytest.mark.parametrize("name", MESHES)
def test_levels_agree_with_the_modifier(name: str, boundary: str) -> None:
    holder = scene.add_object(MESHES[name]())
    own = apply_boundary_rule(scene.polygon_mesh_of(holder.data), smooth_corners=boundary == "ALL")
    modifier = scene.add_subdivision(holder, 1, boundary)
    for level in range(1, LEVELS + 1):
        modifier.levels = level
        own = subdivide(own).mesh
        assert_same_mesh(own, scene.evaluated_mesh_data(holder), level)


def assert_same_mesh(own: PolygonMesh, blenders: meshes.MeshData, level: int) -> None:
    """Vertices matched by position, one to one; then the faces must be the same, visited in the same direction."""
    own_vertices = np.unique(own.corner_vertices)
    blender_vertices = np.unique(blenders.corner_vertices)
    assert len(own_vertices) == len(blender_vertices)
    nearest = own_vertices[nearest_points(own.positions[own_vertices], blenders.positions[blender_vertices])]
    assert len(np.unique(nearest)) == len(nearest)
    distances = np.linalg.norm(own.positions[nearest] - blenders.positions[blender_vertices], axis=1)
    tolerance = ULPS_PER_LEVEL * level * np.finfo(np.float32).eps * np.abs(own.positions[own_vertices]).max()
    assert distances.max() <= tolerance
    to_own = np.full(len(blenders.positions), -1)
    to_own[blender_vertices] = nearest
    expected = canonical_quads(to_own[blenders.corner_vertices])
    np.testing.assert_array_equal(canonical_quads(own.corner_vertices), expected)
    assert np.count_nonzero(own.edge_face_counts) == len(blenders.edges)


def nearest_points(points: np.ndarray, queries: np.ndarray) -> np.ndarray:
    """For each query the index of the nearest point. By Blender's own tree, as a real Blender has no SciPy."""
    tree = KDTree(len(points))
    for index, point in enumerate(points):
        tree.insert(point, index)
    tree.balance()
    return np.array([tree.find(query)[1] for query in queries])


def canonical_quads(corner_vertices: np.ndarray) -> np.ndarray:
    """(F, 4), each quad begun at its lowest vertex, the quads sorted."""
    quads = corner_vertices.reshape(-1, 4)
    turns = (np.argmin(quads, axis=1)[:, None] + np.arange(4)) % 4
    turned = np.take_along_axis(quads, turns, axis=1)
    return turned[np.lexsort(turned.T[::-1])]


# The limit surface

# With this the modifier's patches are exact but in a neighbourhood of irregular vertices too small to have any points.
HIGHEST_QUALITY = 10

# Blender works in single precision: a dozen and more products and sums, each rounded by half an ulp of the largest
# coordinate; of the three coordinates together.
ULPS = 6

# Where a sharpness ends at a vertex, Blender's libraries approximate (see ``limit_positions``): at darts by the limit
# of a smooth vertex.
APPROXIMATED_SHARE = 0.05
APPROXIMATED = 1e-4


@pytest.mark.parametrize("name", MESHES)
def test_points_are_where_the_modifier_has_them(name: str) -> None:
    holder = scene.add_object(MESHES[name]())
    mesh = apply_boundary_rule(scene.polygon_mesh_of(holder.data), smooth_corners=True)
    own = np.unique(limit_values(mesh, mesh.positions, uniform_points(mesh, LEVELS)).round(12), axis=0)
    modifier = scene.add_subdivision(holder, LEVELS)
    modifier.use_limit_surface, modifier.quality = True, HIGHEST_QUALITY
    data = scene.evaluated_mesh_data(holder)
    blenders = data.positions[np.unique(data.corner_vertices)]
    distances = np.linalg.norm(own[nearest_points(own, blenders)] - blenders, axis=1)
    size = np.abs(own).max()
    has_creases = np.any(mesh.vertex_sharpness > 0) or np.any(mesh.edge_sharpness[mesh.edge_face_counts == 2] > 0)
    beyond = distances > ULPS * np.finfo(np.float32).eps * size
    assert beyond.mean() <= (APPROXIMATED_SHARE if has_creases else 0.0)
    assert distances.max() <= APPROXIMATED * size
