# SPDX-License-Identifier: GPL-3.0-or-later
"""Show Source and Show Result swap what is hidden."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import subdivide
from tests.blender.updating import made_result


def visible(*objects: bpy.types.Object) -> list[tuple[bool, bool, bool]]:
    """Whether each is seen, rendered and selected."""
    return [(each.visible_get(), not each.hide_render, each.select_get()) for each in objects]


SHOWN, HIDDEN = (True, True, True), (False, False, False)


def test_source_and_result_are_swapped_and_swapped_back() -> None:
    """In Object Mode alone."""
    source, result = made_result()
    with addon.edit_mode(result):
        assert not bpy.ops.ccdepth.show_source.poll()
    assert visible(source, result) == [HIDDEN, SHOWN]
    assert bpy.ops.ccdepth.show_source() == {"FINISHED"}
    assert visible(source, result) == [SHOWN, HIDDEN]
    assert bpy.context.view_layer.objects.active == source
    assert bpy.ops.ccdepth.show_result() == {"FINISHED"}
    assert visible(source, result) == [HIDDEN, SHOWN]
    assert bpy.context.view_layer.objects.active == result
    # Removed results are no longer offered.
    bpy.data.objects.remove(result)
    source.hide_set(False)
    addon.select(source)
    assert not bpy.ops.ccdepth.show_result.poll()
    assert not bpy.ops.ccdepth.update.poll()


def test_several_are_swapped_together() -> None:
    """And duplicates that the user made of results."""
    sources = [scene.add_object(meshes.cube(), "One"), scene.add_object(meshes.cube(), "Two")]
    results = subdivide(*sources)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    lamp.select_set(True)
    bpy.context.view_layer.objects.active = results[1]
    assert bpy.ops.ccdepth.show_source() == {"FINISHED"}
    assert visible(*sources, *results, lamp) == [SHOWN, SHOWN, HIDDEN, HIDDEN, SHOWN]
    assert bpy.context.view_layer.objects.active == sources[1]
    addon.select(sources[0])
    bpy.ops.ccdepth.show_result()
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    bpy.context.view_layer.update()
    addon.select(results[0], copy)
    bpy.ops.ccdepth.show_source()
    bpy.ops.ccdepth.show_result()
    assert visible(sources[0], results[0], copy) == [HIDDEN, SHOWN, SHOWN]


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("scene", "is in the scene “Other”, and cannot be shown here"),
        ("collection", "in a hidden collection"),
    ],
)
def test_a_source_that_cannot_be_shown_is_told(place: str, message: str) -> None:
    source, result = made_result()
    if place == "scene":
        collection = bpy.data.scenes.new("Other").collection
    else:
        collection = bpy.data.collections.new("Cages")
        bpy.context.scene.collection.children.link(collection)
        collection.hide_viewport = True
    collection.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.ccdepth.show_source()
    assert visible(result) == [SHOWN]
    assert place == "scene" or source.hide_get()
