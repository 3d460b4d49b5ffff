# SPDX-License-Identifier: GPL-3.0-or-later
"""Attributes of a user's own that stand where Blender or CC Depth has others are kept, and named in a report."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene


@pytest.mark.parametrize(
    "operator", [bpy.ops.ccdepth.compute, bpy.ops.ccdepth.subdivide, bpy.ops.ccdepth.count_faces], ids=repr
)
def test_attribute_that_temporary_copies_need(operator: object) -> None:
    """Results would leave it out, and it would be lost."""
    holder = scene.add_object(meshes.cube(), "Cube")
    holder.data.attributes.new("ccdepth_origin", "FLOAT", "POINT").data.foreach_set("value", np.arange(8.0))
    addon.select(holder)
    with pytest.raises(RuntimeError, match=r"Cube: the mesh has an attribute .* “ccdepth_origin”; rename it first"):
        operator()  # type: ignore[operator]
    assert [each.value for each in holder.data.attributes["ccdepth_origin"].data] == list(range(8))


@pytest.mark.parametrize("name", [".select_vert", ".select_edge", ".select_poly"])
@pytest.mark.parametrize(("data_type", "domain"), [("BOOLEAN", "CORNER"), ("FLOAT", "FACE")])
def test_attribute_where_blender_keeps_the_selection(name: str, data_type: str, domain: str) -> None:
    """Blender itself crashes when a selection is written over it."""
    holder = scene.add_object(meshes.cube(), "Cube")
    addon.compute(holder)
    if name in holder.data.attributes:
        holder.data.attributes.remove(holder.data.attributes[name])
    holder.data.attributes.new(name, data_type, domain)
    with pytest.raises(RuntimeError, match=f"Cube: .* “{name}” that is no selection"):
        bpy.ops.ccdepth.select(depth=0)
    assert holder.data.attributes[name].data_type == data_type
