# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive meshes of objects that are scaled unevenly, sheared or flattened are drawn as they are proved."""

from __future__ import annotations

from dataclasses import replace

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, faces, known_count, subdivide
from tests.blender.updating import set_scene

pytestmark = pytest.mark.every_blender


def folded_unless_flattened(data: meshes.MeshData, name: str = "Mesh") -> bpy.types.Object:
    """Flattened, the object is smooth where its mesh is folded, and Blender triangulates the mesh."""
    holder = scene.add_object(replace(data, positions=data.positions * (1.0, 1.0, 200.0)), name)
    holder.scale = (1.0, 1.0, 0.005)
    return holder


def test_quads_are_drawn_along_the_diagonal_that_was_proved_on_a_flattened_object() -> None:
    holder = folded_unless_flattened(meshes.bumpy(meshes.torus(9, 6), 0.2))
    [result] = subdivide(holder, tolerance=0.05)
    assert_quads_are_drawn_along_their_first_diagonal(result.data)


def assert_quads_are_drawn_along_their_first_diagonal(mesh: bpy.types.Mesh) -> None:
    assert any(polygon.loop_total == 4 for polygon in mesh.polygons)
    mesh.calc_loop_triangles()
    for triangle in mesh.loop_triangles:
        polygon = mesh.polygons[triangle.polygon_index]
        if polygon.loop_total == 4:
            places = sorted(loop - polygon.loop_start for loop in triangle.loops)
            assert places in ([0, 1, 2], [0, 2, 3])


@pytest.mark.parametrize("transitions", ["TRIANGLES", "NGONS"])
def test_faces_of_uneven_objects_are_counted_as_they_are_made(transitions: str) -> None:
    landscape = folded_unless_flattened(meshes.landscape(6, 5), "Landscape")
    fan = folded_unless_flattened(meshes.fan(5, 2), "Fan")
    sheared = scene.add_object(meshes.bumpy(meshes.cylinder(7), 0.2), "Sheared")
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (10.0, 1.0, 0.1)
    sheared.parent = parent
    sheared.rotation_euler = (0.5, 0.6, 0.7)
    subdivided_as_counted([landscape, fan, sheared], 0.1, transitions)


def subdivided_as_counted(
    holders: list[bpy.types.Object], tolerance: float, transitions: str
) -> list[bpy.types.Object]:
    """The results, whose faces are as many as were counted before."""
    set_scene(tolerance=tolerance, transitions=transitions)
    addon.select(*holders)
    assert bpy.ops.ccdepth.count_faces() == {"FINISHED"}
    counts = {holder.name: known_count(holder).faces for holder in holders}
    results = subdivide(*holders, tolerance=tolerance, transitions=transitions)
    assert {result.name.removesuffix(" Adaptive"): faces(result) for result in results} == counts
    return results


@pytest.mark.parametrize("scale", [(1.0, 1.0, 0.0), (1.0, 1.0, -1e-12)])
def test_objects_scaled_to_nothing_are_drawn_as_they_are_proved(scale: tuple[float, float, float]) -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.scale = scale
    result = subdivided_as_counted([holder], TOLERANCE, "NGONS")[0]
    assert addon.bounds(result).max() <= TOLERANCE
    assert_quads_are_drawn_along_their_first_diagonal(result.data)
