# SPDX-License-Identifier: GPL-3.0-or-later
"""What moves by itself: a result that no longer holds at another frame is shown as out of date, by the panel and by
operators alike, and holds again where it was computed."""

from __future__ import annotations

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.subdividing import known_count
from tests.blender.test_staleness import mesh_line

pytestmark = pytest.mark.every_blender

FIRST, LATER = 1, 11


@pytest.fixture(autouse=True)
def few_levels() -> None:
    """So coarse that Set Levels has nothing else to refuse."""
    bpy.context.scene.ccdepth.relative_tolerance = 0.2


def told_by_the_panel(holder: bpy.types.Object) -> str:
    """Once the timer has run, without anything that would have Blender pass on its updates."""
    examine = addon.module("state.watch").examine
    if bpy.app.timers.is_registered(examine):
        examine()
    return addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, holder.data, holder)


def expect(holder: bpy.types.Object, line: str) -> None:
    """The panel and Set Levels agree."""
    assert told_by_the_panel(holder) == line
    addon.select(holder)
    if line:
        with pytest.raises(RuntimeError, match="out of date"):
            bpy.ops.ccdepth.set_levels()
    else:
        assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    assert told_by_the_panel(holder) == line


def key(owner: bpy.types.bpy_struct, name: str, first: object, later: object) -> None:
    for frame, value in ((FIRST, first), (LATER, later)):
        setattr(owner, name, value)
        owner.keyframe_insert(name, frame=frame)


def with_a_key() -> tuple[bpy.types.Object, bpy.types.ShapeKey]:
    holder = scene.add_suzanne()
    holder.shape_key_add(name="Basis")
    shape = holder.shape_key_add(name="Key")
    shape.data[0].co.x += 1.0
    return holder, shape


def moving_objects() -> dict[str, bpy.types.Object]:
    """Objects that are shaped or scaled otherwise at the later frame."""
    holders = {name: scene.add_suzanne() for name in ("keyed modifier", "wave", "scale", "child", "posed")}
    holders["keyed shape"], shape = with_a_key()
    key(shape, "value", 0.0, 1.0)
    holders["driven shape"], shape = with_a_key()
    shape.driver_add("value").driver.expression = "frame / 20"
    key(holders["keyed modifier"].modifiers.new("Cast", "CAST"), "factor", 0.0, 1.0)
    # It moves without keys.
    holders["wave"].modifiers.new("Wave", "WAVE")
    holders["child"].parent = scene.add("Parent")
    for scaled in (holders["scale"], holders["child"].parent):
        key(scaled, "scale", (1.0, 1.0, 1.0), (2.0, 1.0, 1.0))
    rig = scene.add_rig()
    holders["posed"].vertex_groups.new(name="Bone").add(range(100), 1.0, "REPLACE")
    holders["posed"].modifiers.new("Armature", "ARMATURE").object = rig
    key(rig.pose.bones["Bone"], "location", (0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    return holders


def test_results_follow_the_frame() -> None:
    """They are out of date at a later frame, and current at the first."""
    holders = moving_objects()
    bpy.context.scene.frame_set(FIRST)
    for holder in holders.values():
        addon.compute(holder)
        expect(holder, "")
    for frame, has_changed in ((LATER, True), (FIRST, False)):
        bpy.context.scene.frame_set(frame)
        assert {name: told_by_the_panel(holder) for name, holder in holders.items()} == {
            name: mesh_line(holder) if has_changed else "" for name, holder in holders.items()
        }
        for holder in holders.values():
            expect(holder, mesh_line(holder) if has_changed else "")
    parent = holders["child"].parent
    parent.animation_data_clear()
    parent.scale.z = 3.0
    bpy.context.view_layer.update()
    expect(holders["child"], mesh_line(holders["child"]))


def test_what_does_not_move_stays_current() -> None:
    holder = scene.add_suzanne()
    key(holder, "location", (0.0, 0.0, 0.0), (2.0, 1.0, 1.0))
    addon.compute(holder)
    bpy.context.scene.frame_set(LATER)
    expect(holder, "")


def test_a_count_of_faces_is_forgotten() -> None:
    holder, shape = with_a_key()
    key(shape, "value", 0.0, 1.0)
    bpy.context.scene.frame_set(FIRST)
    addon.select(holder)
    bpy.ops.ccdepth.count_faces()
    assert known_count(holder) is not None
    bpy.context.scene.frame_set(LATER)
    assert known_count(holder) is None


def test_what_cannot_be_examined_does_not_pass_for_current(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)

    def failing(*_: object, **__: object) -> None:
        raise LookupError("odd")

    monkeypatch.setattr(addon.module("state.still_holds"), "object_state", failing)
    holder.scale.x = 2.0
    bpy.context.view_layer.update()
    expect(holder, mesh_line(holder))
    assert "LookupError: odd" in capfd.readouterr().err


def test_an_object_that_the_result_was_not_computed_for() -> None:
    """It shares the mesh, so it shows the depths; but they were computed at another scale."""
    holder = scene.add_suzanne()
    other = scene.add_mesh(holder.data)
    other.scale = (2.0, 2.0, 2.0)
    addon.compute(holder)
    bpy.context.view_layer.update()
    assert told_by_the_panel(holder) == ""
    assert told_by_the_panel(other) == "Not computed for this object"
    addon.select(other)
    with pytest.raises(RuntimeError, match="out of date"):
        bpy.ops.ccdepth.set_levels()
    addon.compute(holder, other)
    bpy.context.view_layer.update()
    assert told_by_the_panel(other) == ""


def test_a_change_while_depths_are_being_computed_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The record has what was read at the beginning, not what is there at the end."""
    holder = scene.add_object(meshes.landscape(8, 8))
    module = addon.module("operators.compute_depth")
    write = module.mesh_values.write_depths

    def change(*given: object) -> None:
        holder.scale.x = 2.0
        holder.data.vertices[0].co.z += 0.5
        bpy.context.view_layer.update()
        write(*given)

    monkeypatch.setattr(module.mesh_values, "write_depths", change)
    addon.compute(holder)
    assert told_by_the_panel(holder).startswith("Out of date: mesh")
