# SPDX-License-Identifier: GPL-3.0-or-later
"""Many objects at once: the scene is evaluated a few times for all of them, and the work can be stopped on the way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

COUNT = 150
BATCHES = 2

# Blender evaluates the scene before and after each operator and at its end as well, however many objects there are.
OTHER_EVALUATIONS = 8


def many(*, shared: bool, modifier: str = "") -> list[bpy.types.Object]:
    first = scene.add_object(meshes.cube())
    first.vertex_groups.new(name="Kept").add(first.data.polygons[0].vertices[:], 1.0, "REPLACE")
    objects = [first]
    for index in range(1, COUNT):
        objects.append(scene.add_mesh(first.data if shared else first.data.copy()))
        objects[-1].scale.x = 1.0 + index / COUNT
        objects[-1].scale.y = 1.0 / objects[-1].scale.x
    for holder in objects if modifier else ():
        added = holder.modifiers.new(modifier.title(), modifier)
        if modifier == "MASK":
            added.vertex_group = "Kept"
    return objects


@contextmanager
def counted_evaluations() -> Iterator[list[int]]:
    """Counts how often Blender evaluates a scene with objects in it: each time takes as long as there are objects."""
    evaluations: list[int] = []

    def count(evaluated: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if evaluated.objects:
            evaluations.append(len(depsgraph.updates))

    bpy.app.handlers.depsgraph_update_post.append(count)
    try:
        yield evaluations
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(count)


@pytest.mark.parametrize("operator", ["compute", "subdivide"])
@pytest.mark.parametrize("modifier", ["", "BEVEL", "MASK"])
@pytest.mark.parametrize("shared", [False, True])
def test_the_scene_is_evaluated_a_few_times(operator: str, modifier: str, shared: bool) -> None:
    addon.select(*many(shared=shared, modifier=modifier))
    with counted_evaluations() as evaluations:
        assert getattr(bpy.ops.ccdepth, operator)(tolerance=0.1) == {"FINISHED"}
    assert len(evaluations) <= OTHER_EVALUATIONS + 6 * BATCHES


def test_each_has_its_own_result() -> None:
    objects = many(shared=False, modifier="BEVEL")
    objects[7].modifiers[0].segments = 4
    addon.compute(*objects)
    assert objects[7].data.ccdepth.added_deepest >= 0
    alone = scene.add_mesh(objects[7].data.copy())
    alone.matrix_world = objects[7].matrix_world
    alone.modifiers.new("Bevel", "BEVEL").segments = 4
    expected = addon.depths(objects[7])
    addon.compute(alone)
    assert addon.depths(alone).tolist() == expected.tolist()


def test_giving_up_while_reading_or_writing_leaves_everything() -> None:
    objects = many(shared=False, modifier="BEVEL")
    addon.select(*objects)
    bpy.context.view_layer.update()
    subdivision, made = addon.module("tasks.adaptive_task"), addon.module("operators.adaptive_objects")
    settings = subdivision.AdaptiveSettings(0.1, "RELATIVE", True, "ADAPTIVE", "TRIANGLES", 5_000_000)
    before = {kind: set(getattr(bpy.data, kind)) for kind in ("objects", "meshes")}

    def is_as_before() -> bool:
        return all(set(getattr(bpy.data, kind)) == found for kind, found in before.items())

    reading = subdivision.prepare_adaptive(bpy.context, objects, settings)
    next(reading)
    next(reading)
    reading.close()
    assert is_as_before()
    tasks = addon.module("tasks.stepwise").Stepwise(subdivision.prepare_adaptive(bpy.context, objects, settings))
    tasks.work()
    answers = subdivision.subdivide(tasks.answer, settings)
    writing = made.make_meshes(bpy.context, answers, settings, exact_normals=False)
    next(writing)
    next(writing)
    assert not is_as_before()
    writing.close()
    assert is_as_before()
