# SPDX-License-Identifier: GPL-3.0-or-later
"""The tolerance in the sidebar: in full, and what it is in the other mode."""

from __future__ import annotations

import math

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

SIZE = 2 * math.sqrt(3)


def about(value: float) -> object:
    """What is compared with this: settings are in single precision."""
    return pytest.approx(value, rel=1e-5)


@pytest.fixture
def cube() -> bpy.types.Object:
    holder = scene.add_object(meshes.cube())
    for vertex in holder.data.vertices:
        vertex.co = [math.copysign(1.0, each) for each in vertex.co]
    addon.select(holder)
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.relative_tolerance, settings.tolerance = "RELATIVE", 0.001, 0.5
    return holder


def text() -> str:
    """What the sidebar says once everything it asks for is measured; nothing is measured while it is drawn."""
    tolerance_text = addon.module("ui.tolerance_text").tolerance_text
    tolerance_text(bpy.context)
    addon.module("state.diagonals").measure_wanted()
    return str(tolerance_text(bpy.context))


def add(name: str, data: bpy.types.ID) -> bpy.types.Object:
    holder = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(holder)
    return holder


def test_switching_in_the_sidebar_carries_the_distance_over_and_back(cube: bpy.types.Object) -> None:
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode = "ABSOLUTE"
    assert (settings.tolerance, settings.relative_tolerance) == (0.5, about(0.001)), "scripts change the mode alone"
    settings.tolerance_mode = "RELATIVE"
    cube.scale = (3.0, 3.0, 3.0)
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance_mode == "ABSOLUTE"
    assert settings.tolerance == about(0.003 * SIZE)
    settings.shown_tolerance_mode = "RELATIVE"
    assert settings.tolerance_mode == "RELATIVE"
    assert settings.relative_tolerance == about(0.001)


def test_modifiers_that_are_counted_in_are_carried_over_too(cube: bpy.types.Object) -> None:
    """Only what was computed is told, as modifiers may take long."""
    array = cube.modifiers.new("Array", "ARRAY")
    array.count, array.use_relative_offset, array.use_constant_offset = 2, False, True
    array.constant_offset_displace = (2.0, 0.0, 0.0)
    assert text() == ""
    assert bpy.ops.ccdepth.compute() == {"FINISHED"}
    bpy.context.view_layer.update()
    assert text() == "= 0.0049 m"
    bpy.context.scene.ccdepth.shown_tolerance_mode = "ABSOLUTE"
    assert bpy.context.scene.ccdepth.tolerance == about(0.001 * math.sqrt(16 + 4 + 4))


@pytest.mark.parametrize("name", ["Light", "Empty mesh", None])
def test_where_there_is_no_size_the_mode_alone_is_switched(cube: bpy.types.Object, name: str | None) -> None:
    settings = bpy.context.scene.ccdepth
    data = {"Light": lambda: bpy.data.lights.new("Light", "POINT"), "Empty mesh": lambda: bpy.data.meshes.new("Empty")}
    addon.select(*([] if name is None else [add(name, data[name]())]))
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", 0.5)
    assert text() == ""


def test_the_other_one_is_told_for_the_active_object_as_it_is(cube: bpy.types.Object) -> None:
    assert addon.module("ui.tolerance_text").tolerance_text(bpy.context) == "", "nothing is measured while drawing"
    assert text() == "= 0.00346 m"
    # What is edited is measured when Edit Mode is left.
    with addon.edit_mode(cube):
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.transform.resize(value=(2.0, 2.0, 2.0))
        assert text() == "= 0.00346 m"
    bpy.context.view_layer.update()
    assert text() == "= 0.00693 m"
    cube.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    assert text() == "= 0.0139 m"
    bpy.context.scene.ccdepth.tolerance_mode = "ABSOLUTE"
    assert text() == "= 0.0361 of the size"


def test_with_no_mesh_active_it_is_told_for_the_selected_meshes(cube: bpy.types.Object) -> None:
    other = scene.add_object(meshes.cube(), "Other")
    other.scale = tuple(3.0 * each / size for each, size in zip(cube.dimensions, other.dimensions, strict=True))
    light, settings = add("Light", bpy.data.lights.new("Light", "POINT")), bpy.context.scene.ccdepth
    for active in (light, None):
        addon.select(cube, light)
        bpy.context.view_layer.objects.active = active
        assert text() == "= 0.00346 m"
        addon.select(cube, other, light)
        bpy.context.view_layer.objects.active = active
        assert text() == "= 0.00346–0.0104 m"
        settings.tolerance_mode = "ABSOLUTE"
        assert text() == "= 0.0481–0.144 of the size"
        settings.tolerance_mode = "RELATIVE"
    # Of several meshes no distance is carried over, of one it is.
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance == 0.5
    settings.tolerance_mode = "RELATIVE"
    other.select_set(False)
    settings.shown_tolerance_mode = "ABSOLUTE"
    assert settings.tolerance == about(0.001 * SIZE)
    # Of very many it is not told.
    addon.select(*[scene.add_mesh(cube.data) for _ in range(20)])
    bpy.context.view_layer.objects.active = None
    assert text() == ""


def test_on_a_result_its_source_counts(cube: bpy.types.Object) -> None:
    assert bpy.ops.ccdepth.subdivide() == {"FINISHED"}
    assert bpy.context.active_object != cube
    assert text() == "= 0.00346 m"
    bpy.context.scene.ccdepth.shown_tolerance_mode = "ABSOLUTE"
    assert bpy.context.scene.ccdepth.tolerance == about(0.001 * SIZE)


def test_a_fraction_with_too_many_digits_for_its_field_is_told_in_full(cube: bpy.types.Object) -> None:
    for tolerance, begins in ((2e-6, "="), (2.5e-6, "2.5e-06 ="), (8.9e-7, "8.9e-07 ="), (0.001, "=")):
        bpy.context.scene.ccdepth.relative_tolerance = tolerance
        assert text().startswith(begins)
