# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's own conversion of attributes, which is one of its operators."""

from __future__ import annotations

from typing import Any

import bpy


def convert_attribute(holder: bpy.types.Object, name: str, **settings: Any) -> None:
    """Convert an attribute of the mesh of ``holder``, which belongs to no scene, as Convert Attribute does.

    settings: of that operator. Whoever calls an operator has the scene evaluated before and after, which takes as long
    as there are objects in it; so the scene that the operator is told of is an empty one.
    """
    attributes = holder.data.attributes
    attributes.active = attributes[name]
    scene = bpy.data.scenes.new(name)
    try:
        # Another object that is being edited must not stand in the way.
        with bpy.context.temp_override(
            scene=scene, view_layer=scene.view_layers[0], object=holder, active_object=holder, edit_object=None
        ):
            bpy.ops.geometry.attribute_convert(**settings)
    finally:
        bpy.data.scenes.remove(scene)
