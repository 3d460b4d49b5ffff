# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels 1 to 3 against Blender's own Subdivision Surface modifier, mesh by mesh."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest
from mathutils.kdtree import KDTree

from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import scene

LEVELS = (1, 2, 3)

# Blender computes in single precision: a level rounds the weights, their products with positions, and the sum. Each
# is worth about an ulp of the largest coordinate.
ULPS_PER_LEVEL = 3


def suzanne_with_random_creases() -> bpy.types.Object:
    suzanne = scene.add_suzanne()
    creased = meshes.with_random_creases(scene.mesh_data(suzanne.data), seed=3)
    return scene.add_object(creased)


def from_data(build: Callable[[], meshes.MeshData]) -> Callable[[], bpy.types.Object]:
    return lambda: scene.add_object(build())


OBJECTS: dict[str, Callable[[], bpy.types.Object]] = {
    "cube": from_data(meshes.cube),
    "suzanne": scene.add_suzanne,
    "landscape": from_data(lambda: meshes.landscape(5, 4)),
    "single quad": from_data(lambda: meshes.grid(1, 1)),
    "torus": from_data(lambda: meshes.torus(7, 5)),
    "creased cube": from_data(meshes.creased_cube),
    "corner creased cube": from_data(meshes.corner_creased_cube),
    "cylinder": from_data(lambda: meshes.cylinder(9)),
    "triangles and quads": from_data(meshes.triangles_and_quads),
    "valences 2 and 12": from_data(meshes.valences_two_and_twelve),
    "two cubes sharing an edge": from_data(meshes.two_cubes_sharing_an_edge),
    "two cubes sharing a vertex": from_data(meshes.two_cubes_sharing_a_vertex),
    "bow tie": from_data(meshes.bow_tie),
    "bow tie inside": from_data(meshes.bow_tie_inside),
    "three faces on an edge": from_data(meshes.three_faces_on_an_edge),
    "fin through": from_data(meshes.fin_through),
    "boundary touching inside": from_data(meshes.boundary_touching_inside),
    "face soup": from_data(meshes.face_soup),
    "flipped face": from_data(meshes.flipped_face),
    "loose edges": from_data(meshes.loose_edge_at_a_face_vertex),
    "quad creased all round": from_data(
        lambda: meshes.creased(meshes.grid(1, 1), {(0, 1): 1.0, (1, 3): 1.0, (2, 3): 0.4, (0, 2): 0.4}, {0: 0.2})
    ),
    "valence 2 creased": from_data(lambda: meshes.creased(meshes.valence_two(), {(0, 1): 0.4, (0, 3): 0.6}, {0: 0.3})),
    "valence 2 with random creases": from_data(
        lambda: meshes.with_random_creases(meshes.valence_two(), seed=5, share=0.8)
    ),
    "face soup with random creases": from_data(
        lambda: meshes.with_random_creases(meshes.face_soup(seed=2), seed=2, share=0.4)
    ),
    "landscape with random creases": from_data(lambda: meshes.with_random_creases(meshes.landscape(8, 8), share=0.5)),
    "cylinder with random creases": from_data(lambda: meshes.with_random_creases(meshes.cylinder(12), share=0.6)),
    "fin with random creases": from_data(lambda: meshes.with_random_creases(meshes.fin_through(), share=0.5)),
    "suzanne with random creases": suzanne_with_random_creases,
}


@pytest.fixture(autouse=True)
def empty_scene() -> None:
    scene.clear()


@pytest.mark.parametrize("boundary", ["ALL", "PRESERVE_CORNERS"])
@pytest.mark.parametrize("name", OBJECTS)
def test_levels_agree_with_the_modifier(name: str, boundary: str) -> None:
    blender_object = OBJECTS[name]()
    own = apply_boundary_rule(scene.polygon_mesh_of(blender_object.data), smooth_corners=boundary == "ALL")
    modifier = scene.add_subdivision(blender_object, 1, boundary)
    for level in LEVELS:
        modifier.levels = level
        own = subdivide(own).mesh
        assert_same_mesh(own, scene.evaluated_mesh_data(blender_object), level)


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
