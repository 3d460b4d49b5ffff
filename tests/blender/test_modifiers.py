# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface meant: modifiers above the Subdivision Surface modifier, its settings, and shape keys."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import addon, scene

TOLERANCE = 0.01


def core_depths(mesh: bpy.types.Mesh, *, smooth_corners: bool = True) -> np.ndarray:
    """(F,) int32: what the core says of a Blender mesh, by the scene's method."""
    explicit = apply_boundary_rule(scene.polygon_mesh_of(mesh), smooth_corners=smooth_corners)
    return face_depths(explicit, TOLERANCE, bpy.context.scene.ccdepth.method, "CONTROL").depths


def evaluated(holder: bpy.types.Object) -> bpy.types.Mesh:
    return holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def everything_in_the_file() -> list[str]:
    return [item.name_full for item in bpy.data.user_map()]


def test_a_mirror_gives_each_face_the_largest_depth_of_its_copies() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.data.transform(((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))
    holder.modifiers.new("Mirror", "MIRROR")
    count = len(holder.data.polygons)
    mirrored = core_depths(evaluated(holder))
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), np.maximum(mirrored[:count], mirrored[count:]))
    assert int(holder.data.ccdepth.uniform_faces) > 4 ** (mirrored.max() - 1) * len(holder.data.loops)


def test_an_array_gives_each_face_the_largest_depth_of_its_copies() -> None:
    holder = scene.add_object(meshes.landscape(5, 5))
    array = holder.modifiers.new("Array", "ARRAY")
    array.count = 3
    array.use_merge_vertices = True
    copies = core_depths(evaluated(holder)).reshape(3, -1)
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), copies.max(axis=0))


def test_modifiers_can_be_left_out() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    displace = holder.modifiers.new("Displace", "DISPLACE")
    displace.strength = 5.0
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(evaluated(holder)))
    addon.compute(holder, tolerance=TOLERANCE, use_modifiers=False)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data))


def test_only_modifiers_above_the_subdivision_count() -> None:
    holder = scene.add_suzanne()
    scene.add_subdivision(holder, 2)
    holder.modifiers.new("Displace", "DISPLACE").strength = 5.0
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data))


def test_modifiers_that_are_off_in_the_viewport_do_not_count() -> None:
    holder = scene.add_suzanne()
    displace = holder.modifiers.new("Displace", "DISPLACE")
    displace.strength, displace.show_viewport = 5.0, False
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data))


def test_a_simple_subdivision_is_a_modifier_like_any_other() -> None:
    holder = scene.add_suzanne()
    simple = scene.add_subdivision(holder, 1)
    simple.subdivision_type = "SIMPLE"
    found = core_depths(evaluated(holder))
    scene.add_subdivision(holder, 2)
    addon.compute(holder, tolerance=TOLERANCE)
    deepest = np.zeros(len(holder.data.polygons), dtype=np.int32)
    sizes = [polygon.loop_total for polygon in holder.data.polygons]
    np.maximum.at(deepest, np.repeat(np.arange(len(sizes)), sizes), found)
    np.testing.assert_array_equal(addon.depths(holder), deepest)


def test_the_first_subdivision_shown_in_the_viewport_is_meant() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    scene.add_subdivision(holder, 1, boundary="ALL").show_viewport = False
    scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS")
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data, smooth_corners=False))


@pytest.mark.parametrize("boundary", ["ALL", "PRESERVE_CORNERS"])
def test_the_boundary_option_rules(boundary: str) -> None:
    holder = scene.add_object(meshes.landscape(3, 3))
    scene.add_subdivision(holder, 1, boundary=boundary)
    addon.compute(holder, tolerance=TOLERANCE)
    assert not np.array_equal(core_depths(holder.data), core_depths(holder.data, smooth_corners=False))
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data, smooth_corners=boundary == "ALL"))


def test_creases_can_be_off() -> None:
    holder = scene.add_object(meshes.with_random_creases(meshes.torus(8, 5), share=0.5))
    scene.add_subdivision(holder, 1)
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(holder.data))
    holder.modifiers[0].use_creases = False
    addon.compute(holder, tolerance=TOLERANCE)
    found = addon.depths(holder)
    for name in ("crease_edge", "crease_vert"):
        if name in holder.data.attributes:
            holder.data.attributes.remove(holder.data.attributes[name])
    np.testing.assert_array_equal(found, core_depths(holder.data))


def test_shape_keys_are_mixed() -> None:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    key = holder.shape_key_add(name="Tall")
    for point in key.data:
        point.co.z *= 4.0
    key.value = 0.5
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), core_depths(evaluated(holder)))
    assert key.value == 0.5
    assert len(bpy.data.shape_keys) == 1


def test_an_animated_object_is_taken_as_it_is_shown() -> None:
    holder = scene.add_suzanne()
    displace = holder.modifiers.new("Displace", "DISPLACE")
    displace.strength = 0.0
    displace.keyframe_insert("strength", frame=1)
    displace.strength = 3.0
    shown = core_depths(evaluated(holder))
    addon.compute(holder, tolerance=TOLERANCE)
    np.testing.assert_array_equal(addon.depths(holder), shown)
    assert displace.strength == 3.0


def test_edit_mode_counts_modifiers_as_well() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.modifiers.new("Mirror", "MIRROR")
    addon.compute(holder, tolerance=TOLERANCE)
    found = addon.depths(holder)
    bpy.ops.ccdepth.clear()
    with addon.edit_mode(holder):
        bpy.ops.ccdepth.compute(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE")
    np.testing.assert_array_equal(addon.depths(holder), found)


@pytest.mark.parametrize("kind", ["MIRROR", "ARRAY", "BEVEL", "SOLIDIFY", "TRIANGULATE", "EDGE_SPLIT", "WIREFRAME"])
def test_every_face_gets_the_largest_depth_of_what_it_becomes(kind: str) -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Modifier", kind)
    before = everything_in_the_file()
    addon.compute(holder, tolerance=TOLERANCE)
    assert holder.data.ccdepth.deepest == core_depths(evaluated(holder)).max()
    assert everything_in_the_file() == before


def test_faces_a_modifier_takes_away_need_no_level() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    group = holder.vertex_groups.new(name="Shown")
    group.add([vertex.index for vertex in holder.data.vertices if vertex.co.x < 0.0], 1.0, "REPLACE")
    if len(group_members(holder)) in {0, len(holder.data.vertices)}:
        group.add(range(len(holder.data.vertices) // 2), 1.0, "REPLACE")
    holder.modifiers.new("Mask", "MASK").vertex_group = group.name
    shown = core_depths(evaluated(holder))
    addon.compute(holder, tolerance=TOLERANCE)
    depths = addon.depths(holder)
    assert 0 < len(shown) < len(depths)
    assert np.count_nonzero(depths) == np.count_nonzero(shown)
    assert np.count_nonzero(addon.bounds(holder)) <= len(shown)


def group_members(holder: bpy.types.Object) -> list[int]:
    return [vertex.index for vertex in holder.data.vertices if len(vertex.groups)]


def add_remesh(holder: bpy.types.Object) -> None:
    holder.modifiers.new("The Culprit", "REMESH")


def add_decimate(holder: bpy.types.Object) -> None:
    holder.modifiers.new("The Culprit", "DECIMATE").ratio = 0.5


def add_convex_hull(holder: bpy.types.Object) -> None:
    tree = bpy.data.node_groups.new("Hull", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    hull = tree.nodes.new("GeometryNodeConvexHull")
    tree.links.new(start.outputs[0], hull.inputs[0])
    tree.links.new(hull.outputs[0], end.inputs[0])
    holder.modifiers.new("The Culprit", "NODES").node_group = tree


def add_cloth(holder: bpy.types.Object) -> None:
    holder.modifiers.new("The Culprit", "CLOTH")


@pytest.mark.parametrize("add_culprit", [add_remesh, add_decimate, add_convex_hull, add_cloth])
def test_modifiers_that_lose_the_faces_are_named(add_culprit: Callable[[bpy.types.Object], None]) -> None:
    holder = scene.add_suzanne()
    other = scene.add_object(meshes.cube())
    holder.modifiers.new("Innocent", "MIRROR")
    add_culprit(holder)
    holder.modifiers.new("Innocent", "TRIANGULATE")
    addon.select(other, holder)
    before = everything_in_the_file()
    with pytest.raises(RuntimeError, match=f"{holder.name}: the modifier “The Culprit”"):
        bpy.ops.ccdepth.compute()
    assert addon.is_untouched([holder, other])
    assert everything_in_the_file() == before
    assert bpy.ops.ccdepth.compute(use_modifiers=False) == {"FINISHED"}


def test_faces_that_come_from_no_face_are_not_mistaken_for_copies() -> None:
    holder = scene.add_suzanne()
    cutter = scene.add_object(meshes.cube(), "Cutter")
    boolean = holder.modifiers.new("Boolean", "BOOLEAN")
    boolean.object = cutter
    cutter.location = (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    control = addon.module("exchange.control_mesh").read_control_mesh(bpy.context, holder, use_modifiers=True)
    assert np.count_nonzero(control.base_faces < 0) > 0
    addon.compute(holder, tolerance=TOLERANCE)
    assert len(addon.depths(holder)) == len(holder.data.polygons)


def test_origins_that_were_averaged_are_not_taken_for_origins() -> None:
    frozen_copies = addon.module("exchange.frozen_copies")
    holder = scene.add_object(meshes.landscape(8, 8))
    mesh = holder.data
    name = frozen_copies._write_origins(holder, mesh)
    attribute = mesh.attributes[name]
    pairs = np.empty(2 * len(mesh.polygons), dtype=np.int32)
    attribute.data.foreach_get("value", pairs)
    averaged = pairs.reshape(-1, 2).copy()
    averaged[0] = (averaged[2] + averaged[4]) // 2
    attribute.data.foreach_set("value", averaged.ravel())
    origins = frozen_copies._read_origins(mesh, name, len(mesh.polygons))
    assert origins[0] == frozen_copies.NO_ORIGIN
    np.testing.assert_array_equal(origins[1:], np.arange(1, len(mesh.polygons)))
