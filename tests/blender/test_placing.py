# SPDX-License-Identifier: GPL-3.0-or-later
"""Apply Adaptive Subdivision places all results, or none."""

from __future__ import annotations

from types import ModuleType

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import TOLERANCE, everything_in_the_file
from tests.steps import result_of

pytestmark = pytest.mark.every_blender


def placing() -> ModuleType:
    return addon.module("operators.adaptive_objects")


def made_meshes(objects: list[bpy.types.Object]) -> tuple[object, object]:
    """Their results before they are placed, and the settings."""
    task = addon.module("tasks.adaptive_task")
    settings = task.AdaptiveSettings(TOLERANCE, "ABSOLUTE", True, "ADAPTIVE", "TRIANGLES", 5_000_000)
    tasks = result_of(task.prepare_adaptive(bpy.context, objects, settings))
    answers = task.subdivide(tasks, settings)
    return result_of(placing().make_meshes(bpy.context, answers, settings, exact_normals=False)), settings


def three_objects() -> list[bpy.types.Object]:
    """Two of them share a mesh, one is not selected, and all have modifiers."""
    first = scene.add_object(meshes.cube())
    objects = [first, scene.add_mesh(first.data), scene.add_object(meshes.cube())]
    for holder, name in zip(objects, ("First", "Second", "Third"), strict=True):
        holder.name = name
    objects[1].scale = (3.0, 0.5, 1.0)
    for holder in objects:
        scene.add_subdivision(holder, 1)
    objects[0].hide_render = objects[2].hide_render = True
    addon.select(*objects[:2])
    return objects


@pytest.mark.parametrize("output", ["IN_PLACE", "NEW_OBJECT"])
def test_all_is_placed(output: str) -> None:
    made, settings = made_meshes(three_objects())
    placed = placing().place_meshes(bpy.context, made, settings, in_place=output == "IN_PLACE")
    assert len(placed) == 3
    assert not any(holder.modifiers for holder in placed)
    assert all(holder.data.ccdepth.subdivision for holder in placed)


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_objects_that_cannot_be_placed_beside_leave_all_as_they_were(failing: int) -> None:
    """One has left the view layer meanwhile, which may be the first, or come after others."""
    objects = three_objects()
    before = everything_in_the_file()
    collection = bpy.data.collections.new("Left out")
    made, settings = made_meshes(objects)
    bpy.context.scene.collection.children.link(collection)
    active = bpy.context.view_layer.objects.active
    collection.objects.link(objects[failing])
    bpy.context.scene.collection.objects.unlink(objects[failing])
    bpy.context.view_layer.layer_collection.children["Left out"].exclude = True
    with pytest.raises(addon.module("tasks.surfaces").ComputeError, match="nothing was written"):
        placing().place_meshes(bpy.context, made, settings, in_place=False)
    bpy.context.scene.collection.objects.link(objects[failing])
    bpy.data.collections.remove(collection)
    bpy.context.view_layer.update()
    objects[failing].select_set(before[objects[failing].name][3])
    assert everything_in_the_file() == before
    if failing != 1:
        assert bpy.context.view_layer.objects.active == active


@pytest.mark.parametrize("failing", [1, 2, 3])
def test_whatever_goes_wrong_beside_leaves_all_as_it_was(failing: int, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = three_objects()
    before, active = everything_in_the_file(), bpy.context.view_layer.objects.active
    made, settings = made_meshes(objects)
    link, calls = placing().link_beside, []

    def odd(*arguments: object) -> None:
        calls.append(arguments)
        if len(calls) == failing:
            raise LookupError("odd")
        link(*arguments)

    monkeypatch.setattr(placing(), "link_beside", odd)
    with pytest.raises(LookupError, match="odd"):
        placing().place_meshes(bpy.context, made, settings, in_place=False)
    assert everything_in_the_file() == before
    assert bpy.context.view_layer.objects.active == active


def test_objects_whose_mesh_cannot_be_replaced_leave_all_as_they_were() -> None:
    """The last is in Edit Mode, where Blender drops the new mesh and says nothing."""
    objects = three_objects()
    before = everything_in_the_file()
    made, settings = made_meshes(objects)
    error = addon.module("tasks.surfaces").ComputeError
    with addon.edit_mode(objects[2]), pytest.raises(error, match="nothing was written"):
        placing().place_meshes(bpy.context, made, settings, in_place=True)
    addon.select(*objects[:2])
    assert everything_in_the_file() == before
