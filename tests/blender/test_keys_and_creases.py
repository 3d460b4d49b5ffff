# SPDX-License-Identifier: GPL-3.0-or-later
"""Creases of a kind that must be converted leave no shape keys behind.

Those of a copy of an evaluated mesh belong to no mesh, and crash Blender once they are looked at.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

OPERATORS: dict[str, Callable[..., set[str]]] = {
    "compute": lambda: bpy.ops.ccdepth.compute(tolerance=0.1),
    "count_faces": lambda: bpy.ops.ccdepth.count_faces(tolerance=0.1),
    "subdivide": lambda: bpy.ops.ccdepth.subdivide(tolerance=0.1),
}


@pytest.mark.parametrize("name", OPERATORS)
@pytest.mark.parametrize("modifier", [None, "CAST"])
def test_no_stray_keys(name: str, modifier: str | None) -> None:
    holder = scene.add_object(meshes.cube())
    holder.data.attributes.new("crease_edge", "FLOAT", "POINT").data[0].value = 0.5
    holder.data.attributes.new("crease_vert", "INT", "CORNER")
    holder.shape_key_add(name="Basis")
    holder.shape_key_add(name="Key").points[0].co.x += 0.5
    if modifier is not None:
        holder.modifiers.new(modifier, modifier)
    addon.select(holder)
    assert OPERATORS[name]() == {"FINISHED"}
    assert all(keys.user is not None and keys.user.shape_keys == keys for keys in bpy.data.shape_keys)
    bpy.context.scene.frame_set(2)
    assert all(key.points[0].co.length > 0 for keys in bpy.data.shape_keys for key in keys.key_blocks)
