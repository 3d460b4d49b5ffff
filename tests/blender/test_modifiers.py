# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface meant: modifiers above the Subdivision Surface modifier, its settings, and shape keys."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import bpy
import numpy as np
import pytest

from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.blender import addon, scene

pytestmark = pytest.mark.every_blender

TOLERANCE = 0.01


def core_depths(mesh: bpy.types.Mesh, *, smooth_corners: bool = True) -> np.ndarray:
    """(F,) int32: what the core says of a Blender mesh, by the scene's method."""
    explicit = apply_boundary_rule(scene.polygon_mesh_of(mesh), smooth_corners=smooth_corners)
    return face_depths(explicit, TOLERANCE, bpy.context.scene.ccdepth.method, "CONTROL").depths


def evaluated(holder: bpy.types.Object) -> bpy.types.Mesh:
    return holder.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def computed(holder: bpy.types.Object, **settings: object) -> np.ndarray:
    """(F,) int32: the depths that are computed."""
    addon.compute(holder, tolerance=TOLERANCE, **settings)
    return addon.depths(holder)


def everything_in_the_file() -> list[str]:
    return [item.name_full for item in bpy.data.user_map()]


def displace(holder: bpy.types.Object, strength: float = 5.0) -> bpy.types.Modifier:
    modifier = holder.modifiers.new("Displace", "DISPLACE")
    modifier.strength = strength
    return modifier


def node_group(*kinds: str) -> bpy.types.NodeTree:
    """Geometry goes through nodes of these kinds."""
    tree = bpy.data.node_groups.new("Group", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    chain = [tree.nodes.new(kind) for kind in ("NodeGroupInput", *kinds, "NodeGroupOutput")]
    for one, other in pairwise(chain):
        tree.links.new(one.outputs[0], other.inputs[0])
    return tree


# The largest depth of what each face becomes.


def test_a_mirror_gives_each_face_the_largest_depth_of_its_copies() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    holder.modifiers.new("Mirror", "MIRROR")
    count = len(holder.data.polygons)
    mirrored = core_depths(evaluated(holder))
    found = computed(holder)
    np.testing.assert_array_equal(found, np.maximum(mirrored[:count], mirrored[count:]))
    assert int(holder.data.ccdepth.uniform_faces) > 4 ** (mirrored.max() - 1) * len(holder.data.loops)
    bpy.ops.ccdepth.clear()
    # Edit Mode counts modifiers as well.
    with addon.edit_mode(holder):
        bpy.ops.ccdepth.compute(tolerance=TOLERANCE, tolerance_mode="ABSOLUTE")
    np.testing.assert_array_equal(addon.depths(holder), found)


def test_an_array_gives_each_face_the_largest_depth_of_its_copies() -> None:
    holder = scene.add_object(meshes.landscape(5, 5))
    array = holder.modifiers.new("Array", "ARRAY")
    array.count, array.use_merge_vertices = 3, True
    copies = core_depths(evaluated(holder)).reshape(3, -1)
    np.testing.assert_array_equal(computed(holder), copies.max(axis=0))


@pytest.mark.parametrize("kind", ["MIRROR", "ARRAY", "BEVEL", "SOLIDIFY", "TRIANGULATE", "EDGE_SPLIT", "WIREFRAME"])
def test_the_deepest_face_is_that_of_the_modified_mesh(kind: str) -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Modifier", kind)
    before = everything_in_the_file()
    computed(holder)
    assert holder.data.ccdepth.deepest == core_depths(evaluated(holder)).max()
    assert everything_in_the_file() == before


def test_a_simple_subdivision_is_a_modifier_like_any_other() -> None:
    holder = scene.add_suzanne()
    scene.add_subdivision(holder, 1).subdivision_type = "SIMPLE"
    found = core_depths(evaluated(holder))
    scene.add_subdivision(holder, 2)
    sizes = [polygon.loop_total for polygon in holder.data.polygons]
    np.testing.assert_array_equal(computed(holder), np.maximum.reduceat(found, np.cumsum(sizes) - sizes))


def test_faces_a_modifier_takes_away_need_no_level() -> None:
    holder = scene.add_object(meshes.landscape(6, 5))
    group = holder.vertex_groups.new(name="Shown")
    group.add(range(len(holder.data.vertices) // 2), 1.0, "REPLACE")
    holder.modifiers.new("Mask", "MASK").vertex_group = group.name
    shown = core_depths(evaluated(holder))
    depths = computed(holder)
    assert 0 < len(shown) < len(depths)
    assert np.count_nonzero(depths) == np.count_nonzero(shown)
    assert np.count_nonzero(addon.bounds(holder)) <= len(shown)


# What counts.


def test_modifiers_count_that_are_above_the_subdivision_and_shown() -> None:
    holder = scene.add_suzanne()
    modifier = displace(holder)
    np.testing.assert_array_equal(computed(holder), core_depths(evaluated(holder)))
    own = core_depths(holder.data)
    assert not np.array_equal(addon.depths(holder), own)
    np.testing.assert_array_equal(computed(holder, use_modifiers=False), own)
    modifier.show_viewport = False
    np.testing.assert_array_equal(computed(holder), own)
    holder.modifiers.clear()
    scene.add_subdivision(holder, 2)
    displace(holder)
    np.testing.assert_array_equal(computed(holder), own)


def test_the_first_subdivision_shown_in_the_viewport_is_meant() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    scene.add_subdivision(holder, 1, boundary="ALL").show_viewport = False
    scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS")
    np.testing.assert_array_equal(computed(holder), core_depths(holder.data, smooth_corners=False))


@pytest.mark.parametrize("boundary", ["ALL", "PRESERVE_CORNERS"])
def test_the_boundary_option_rules(boundary: str) -> None:
    holder = scene.add_object(meshes.landscape(3, 3))
    scene.add_subdivision(holder, 1, boundary=boundary)
    assert not np.array_equal(core_depths(holder.data), core_depths(holder.data, smooth_corners=False))
    np.testing.assert_array_equal(computed(holder), core_depths(holder.data, smooth_corners=boundary == "ALL"))


def test_creases_can_be_off() -> None:
    holder = scene.add_object(meshes.with_random_creases(meshes.torus(8, 5), share=0.5))
    scene.add_subdivision(holder, 1)
    np.testing.assert_array_equal(computed(holder), core_depths(holder.data))
    holder.modifiers[0].use_creases = False
    found = computed(holder)
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
    np.testing.assert_array_equal(computed(holder), core_depths(evaluated(holder)))
    assert key.value == 0.5
    assert len(bpy.data.shape_keys) == 1


def test_an_animated_object_is_taken_as_it_is_shown() -> None:
    holder = scene.add_suzanne()
    modifier = displace(holder, 0.0)
    modifier.keyframe_insert("strength", frame=1)
    modifier.strength = 3.0
    shown = core_depths(evaluated(holder))
    np.testing.assert_array_equal(computed(holder), shown)
    assert modifier.strength == 3.0


def limited_by_group(holder: bpy.types.Object) -> None:
    holder.vertex_groups.new(name="None")
    holder.vertex_groups.new(name="Some").add([0, 1], 1.0, "REPLACE")
    modifier = displace(holder, 3.0)
    modifier.vertex_group, modifier.mid_level = "Some", 0.0


def limited_by_material(holder: bpy.types.Object) -> None:
    """Geometry Nodes move the vertices of faces with the second material."""
    for name in ("First", "Second"):
        holder.data.materials.append(bpy.data.materials.new(name))
    holder.data.polygons[0].material_index = 1
    tree = node_group("GeometryNodeSetPosition")
    move, chosen = tree.nodes["Set Position"], tree.nodes.new("GeometryNodeMaterialSelection")
    chosen.inputs["Material"].default_value = bpy.data.materials["Second"]
    move.inputs["Offset"].default_value = (3.0, 0.0, 0.0)
    tree.links.new(chosen.outputs[0], move.inputs["Selection"])
    holder.modifiers.new("Nodes", "NODES").node_group = tree


@pytest.mark.parametrize("limit", [limited_by_group, limited_by_material])
def test_groups_and_materials_limit_modifiers_in_edit_mode_as_well(limit: Callable[[bpy.types.Object], None]) -> None:
    holder = scene.add_object(meshes.cube())
    limit(holder)
    settings = {"tolerance": TOLERANCE, "tolerance_mode": "ABSOLUTE", "method": "CERTIFIED"}
    addon.compute(holder, **settings, use_modifiers=True)
    in_object_mode = addon.bounds(holder)
    addon.compute(holder, **settings, use_modifiers=False)
    assert not np.array_equal(addon.bounds(holder), in_object_mode)
    with addon.edit_mode(holder):
        assert bpy.ops.ccdepth.compute(**settings, use_modifiers=True) == {"FINISHED"}
    np.testing.assert_array_equal(addon.bounds(holder), in_object_mode)


# Faces that are lost.


@pytest.mark.parametrize("kind", ["REMESH", "DECIMATE", "NODES", "CLOTH"])
def test_modifiers_that_lose_the_faces_are_named(kind: str) -> None:
    holder, other = scene.add_suzanne(), scene.add_object(meshes.cube())
    holder.modifiers.new("Innocent", "MIRROR")
    culprit = holder.modifiers.new("The Culprit", kind)
    if kind == "DECIMATE":
        culprit.ratio = 0.5
    if kind == "NODES":
        culprit.node_group = node_group("GeometryNodeConvexHull")
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
    boolean = holder.modifiers.new("Boolean", "BOOLEAN")
    boolean.object = scene.add_object(meshes.cube(), "Cutter")
    boolean.object.location = (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    control = addon.module("exchange.control_mesh").read_control_mesh(bpy.context, holder, use_modifiers=True)
    assert np.count_nonzero(control.base_faces < 0) > 0
    assert len(computed(holder)) == len(holder.data.polygons)


def test_origins_that_were_averaged_are_not_taken_for_origins() -> None:
    frozen_copies = addon.module("exchange.frozen_copies")
    holder = scene.add_object(meshes.landscape(8, 8))
    mesh = holder.data
    name = frozen_copies._write_origins(holder, mesh)
    pairs = np.empty(2 * len(mesh.polygons), dtype=np.int32)
    mesh.attributes[name].data.foreach_get("value", pairs)
    averaged = pairs.reshape(-1, 2).copy()
    averaged[0] = (averaged[2] + averaged[4]) // 2
    mesh.attributes[name].data.foreach_set("value", averaged.ravel())
    origins = frozen_copies._read_origins(mesh, name, len(mesh.polygons))
    assert origins[0] == frozen_copies.NO_ORIGIN
    np.testing.assert_array_equal(origins[1:], np.arange(1, len(mesh.polygons)))
