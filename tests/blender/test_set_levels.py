# SPDX-License-Identifier: GPL-3.0-or-later
"""Set Subdivision Levels: the modifier gets the deepest depth, and the vertices that were measured."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

TOLERANCE = 0.05


@pytest.fixture(autouse=True)
def few_levels() -> None:
    """Blender makes what is set here, so it must not be much."""
    bpy.context.scene.ccdepth.method = "CERTIFIED"


def levels(holder: bpy.types.Object) -> list[tuple[int, int, bool]]:
    return [
        (modifier.levels, modifier.render_levels, modifier.use_limit_surface)
        for modifier in holder.modifiers
        if modifier.type == "SUBSURF"
    ]


@pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])
@pytest.mark.parametrize("present", [False, True])
def test_the_modifier_gets_the_deepest_depth(vertices: str, present: bool) -> None:
    holder = scene.add_suzanne()
    if present:
        scene.add_subdivision(holder, 1, boundary="PRESERVE_CORNERS").use_limit_surface = vertices == "CONTROL"
    addon.compute(holder, tolerance=TOLERANCE, vertices=vertices)
    deepest = int(addon.depths(holder).max())
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert levels(holder) == [(deepest, deepest, vertices == "LIMIT")]
    if present:
        assert holder.modifiers[0].boundary_smooth == "PRESERVE_CORNERS"
    bpy.context.view_layer.update()
    addon.module("staleness").check_touched()
    assert not addon.module("staleness").is_stale(holder.data)


@pytest.mark.parametrize("use_modifiers", [False, True])
def test_a_new_modifier_stands_where_the_surface_was_measured(use_modifiers: bool) -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    holder.modifiers.new("Mirror", "MIRROR")
    addon.compute(holder, tolerance=TOLERANCE, use_modifiers=use_modifiers)
    bpy.ops.ccdepth.set_levels()
    kinds = [modifier.type for modifier in holder.modifiers]
    assert kinds == (["MIRROR", "SUBSURF"] if use_modifiers else ["SUBSURF", "MIRROR"])


def test_faces_that_modifiers_add_count() -> None:
    holder, other = scene.add_object(meshes.cube()), scene.add_suzanne()
    other.location = (0.5, 0.5, 0.5)
    other.scale = (4.0, 4.0, 4.0)
    boolean = holder.modifiers.new("Boolean", "BOOLEAN")
    boolean.object, boolean.operation = other, "UNION"
    addon.compute(holder, tolerance=TOLERANCE)
    record = holder.data.ccdepth
    assert record.added_deepest > 0
    record.added_deepest = record.deepest + 1
    bpy.ops.ccdepth.set_levels()
    assert levels(holder)[0][0] == record.deepest + 1


def test_several_objects_and_edit_mode() -> None:
    first, second = scene.add_suzanne(), scene.add_object(meshes.creased_cube())
    addon.compute(first, second, tolerance=TOLERANCE)
    wanted = [int(addon.depths(holder).max()) for holder in (first, second)]
    with addon.edit_mode(first, second):
        assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert [levels(holder)[0][0] for holder in (first, second)] == wanted


def not_computed(_holder: bpy.types.Object) -> None:
    bpy.ops.ccdepth.clear()


def changed(holder: bpy.types.Object) -> None:
    holder.data.vertices[0].co.x += 1.0
    holder.data.update()


def made_larger(holder: bpy.types.Object) -> None:
    holder.scale.x = 2.0
    bpy.context.view_layer.update()


def too_deep(holder: bpy.types.Object) -> None:
    holder.data.ccdepth.deepest = 12


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (not_computed, "it has no depths"),
        (changed, "its depths are out of date"),
        (made_larger, "its depths are out of date"),
        (too_deep, "it needs 12 levels, and a Subdivision Surface modifier has 11 at most"),
    ],
)
def test_what_cannot_be_set_is_refused(spoil: Callable[[bpy.types.Object], None], message: str) -> None:
    good, bad = scene.add_object(meshes.cube(), "Good"), scene.add_suzanne()
    addon.compute(good, bad, tolerance=TOLERANCE)
    addon.select(bad)
    spoil(bad)
    addon.select(good, bad)
    with pytest.raises(RuntimeError, match=f"Suzanne: {message}"):
        bpy.ops.ccdepth.set_levels()
    assert not good.modifiers
    assert not bad.modifiers


def test_levels_that_make_too_many_faces_are_refused() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder, tolerance=TOLERANCE)
    bpy.context.scene.ccdepth.max_faces = 1000
    with pytest.raises(RuntimeError, match="faces, and the Face Limit is 1,000"):
        bpy.ops.ccdepth.set_levels()
    assert not holder.modifiers


def test_a_duplicate_that_was_not_measured_is_refused() -> None:
    holder = scene.add_suzanne()
    addon.compute(holder, tolerance=TOLERANCE)
    large = scene.add_mesh(holder.data)
    large.scale = (3.0, 3.0, 3.0)
    addon.select(large)
    with pytest.raises(RuntimeError, match="its depths are out of date"):
        bpy.ops.ccdepth.set_levels()
    addon.select(holder)
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}


def test_a_subdivision_has_no_levels_to_set() -> None:
    addon.select(scene.add_suzanne())
    assert not bpy.ops.ccdepth.set_levels.poll()
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE)
    assert not bpy.ops.ccdepth.set_levels.poll()
