# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels 1 to 3, limit points and UV maps against Blender's own Subdivision Surface modifier, mesh by mesh."""

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils.kdtree import KDTree
from numpy.typing import NDArray

from ccdepth_addon.core.attributes.face_varying import UV_SMOOTH, face_varying_surface
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.evaluation import limit_values
from tests import meshes, uniform
from tests.blender import scene
from tests.blender.measuring import rounding
from tests.uniform import uniform_points

pytestmark = pytest.mark.every_blender

LEVELS = 3

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
    own = scene.polygon_mesh_of(holder.data, smooth_corners=boundary == "ALL")
    modifier = scene.add_subdivision(holder, 1, boundary)
    for level in range(1, LEVELS + 1):
        modifier.levels = level
        own = subdivide(own)
        assert_same_mesh(own, scene.evaluated_mesh_data(holder), level)


def assert_same_mesh(own: PolygonMesh, blenders: meshes.MeshData, level: int) -> None:
    """Vertices matched by position, one to one; then the faces must be the same, visited in the same direction."""
    own_vertices = np.unique(own.corner_vertices)
    blender_vertices = np.unique(blenders.corner_vertices)
    assert len(own_vertices) == len(blender_vertices)
    nearest = own_vertices[nearest_points(own.positions[own_vertices], blenders.positions[blender_vertices])]
    assert len(np.unique(nearest)) == len(nearest)
    distances = np.linalg.norm(own.positions[nearest] - blenders.positions[blender_vertices], axis=1)
    assert distances.max() <= rounding(own.positions[own_vertices], level)
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
    mesh = scene.polygon_mesh_of(holder.data)
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


UV_LEVEL = 2

# Single precision: a level rounds weights, their products and the sum, each worth an ulp or so of the largest UV.
UV_ULPS = 4 * UV_LEVEL

UV_MESHES: dict[str, Callable[[], meshes.MeshData]] = {
    "landscape": lambda: meshes.landscape(6, 5),
    "cylinder": lambda: meshes.cylinder(7),
    "house": meshes.triangles_and_quads,
    "fin": meshes.fin_through,
    "bow tie": meshes.bow_tie,
    "valence 2": meshes.valence_two,
    "fan": lambda: meshes.fan(9),
    "two fans": lambda: meshes.welded(meshes.fan(8), meshes.moved(meshes.fan(8, seed=2), 9.0), {0: 0}),
    "cubes sharing a vertex": meshes.two_cubes_sharing_a_vertex,
    "cubes sharing an edge": meshes.two_cubes_sharing_an_edge,
}

FAN = meshes.fan(6, rings=1)


def maps(mesh: PolygonMesh) -> dict[str, NDArray[np.float32]]:
    """(C, 2) each: UV maps without and with seams, cut into all its faces, torn at single corners, and in two or three
    islands that lie all over the mesh, so that they touch themselves in points."""
    rng = np.random.default_rng(5)
    x, y, z = mesh.positions.T
    whole = np.stack([x + 0.2 * z, y + 0.3 * z], axis=1)[mesh.corner_vertices]
    is_torn, widths = rng.random(mesh.corner_count) < 0.15, rng.uniform(0.1, 0.3, mesh.corner_count)
    moved = {
        "whole": 0.0,
        "islands": 9.0 * (mesh.corner_faces < mesh.face_count // 2)[:, None],
        "apart": mesh.corner_faces[:, None],
        "torn": np.where(is_torn, widths, 0.0)[:, None],
    }
    for count in (2, 2, 3):
        moved[f"scattered {len(moved)}"] = 9.0 * rng.integers(0, count, mesh.face_count)[mesh.corner_faces, None]
    return {name: (whole + by).astype(np.float32) for name, by in moved.items()}


# In the short suite every mesh is smoothed in every way once, with creases or without.
UV_CASES = [
    pytest.param(name, uv_smooth, creased, marks=pytest.mark.thorough if (i + j + creased) % 2 else ())
    for i, name in enumerate(UV_MESHES)
    for j, uv_smooth in enumerate(UV_SMOOTH[1:])
    for creased in (False, True)
]


@pytest.mark.parametrize(("name", "uv_smooth", "creased"), UV_CASES)
def test_uv_levels_agree_with_the_modifier(name: str, uv_smooth: str, creased: bool) -> None:
    data = UV_MESHES[name]()
    assert_agreement(meshes.with_random_creases(data, seed=3, share=0.5) if creased else data, uv_smooth, maps)


@pytest.mark.parametrize("uv_smooth", UV_SMOOTH[1:])
def test_neighbours_whose_creases_fade_together(uv_smooth: str) -> None:
    """Two islands meet in a vertex; inside one of them two creases end there, which fade in the same level, or with a
    third one that fades later, or where the vertex is sharp for a while itself."""
    # Between a sector and the one before.
    first, second, third = [(0, int(vertex)) for vertex in FAN.corner_vertices.reshape(-1, 4)[1:4, 1]]
    creases = {first: 0.42, second: 0.35}
    for data in (
        replace(FAN, edge_creases=creases),
        replace(FAN, edge_creases=creases | {third: 0.6}),
        replace(FAN, edge_creases=creases, vertex_creases={0: 0.4}),
    ):
        assert_agreement(data, uv_smooth, two_islands)


def two_islands(mesh: PolygonMesh) -> dict[str, NDArray[np.float32]]:
    """The first four sectors of the fan, and the other two."""
    apart = 9.0 * (mesh.corner_faces < 4)[:, None]
    return {"two islands": (mesh.positions[mesh.corner_vertices, :2] + apart).astype(np.float32)}


def assert_agreement(
    data: meshes.MeshData, uv_smooth: str, maps_of: Callable[[PolygonMesh], dict[str, NDArray[np.float32]]]
) -> None:
    scene.clear()
    holder = scene.add_object(data)
    control = scene.polygon_mesh_of(holder.data)
    found = maps_of(control)
    for layer, uvs in found.items():
        holder.data.uv_layers.new(name=layer).uv.foreach_set("vector", uvs.ravel())
    scene.add_subdivision(holder, UV_LEVEL).uv_smooth = uv_smooth
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    for layer, uvs in found.items():
        surface = face_varying_surface(control, uvs, uv_smooth)
        own = uniform.refined_values(surface, surface.positions[:, :2], UV_LEVEL, limit=False)
        tolerance = UV_ULPS * float(np.finfo(np.float32).eps * np.abs(uvs).max())
        # Both meshes go through the faces in their order.
        starts = control.face_starts[1:-1] * 4**UV_LEVEL
        by_face = (np.split(points, starts) for points in (own, scene.read(evaluated, layer).astype(np.float64)))
        for ours, theirs in zip(*by_face, strict=True):
            distances = np.abs(ours[:, None] - theirs).max(axis=2)
            assert max(distances.min(axis=0).max(), distances.min(axis=1).max()) <= tolerance, layer
