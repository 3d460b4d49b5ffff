# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex groups of a mesh are on its subdivision, with the weights of Blender's own modifier."""

from __future__ import annotations

import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.full_mesh import (
    ROUNDING,
    Comparison,
    compare,
    everything,
    weights_of,
)
from tests.blender.subdividing import subdivide


def test_vertex_groups_are_those_of_the_modifier(comparison: Comparison) -> None:
    holder = scene.add_mesh(comparison.mesh)
    assert [group.name for group in holder.vertex_groups] == ["All", "Some", "Zero", "Empty"]
    assert [group.lock_weight for group in holder.vertex_groups] == [False, True, False, False]
    assert holder.vertex_groups.active_index == 2
    own, blenders = weights_of(comparison.mesh), weights_of(comparison.blenders)
    assert 0 < sum(1 in weights for weights in own) < len(own)
    for number, weights in enumerate(own):
        expected = blenders[comparison.vertices[number]]
        for group in range(4):
            assert weights.get(group, 0.0) == pytest.approx(expected.get(group, 0.0), abs=ROUNDING)
    # Blender before 5.2 leaves vertices between weights of zero out of a group, and since then it takes in vertices of
    # weight zero with nothing but members of the group across the face.
    members = [{group for group in weights if group != 2 and weights[group] > 0} for weights in own]
    assert members == [{group for group in weights if group != 2} for weights in own]
    assert 3 < sum(2 in weights for weights in own) < len(own)


def test_an_object_being_edited_is_not_in_the_way() -> None:
    holder = everything()
    with addon.edit_mode(scene.add_object(meshes.cube())):
        comparison = compare(holder)
    assert sum(0 in weights for weights in weights_of(comparison.mesh)) == len(comparison.mesh.vertices)


@pytest.mark.parametrize("name", ["UVMap", "Paint", "sharp_face", "ccdepth_weights_0"])
def test_a_vertex_group_may_have_the_name_of_an_attribute(name: str) -> None:
    holder = scene.add_suzanne()
    mesh = holder.data
    mesh.uv_layers.new(name="UVMap")
    mesh.attributes.new("Paint", "FLOAT_COLOR", "CORNER")
    if "sharp_face" not in mesh.attributes:
        mesh.attributes.new("sharp_face", "BOOLEAN", "FACE")
    mesh.attributes.active = mesh.attributes["Paint"]
    for group in (name, "Other"):
        holder.vertex_groups.new(name=group).add([*range(100)], 0.5, "REPLACE")
    [result] = subdivide(holder)
    assert [group.name for group in result.vertex_groups] == [name, "Other"]
    assert {"UVMap", "Paint", "sharp_face"} <= {*result.data.attributes.keys()}
    assert not any(attribute.name.startswith("ccdepth_weights") for attribute in result.data.attributes)
    assert holder.data.attributes.active.name == result.data.attributes.active.name == "Paint"
    assert [round(entry.weight, 5) for entry in result.data.vertices[0].groups] == [0.5, 0.5]
