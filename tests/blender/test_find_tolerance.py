# SPDX-License-Identifier: GPL-3.0-or-later
"""Find Tolerance: the best tolerance with which adaptive meshes have no more faces than were asked for."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import everything_in_the_file, faces, known_count, subdivide
from tests.blender.updating import made_result, set_scene
from tests.thorough import combinations


def add_hills(name: str = "Hills") -> bpy.types.Object:
    return scene.add_object(meshes.landscape(4, 4), name)


def find(*objects: bpy.types.Object, face_budget: int) -> float:
    """The tolerance found for these objects, which the scene has then."""
    addon.select(*objects)
    before = everything_in_the_file()
    assert bpy.ops.ccdepth.find_tolerance(face_budget=face_budget) == {"FINISHED"}
    assert everything_in_the_file() == before
    settings = bpy.context.scene.ccdepth
    return settings.relative_tolerance if settings.tolerance_mode == "RELATIVE" else settings.tolerance


def made_with(tolerance: float, *objects: bpy.types.Object) -> int:
    """How many faces the results of these objects have together."""
    for each in objects:
        each.hide_set(False)
    mode = bpy.context.scene.ccdepth.tolerance_mode
    made = subdivide(*objects, tolerance=tolerance, tolerance_mode=mode)
    return sum(faces(each) for each in made)


@pytest.mark.parametrize(
    ("number", "digits", "rounded"), [(0.07, 3, 0.07), (0.07001, 3, 0.0701), (9.99e-5, 2, 1e-4), (12345.0, 2, 13000.0)]
)
def test_tolerances_are_rounded_up_to_few_digits(number: float, digits: int, rounded: float) -> None:
    assert addon.module("tasks.adaptive_task").with_digits(number, digits) == rounded


@pytest.mark.parametrize(("mode", "start"), combinations(["RELATIVE", "ABSOLUTE"], [1e-5, 1.0]))
def test_it_fits_and_a_finer_one_does_not(mode: str, start: float) -> None:
    """Whatever the tolerance was before."""
    set_scene(tolerance_mode=mode, tolerance=start, relative_tolerance=start)
    holder = add_hills()
    tolerance = find(holder, face_budget=800)
    counted = known_count(holder)
    assert counted.fitting is None
    assert counted.faces == made_with(tolerance, holder) <= 800
    assert made_with(tolerance / 1.1, holder) > 800


def test_faces_of_several_objects_count_together() -> None:
    objects = [scene.add_object(meshes.cube(), "Cube"), add_hills()]
    objects[1].scale = (5.0, 5.0, 5.0)
    tolerance = find(*objects, face_budget=1500)
    assert 1250 < made_with(tolerance, *objects) <= 1500


def test_settings_are_counted_in() -> None:
    holder = add_hills()
    set_scene(mode="PER_FACE", transitions="NGONS")
    tolerance = find(holder, face_budget=600)
    assert made_with(tolerance, holder) <= 600
    assert made_with(tolerance / 1.1, holder) > 600


def test_for_a_result_it_is_found_for_its_update() -> None:
    _, result = made_result()
    find(result, face_budget=1000)
    assert bpy.ops.ccdepth.update() == {"FINISHED"}
    assert 750 < faces(result) <= 1000


def test_a_flat_mesh_gets_the_least_tolerance_that_is_taken() -> None:
    """It is curved along its boundary alone."""
    holder = scene.add_object(meshes.landscape(2, 2))
    for vertex in holder.data.vertices:
        vertex.co.z = 0.0
    holder.data.update()
    tolerance = find(holder, face_budget=10_000)
    assert tolerance < 1e-4
    assert made_with(tolerance, holder) <= 10_000


def test_too_few_faces_are_refused() -> None:
    holder = scene.add_suzanne()
    addon.select(holder)
    before = bpy.context.scene.ccdepth.relative_tolerance
    with pytest.raises(RuntimeError, match="Even undivided there would be more than 100 faces"):
        bpy.ops.ccdepth.find_tolerance(face_budget=100)
    with pytest.raises(RuntimeError, match="The Face Limit is 500; raise it first"):
        bpy.ops.ccdepth.find_tolerance(face_budget=1000, max_faces=500)
    assert bpy.context.scene.ccdepth.relative_tolerance == before


def test_edit_mode_stays() -> None:
    holder = add_hills()
    with addon.edit_mode(holder):
        assert bpy.ops.ccdepth.find_tolerance(face_budget=1000) == {"FINISHED"}
        assert holder.mode == "EDIT"
