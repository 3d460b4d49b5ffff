# SPDX-License-Identifier: GPL-3.0-or-later
"""What moves by itself: a result that no longer holds at another frame is shown as out of date, by the panel and by
operators alike, and holds again where it was computed."""

from __future__ import annotations

from contextlib import ExitStack

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.test_staleness import MESH_LINE

FIRST, LATER = 1, 11


@pytest.fixture(autouse=True)
def few_levels() -> None:
    """So coarse that Set Levels has nothing else to refuse."""
    bpy.context.scene.ccdepth.relative_tolerance = 0.2


def told_by_the_panel(holder: bpy.types.Object) -> str:
    """Once the timer has run, without anything that would have Blender pass on its updates."""
    staleness = addon.module("state.staleness")
    if bpy.app.timers.is_registered(staleness.check_touched):
        staleness.check_touched()
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


def expect_to_follow_the_frame(holder: bpy.types.Object) -> None:
    """Out of date at a later frame, and current at the first."""
    bpy.context.scene.frame_set(FIRST)
    addon.compute(holder)
    expect(holder, "")
    bpy.context.scene.frame_set(LATER)
    expect(holder, MESH_LINE)
    bpy.context.scene.frame_set(FIRST)
    expect(holder, "")


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


def test_a_shape_key() -> None:
    holder, shape = with_a_key()
    key(shape, "value", 0.0, 1.0)
    expect_to_follow_the_frame(holder)


def test_a_driven_shape_key() -> None:
    holder, shape = with_a_key()
    shape.driver_add("value").driver.expression = "frame / 20"
    expect_to_follow_the_frame(holder)


def test_a_modifier() -> None:
    holder = scene.add_suzanne()
    key(holder.modifiers.new("Cast", "CAST"), "factor", 0.0, 1.0)
    expect_to_follow_the_frame(holder)


def test_a_modifier_that_moves_without_keys() -> None:
    holder = scene.add_suzanne()
    holder.modifiers.new("Wave", "WAVE")
    expect_to_follow_the_frame(holder)


def test_a_scale() -> None:
    holder = scene.add_suzanne()
    key(holder, "scale", (1.0, 1.0, 1.0), (2.0, 1.0, 1.0))
    expect_to_follow_the_frame(holder)


def test_a_parent() -> None:
    holder, parent = scene.add_suzanne(), bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    holder.parent = parent
    key(parent, "scale", (1.0, 1.0, 1.0), (2.0, 1.0, 1.0))
    expect_to_follow_the_frame(holder)
    parent.animation_data_clear()
    parent.scale.z = 3.0
    bpy.context.view_layer.update()
    expect(holder, MESH_LINE)


def test_a_pose() -> None:
    rig = bpy.data.objects.new("Rig", bpy.data.armatures.new("Rig"))
    bpy.context.scene.collection.objects.link(rig)
    with addon.edit_mode(rig):
        rig.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    holder = scene.add_suzanne()
    holder.vertex_groups.new(name="Bone").add(range(100), 1.0, "REPLACE")
    holder.modifiers.new("Armature", "ARMATURE").object = rig
    key(rig.pose.bones["Bone"], "location", (0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    expect_to_follow_the_frame(holder)


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
    counts = addon.module("state.face_counts")
    assert counts._known
    bpy.context.scene.frame_set(LATER)
    assert not counts._known


def test_what_cannot_be_examined_does_not_pass_for_current(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)

    def failing(*_: object, **__: object) -> None:
        raise LookupError("odd")

    monkeypatch.setattr(addon.module("state.fingerprint"), "object_state", failing)
    holder.scale.x = 2.0
    bpy.context.view_layer.update()
    expect(holder, MESH_LINE)
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


def test_a_change_while_depths_are_being_computed_is_noticed() -> None:
    """The record has what was read at the beginning, not what is there at the end."""
    holder = scene.add_object(meshes.landscape(8, 8))
    bpy.context.view_layer.update()
    computation = addon.module("tasks.depth_task")
    settings = computation.DepthSettings(0.01, "ABSOLUTE", True, "SECOND_ORDER", "CONTROL")
    run = addon.module("tasks.stepwise").Stepwise(computation.prepare_depths(bpy.context, [holder], settings))
    run.work()
    work = run.answer
    holder.scale.x = 2.0
    holder.data.vertices[0].co.z += 0.5
    bpy.context.view_layer.update()
    answers = computation.compute_depths(work)
    [mesh] = addon.module("operators.compute_depth")._meshes_still_there(answers)
    [answer] = answers
    results = addon.module("state.results")
    with ExitStack() as undo:
        results.write_depths(mesh, answer, (0, 8), undo)
        undo.pop_all()
    results.write_record(mesh, answer, settings, (0, 8))
    addon.module("state.fingerprint").remember(mesh, answer.task.geometry, answer.depths, answer.task.states)
    addon.module("state.staleness").touch(mesh)
    assert told_by_the_panel(holder).startswith("Out of date: mesh")
