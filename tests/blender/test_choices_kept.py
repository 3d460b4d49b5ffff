# SPDX-License-Identifier: GPL-3.0-or-later
"""The attribute a user has made the active one stays it, whatever CC Depth puts on the mesh or takes off it."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

# In the order in which Blender lists attributes some come before ours and some after.
NAMES = (None, "point", "face", "corner", "UVMap")


def holder_with_attributes() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube())
    for name, domain in (("point", "POINT"), ("face", "FACE"), ("corner", "CORNER")):
        holder.data.attributes.new(name, "FLOAT", domain)
    holder.data.uv_layers.new(name="UVMap")
    addon.select(holder)
    return holder


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
@pytest.mark.parametrize("name", NAMES)
def test_active_attribute(mode: str, name: str | None) -> None:
    holder = holder_with_attributes()
    bpy.ops.object.mode_set(mode=mode)
    attributes = holder.data.attributes
    attributes.active = None if name is None else attributes[name]
    for operator in (bpy.ops.ccdepth.compute, bpy.ops.ccdepth.compute, bpy.ops.ccdepth.clear):
        assert operator() == {"FINISHED"}
        assert (attributes.active and attributes.active.name) == name
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT"])
def test_rendered_colour_chosen_since_is_not_left_without_an_attribute(mode: str) -> None:
    holder = holder_with_attributes()
    bpy.ops.object.mode_set(mode=mode)
    assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    attributes = holder.data.attributes
    attributes.default_color_name = "ccdepth_color"
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert attributes.default_color_name == ""
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize("domain", ["POINT", "EDGE", "FACE", "CORNER"])
def test_displayed_colours_of_any_domain(domain: str) -> None:
    """Blender displays the first colours that are made, also where it does not list them among the colours."""
    holder = scene.add_object(meshes.cube())
    attributes = holder.data.attributes
    attributes.new("Paint", "FLOAT_COLOR", domain)
    attributes.active_color_name = attributes.default_color_name = "Paint"
    addon.compute(holder)
    assert bpy.ops.ccdepth.clear() == {"FINISHED"}
    assert (attributes.active_color_name, attributes.default_color_name) == ("Paint", "Paint")


@pytest.mark.parametrize(("data_type", "domain"), [("FLOAT", "FACE"), ("BOOLEAN", "POINT")])
def test_attribute_named_like_flat_faces(data_type: str, domain: str) -> None:
    """Exact normals take flat shading off, and nothing else that has its name."""
    holder = scene.add_object(meshes.cube())
    attributes = holder.data.attributes
    if "sharp_face" in attributes:
        attributes.remove(attributes["sharp_face"])
    if attributes.new("sharp_face", data_type, domain) is None:
        pytest.skip("this Blender keeps the name for itself")
    addon.select(holder)
    assert bpy.ops.ccdepth.subdivide(tolerance=0.1, exact_normals=True) == {"FINISHED"}
    kept = bpy.context.object.data.attributes["sharp_face"]
    assert (kept.data_type, kept.domain) == (data_type, domain)
