# SPDX-License-Identifier: GPL-3.0-or-later
"""The materials of a picture: surfaces that glow in their own colours."""

from __future__ import annotations

from typing import Any

import bpy

from ..exchange.face_values import COLOR

# A face turned away from the light keeps this part of its colour: less than from one depth to the next.
SHADOW = 0.8
LIGHT = (-0.40, 0.55, 0.73)


def give_material(data: Any, material: bpy.types.Material) -> None:
    """Give a mesh a single material."""
    data.materials.clear()
    data.materials.append(material)


def emission_material() -> bpy.types.Material:
    """A material that glows in its object's colour."""
    material, _nodes, emission = _new_emission("CC Depth Glow")
    source = material.node_tree.nodes.new("ShaderNodeObjectInfo")
    material.node_tree.links.new(source.outputs["Color"], emission.inputs["Color"])
    return material


def surface_material(has_heat_map: bool) -> bpy.types.Material:
    """A material that glows in the colours of the results, or of its object, a little less on sides turned away from
    the light."""
    material, nodes, emission = _new_emission("CC Depth Surface")
    links = material.node_tree.links
    if has_heat_map:
        color = nodes.new("ShaderNodeAttribute")
        color.attribute_name = COLOR
    else:
        color = nodes.new("ShaderNodeObjectInfo")
    links.new(color.outputs["Color"], emission.inputs["Color"])
    cosine = nodes.new("ShaderNodeVectorMath")
    cosine.operation = "DOT_PRODUCT"
    cosine.inputs[1].default_value = LIGHT
    links.new(nodes.new("ShaderNodeNewGeometry").outputs["Normal"], cosine.inputs[0])
    strength = nodes.new("ShaderNodeMapRange")
    strength.inputs["From Min"].default_value = -0.1
    strength.inputs["To Min"].default_value = SHADOW
    links.new(cosine.outputs["Value"], strength.inputs["Value"])
    links.new(strength.outputs["Result"], emission.inputs["Strength"])
    return material


def _new_emission(name: str) -> tuple[bpy.types.Material, bpy.types.Nodes, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    emission = nodes.new("ShaderNodeEmission")
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material, nodes, emission
