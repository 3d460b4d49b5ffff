# SPDX-License-Identifier: GPL-3.0-or-later
"""Many objects at once: the scene is evaluated a few times for all of them, and the work can be stopped on the way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

# Of each kind, so that all together are more than are evaluated at once: in two groups.
COUNT = 25
BATCHES = 2

# Blender evaluates the scene before and after each operator and at its end as well, however many objects there are.
OTHER_EVALUATIONS = 8


def many() -> list[bpy.types.Object]:
    """Of other scales: without a modifier, with one that adds faces and with one that removes some; and of each such
    kind some that share their mesh and some with meshes of their own."""
    objects = []
    for modifier, shared in product(("", "BEVEL", "MASK"), (False, True)):
        first = scene.add_object(meshes.cube())
        first.vertex_groups.new(name="Kept").add(first.data.polygons[0].vertices[:], 1.0, "REPLACE")
        same = [first] + [scene.add_mesh(first.data if shared else first.data.copy()) for _ in range(COUNT - 1)]
        for index, holder in enumerate(same):
            holder.scale.x = 1.0 + index / COUNT
            holder.scale.y = 1.0 / holder.scale.x
            added = holder.modifiers.new(modifier.title(), modifier) if modifier else None
            if modifier == "MASK":
                added.vertex_group = "Kept"
        objects += same
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


@pytest.mark.every_blender
@pytest.mark.parametrize(("operator", "tolerance"), [("compute", 0.1), ("subdivide", 0.3)])
def test_the_scene_is_evaluated_a_few_times_and_each_has_its_own_result(operator: str, tolerance: float) -> None:
    objects = many()
    other = objects[2 * COUNT + 7]
    other.modifiers["Bevel"].segments = 4
    addon.select(*objects)
    with counted_evaluations() as evaluations:
        assert getattr(bpy.ops.ccdepth, operator)(tolerance=tolerance) == {"FINISHED"}
    assert len(evaluations) <= OTHER_EVALUATIONS + 6 * BATCHES
    if operator == "compute":
        assert other.data.ccdepth.added_deepest >= 0
        expected, alone = addon.depths(other), scene.add_mesh(other.data.copy())
        alone.matrix_world = other.matrix_world
        alone.modifiers.new("Bevel", "BEVEL").segments = 4
        addon.compute(alone, tolerance=0.1, tolerance_mode=bpy.context.scene.ccdepth.tolerance_mode)
        assert addon.depths(alone).tolist() == expected.tolist()


def test_giving_up_while_reading_or_writing_leaves_everything() -> None:
    objects = many()
    addon.select(*objects)
    bpy.context.view_layer.update()
    subdivision, made = addon.module("tasks.adaptive_task"), addon.module("operators.adaptive_objects")
    settings = subdivision.AdaptiveSettings(0.3, "RELATIVE", True, "ADAPTIVE", "TRIANGLES", 5_000_000)
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
