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
    source, result = made_result()
    assert visible(source, result) == [HIDDEN, SHOWN]
    assert bpy.ops.ccdepth.show_source() == {"FINISHED"}
    assert visible(source, result) == [SHOWN, HIDDEN]
    assert bpy.context.view_layer.objects.active == source
    assert bpy.ops.ccdepth.show_result() == {"FINISHED"}
    assert visible(source, result) == [HIDDEN, SHOWN]
    assert bpy.context.view_layer.objects.active == result


def test_several_are_swapped_together() -> None:
    sources = [scene.add_object(meshes.cube(), "One"), scene.add_object(meshes.cube(), "Two")]
    results = subdivide(*sources)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    bpy.context.scene.collection.objects.link(lamp)
    lamp.select_set(True)
    bpy.context.view_layer.objects.active = results[1]
    assert bpy.ops.ccdepth.show_source() == {"FINISHED"}
    assert visible(*sources, *results, lamp) == [SHOWN, SHOWN, HIDDEN, HIDDEN, SHOWN]
    assert bpy.context.view_layer.objects.active == sources[1]


def test_a_source_in_another_scene_is_told() -> None:
    source, result = made_result()
    bpy.data.scenes.new("Other").collection.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    with pytest.raises(RuntimeError, match="is in the scene “Other”, and cannot be shown here"):
        bpy.ops.ccdepth.show_source()
    assert visible(result) == [SHOWN]


def test_a_source_in_a_hidden_collection_is_told() -> None:
    source, result = made_result()
    collection = bpy.data.collections.new("Cages")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(source)
    bpy.context.scene.collection.objects.unlink(source)
    collection.hide_viewport = True
    with pytest.raises(RuntimeError, match="in a hidden collection"):
        bpy.ops.ccdepth.show_source()
    assert visible(result) == [SHOWN]
    assert source.hide_get()


def test_removed_results_are_no_longer_offered() -> None:
    source, result = made_result()
    bpy.data.objects.remove(result)
    source.hide_set(False)
    addon.select(source)
    assert not bpy.ops.ccdepth.show_result.poll()
    assert not bpy.ops.ccdepth.update.poll()


def test_a_duplicate_made_by_the_user_is_shown_as_well() -> None:
    source, result = made_result()
    bpy.ops.object.duplicate()
    copy = bpy.context.view_layer.objects.active
    bpy.context.view_layer.update()
    addon.select(result, copy)
    bpy.ops.ccdepth.show_source()
    bpy.ops.ccdepth.show_result()
    assert visible(source, result, copy) == [HIDDEN, SHOWN, SHOWN]


def test_it_works_in_object_mode_alone() -> None:
    _, result = made_result()
    with addon.edit_mode(result):
        assert not bpy.ops.ccdepth.show_source.poll()
