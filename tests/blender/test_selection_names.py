# SPDX-License-Identifier: GPL-3.0-or-later
"""An attribute that stands where Blender keeps the selection is kept, and named in a report."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene


@pytest.mark.parametrize("name", [".select_vert", ".select_edge", ".select_poly"])
@pytest.mark.parametrize(("data_type", "domain"), [("BOOLEAN", "CORNER"), ("FLOAT", "FACE")])
def test_attribute_where_blender_keeps_the_selection(name: str, data_type: str, domain: str) -> None:
    """Blender itself crashes when a selection is written over it."""
    holder = scene.add_object(meshes.cube(), "Cube")
    addon.compute(holder)
    if name in holder.data.attributes:
        holder.data.attributes.remove(holder.data.attributes[name])
    holder.data.attributes.new(name, data_type, domain)
    with pytest.raises(RuntimeError, match=f"Cube: .* “{name}” that is not a selection"):
        bpy.ops.ccdepth.select(depth=0)
    assert holder.data.attributes[name].data_type == data_type
