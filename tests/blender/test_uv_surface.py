# SPDX-License-Identifier: GPL-3.0-or-later
"""UV maps smoothed in every way, against those of Blender's own modifier, on meshes with all kinds of seams."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.attributes.face_varying import UV_SMOOTH, face_varying_surface
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes, uniform
from tests.blender import scene

pytestmark = pytest.mark.every_blender

LEVEL = 2

# Single precision: a level rounds weights, their products and the sum, each worth an ulp or so of the largest UV.
ULPS = 4 * LEVEL

MESHES: dict[str, Callable[[], meshes.MeshData]] = {
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
CASES = [
    pytest.param(name, uv_smooth, creased, marks=pytest.mark.thorough if (i + j + creased) % 2 else ())
    for i, name in enumerate(MESHES)
    for j, uv_smooth in enumerate(UV_SMOOTH[1:])
    for creased in (False, True)
]


@pytest.mark.parametrize(("name", "uv_smooth", "creased"), CASES)
def test_levels_agree_with_the_modifier(name: str, uv_smooth: str, creased: bool) -> None:
    data = MESHES[name]()
    assert_agreement(meshes.with_random_creases(data, seed=3, share=0.5) if creased else data, uv_smooth, maps)


@pytest.mark.parametrize("uv_smooth", UV_SMOOTH[1:])
def test_neighbours_whose_creases_fade_together(uv_smooth: str) -> None:
    """Two islands meet in a vertex; inside one of them two creases end there, which fade in the same level, or with a
    third one that fades later, or where the vertex is sharp for a while itself."""
    first, second, third = edges_at_the_middle(FAN)[1:4]
    creases = {first: 0.42, second: 0.35}
    for data in (
        replace(FAN, edge_creases=creases),
        replace(FAN, edge_creases=creases | {third: 0.6}),
        replace(FAN, edge_creases=creases, vertex_creases={0: 0.4}),
    ):
        assert_agreement(data, uv_smooth, two_islands)


def edges_at_the_middle(data: meshes.MeshData) -> list[tuple[int, int]]:
    """Those of the fan, sector by sector: that between a sector and the one before."""
    return [(0, int(second)) for second in data.corner_vertices.reshape(-1, 4)[:, 1]]


def two_islands(mesh: PolygonMesh) -> dict[str, NDArray[np.float32]]:
    """The first four sectors of the fan, and the other two."""
    apart = 9.0 * (mesh.corner_faces < 4)[:, None]
    return {"two islands": (mesh.positions[mesh.corner_vertices, :2] + apart).astype(np.float32)}


def assert_agreement(
    data: meshes.MeshData, uv_smooth: str, maps_of: Callable[[PolygonMesh], dict[str, NDArray[np.float32]]]
) -> None:
    scene.clear()
    holder = scene.add_object(data)
    control = apply_boundary_rule(scene.polygon_mesh_of(holder.data), smooth_corners=True)
    found = maps_of(control)
    for layer, uvs in found.items():
        holder.data.uv_layers.new(name=layer).uv.foreach_set("vector", uvs.ravel())
    scene.add_subdivision(holder, LEVEL).uv_smooth = uv_smooth
    evaluated = holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    for layer, uvs in found.items():
        surface = face_varying_surface(control, uvs, uv_smooth)
        own = uniform.refined_values(surface, surface.positions[:, :2], LEVEL, limit=False)
        blenders = np.empty(2 * len(evaluated.loops), dtype=np.float32)
        evaluated.uv_layers[layer].uv.foreach_get("vector", blenders)
        tolerance = ULPS * float(np.finfo(np.float32).eps * np.abs(uvs).max())
        by_face = (by_base_face(points, control) for points in (own, blenders.reshape(-1, 2).astype(np.float64)))
        for ours, theirs in zip(*by_face, strict=True):
            distances = np.abs(ours[:, None] - theirs).max(axis=2)
            assert max(distances.min(axis=0).max(), distances.min(axis=1).max()) <= tolerance, layer


def by_base_face(points: NDArray[np.float64], control: PolygonMesh) -> list[NDArray[np.float64]]:
    """The points (C, 2) at fine corners, by base face: both meshes go through the faces in their order."""
    return np.split(points, control.face_starts[1:-1] * 4**LEVEL)
