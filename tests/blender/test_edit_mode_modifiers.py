# SPDX-License-Identifier: GPL-3.0-or-later
"""In Edit Mode modifiers do to the mesh what they do in Object Mode, also where groups or materials limit them."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene


def limited_by_group(holder: bpy.types.Object) -> None:
    holder.vertex_groups.new(name="None")
    holder.vertex_groups.new(name="Some").add([0, 1], 1.0, "REPLACE")
    displace = holder.modifiers.new("Displace", "DISPLACE")
    displace.vertex_group, displace.strength, displace.mid_level = "Some", 3.0, 0.0


def limited_by_material(holder: bpy.types.Object) -> None:
    """Geometry Nodes move the vertices of faces with the second material."""
    for name in ("First", "Second"):
        holder.data.materials.append(bpy.data.materials.new(name))
    holder.data.polygons[0].material_index = 1
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    inside, outside = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    move, chosen = tree.nodes.new("GeometryNodeSetPosition"), tree.nodes.new("GeometryNodeMaterialSelection")
    chosen.inputs["Material"].default_value = bpy.data.materials["Second"]
    move.inputs["Offset"].default_value = (3.0, 0.0, 0.0)
    tree.links.new(inside.outputs[0], move.inputs["Geometry"])
    tree.links.new(chosen.outputs[0], move.inputs["Selection"])
    tree.links.new(move.outputs[0], outside.inputs[0])
    holder.modifiers.new("Nodes", "NODES").node_group = tree


@pytest.mark.parametrize("limit", [limited_by_group, limited_by_material])
def test_same_depths_in_both_modes(limit: object) -> None:
    holder = scene.add_object(meshes.cube())
    limit(holder)  # type: ignore[operator]
    addon.compute(holder, tolerance=0.01, method="CERTIFIED", use_modifiers=True)
    in_object_mode = addon.bounds(holder)
    addon.compute(holder, tolerance=0.01, method="CERTIFIED", use_modifiers=False)
    assert not np.array_equal(addon.bounds(holder), in_object_mode)
    with addon.edit_mode(holder):
        settings = {"tolerance": 0.01, "tolerance_mode": "ABSOLUTE", "method": "CERTIFIED", "use_modifiers": True}
        assert bpy.ops.ccdepth.compute(**settings) == {"FINISHED"}
    np.testing.assert_array_equal(addon.bounds(holder), in_object_mode)
