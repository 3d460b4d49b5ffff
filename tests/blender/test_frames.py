# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths over frames, against results of single frames; and results of one frame at another."""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import Capture, few_samples, mesh_objects, run, save
from tests.blender.subdividing import known_count, refuses
from tests.blender.test_report import report_in, reported
from tests.blender.test_staleness import SETTINGS_LINE, mesh_line
from tests.blender.updating import move_vertex, set_scene
from tests.thorough import combinations

FIRST, LAST = 1, 11
FRAMES = f"{FIRST}-{LAST}"
TOLERANCE = 0.004


@pytest.fixture(autouse=True)
def certified_and_coarse() -> None:
    bpy.context.scene.ccdepth.method = "CERTIFIED"
    # So coarse that Set Levels has nothing else to refuse.
    bpy.context.scene.ccdepth.relative_tolerance = 0.2
    bpy.context.scene.frame_set(FIRST)


def key(owner: bpy.types.bpy_struct, name: str, first: object, later: object) -> None:
    scene.animate(owner, name, {FIRST: first, LAST: later})


def told_by_the_panel(holder: bpy.types.Object) -> str:
    """Once the timer has run, without anything that would have Blender pass on its updates."""
    examine = addon.module("state.watch").examine
    if bpy.app.timers.is_registered(examine):
        examine()
    return addon.module("ui.panels").stale_line(bpy.context.scene.ccdepth, holder.data, holder)


def ring() -> bpy.types.Object:
    """All its faces have regular patches."""
    return scene.add_object(meshes.torus(8, 6))


def with_a_shape_key(plain: bpy.types.Object | None = None) -> bpy.types.Object:
    """The object with a key that counts most on frame 8; without one, a ring."""
    holder = plain or ring()
    shape = scene.add_key(holder)
    for vertex in shape.data:
        vertex.co.z += 0.15 * np.sin(9 * vertex.co.x)
    scene.animate(shape, "value", {FIRST: 0.0, 8: 1.0, LAST: 0.3})
    return holder


def with_an_armature() -> bpy.types.Object:
    rig, holder = scene.add_rig(), ring()
    group = holder.vertex_groups.new(name="Bone")
    for vertex in holder.data.vertices:
        group.add([vertex.index], min(max(0.5 + vertex.co.z, 0.0), 1.0), "REPLACE")
    holder.modifiers.new("Armature", "ARMATURE").object = rig
    pose = rig.pose.bones["Bone"]
    pose.rotation_mode = "XYZ"
    scene.animate(pose, "rotation_euler", {FIRST: (0.0, 0.0, 0.0), 8: (1.2, 0.0, 0.0), LAST: (0.5, 0.0, 0.0)})
    return holder


def with_a_growing_scale() -> bpy.types.Object:
    holder = ring()
    key(holder, "scale", (1.0, 1.0, 1.0), (2.0, 1.0, 1.5))
    key(holder, "rotation_euler", (0.0, 0.0, 0.0), (1.0, 2.0, 0.5))
    return holder


def with_an_animated_array() -> bpy.types.Object:
    holder = scene.add_object(meshes.landscape(3, 2))
    key(holder.modifiers.new("Array", "ARRAY"), "count", 1, 3)
    key(holder.modifiers.new("Cast", "CAST"), "factor", 0.0, 0.8)
    return holder


def with_growing_creases() -> bpy.types.Object:
    """Of all edges, whose vertices stay where they are."""
    holder = scene.add_object(meshes.landscape(3, 2))
    tree = holder.modifiers.new("Nodes", "NODES").node_group = scene.node_tree("GeometryNodeStoreNamedAttribute")
    store = tree.nodes["Store Named Attribute"]
    store.data_type, store.domain, store.inputs["Name"].default_value = "FLOAT", "EDGE", "crease_edge"
    share, time = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("GeometryNodeInputSceneTime")
    share.operation, share.inputs[1].default_value = "DIVIDE", 2.0 * LAST
    tree.links.new(time.outputs["Frame"], share.inputs[0])
    tree.links.new(share.outputs[0], next(each for each in store.inputs if each.name == "Value" and each.enabled))
    return holder


ANIMATED: dict[str, Callable[[], bpy.types.Object]] = {
    "shape key": with_a_shape_key,
    "armature": with_an_armature,
    "scale": with_a_growing_scale,
    "array": with_an_animated_array,
    "creases": with_growing_creases,
}


def compute(*holders: bpy.types.Object, frames: str = FRAMES, **settings: object) -> None:
    addon.compute(*holders, **{"tolerance": TOLERANCE, "frames": "CUSTOM", "frame_list": frames, **settings})


def single_frames(holder: bpy.types.Object, **settings: object) -> dict[int, tuple[np.ndarray, np.ndarray, int]]:
    """The depths and bounds of each frame alone, and the level that is enough for all faces."""
    found = {}
    for frame in range(FIRST, LAST + 1):
        bpy.context.scene.frame_set(frame)
        addon.compute(holder, **{"tolerance": TOLERANCE, **settings})
        found[frame] = addon.depths(holder), addon.bounds(holder), holder.data.ccdepth.uniform_level
    bpy.context.scene.frame_set(FIRST)
    return found


@pytest.mark.every_blender
@pytest.mark.parametrize(("name", "vertices"), combinations(ANIMATED, ["CONTROL", "LIMIT"]))
def test_each_face_has_the_deepest_depth_of_the_frames(name: str, vertices: str) -> None:
    holder = ANIMATED[name]()
    alone = single_frames(holder, vertices=vertices)
    bpy.context.scene.frame_set(5)
    compute(holder, vertices=vertices)
    deepest = np.max([depths for depths, *_ in alone.values()], axis=0)
    np.testing.assert_array_equal(addon.depths(holder), deepest)
    # What is proved at that depth on frames that have it is not exceeded; bounds are rounded up to single precision,
    # and of the same face proved in two ways the one may be a little below the other.
    bounds = addon.bounds(holder)
    assert np.all((bounds > 0) & (bounds <= np.float32(TOLERANCE) * (1 + 1e-6)))
    record = holder.data.ccdepth
    assert record.frames == FRAMES
    assert record.deepest == deepest.max()
    assert record.faces == len(holder.data.polygons)
    # A level may be enough on one frame and not on another that needs a lesser one, so that they may need one more.
    least = max(level for *_, level in alone.values())
    assert least <= record.uniform_level <= least + 1
    # The array has most copies on the last frame, and all its faces are quads.
    copies = 3 if name == "array" else 1
    assert int(record.uniform_faces) == copies * record.faces * 4**record.uniform_level
    assert alone[record.deepest_frame][0].max() == deepest.max()
    assert bpy.context.scene.frame_current == 5
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    modifier = holder.modifiers[-1]
    assert (modifier.levels, modifier.use_limit_surface) == (record.uniform_level, vertices == "LIMIT")


def test_frames_are_named_and_listed() -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    typed = addon.module("tasks.frames").typed_frames
    for frames, numbers in (
        ("3", (3,)),
        ("1-9/4", (1, 5, 9)),
        (" 9, 1 ,5 ", (1, 5, 9)),
        ("-3--1,7", (-3, -2, -1, 7)),
        ("1-9/4, 2,5", (1, 2, 5, 9)),
        # Frames that several parts name count once: these are not too many.
        ("1-60000,1-60000,7", tuple(range(1, 60_001))),
    ):
        assert typed(frames) == numbers
        if len(numbers) > 10:
            continue
        compute(holder, frames=frames)
        assert holder.data.ccdepth.frames == frames.replace(" ", "")
        assert holder.data.ccdepth.deepest_frame in numbers


NO_FRAMES = ("", ",", "1-", "9-1", "1-5/0", "a", "1.5", "1-5/2/2", "1-2000000", "-1048575", "1048575", "1-100001")


@pytest.mark.parametrize("frames", [*NO_FRAMES, "1-60000,70001-120000"])
def test_what_are_no_frames_is_refused(frames: str) -> None:
    holder = scene.add_object(meshes.landscape(4, 4))
    bpy.context.scene.frame_set(4)
    with pytest.raises(RuntimeError, match="frames"):
        compute(holder, frames=frames)
    assert not holder.data.ccdepth.has_result
    assert bpy.context.scene.frame_current == 4


def test_a_relative_tolerance_is_a_part_of_the_diagonal_on_each_frame() -> None:
    """A scale alone changes nothing then."""
    holder = ring()
    key(holder, "scale", (1.0, 1.0, 1.0), (3.0, 3.0, 3.0))
    compute(holder, tolerance=0.001, tolerance_mode="RELATIVE")
    over_frames, smallest = addon.depths(holder), holder.data.ccdepth.world_tolerance
    addon.compute(holder, tolerance=0.001, tolerance_mode="RELATIVE")
    np.testing.assert_array_equal(over_frames, addon.depths(holder))
    assert smallest == pytest.approx(holder.data.ccdepth.world_tolerance, rel=1e-6)
    # On the last frame all distances are three times as long, and so are the bounds over the frames.
    single = addon.bounds(holder)
    compute(holder, tolerance=0.001, tolerance_mode="RELATIVE")
    np.testing.assert_allclose(addon.bounds(holder), 3 * single, rtol=1e-5)


@pytest.mark.every_blender
def test_a_result_over_frames_stays_current_on_every_frame() -> None:
    holder = with_a_shape_key()
    bpy.context.scene.frame_set(3)
    set_scene(frames="CUSTOM", frame_list=FRAMES, relative_tolerance=0.01)
    addon.compute(holder)
    for frame in (3, FIRST, 7, LAST, LAST + 5):
        bpy.context.scene.frame_set(frame)
        assert told_by_the_panel(holder) == ""
    assert bpy.ops.ccdepth.set_levels() == {"FINISHED"}
    # Other frames are other settings.
    settings = bpy.context.scene.ccdepth
    settings.frame_list = "1-13"
    assert told_by_the_panel(holder) == SETTINGS_LINE
    settings.frames = "CURRENT"
    assert told_by_the_panel(holder) == SETTINGS_LINE
    bpy.context.scene.frame_set(FIRST)
    addon.compute(holder)
    assert (told_by_the_panel(holder), holder.data.ccdepth.frames) == ("", "")
    bpy.context.scene.frame_set(5)
    assert told_by_the_panel(holder) == mesh_line(holder)


CHANGES: dict[str, Callable[[bpy.types.Object], None]] = {
    "key": lambda holder: setattr(holder.data.shape_keys.key_blocks["Key"].data[0].co, "x", 9.0),
    "mesh": lambda holder: move_vertex(holder.data),
    "scale": lambda holder: setattr(holder.scale, "x", 2.0),
}


@pytest.mark.every_blender
@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("frame", [FIRST, 20])
def test_changes_make_it_out_of_date(change: str, frame: int) -> None:
    """On a computed frame, and on the one that was current, which need not be computed."""
    holder = with_a_shape_key()
    bpy.context.scene.frame_set(frame)
    set_scene(frames="CUSTOM", frame_list="1-12/3", relative_tolerance=0.01)
    addon.compute(holder)
    assert told_by_the_panel(holder) == ""
    CHANGES[change](holder)
    bpy.context.view_layer.update()
    assert told_by_the_panel(holder) == mesh_line(holder)


def test_the_frame_is_restored_when_it_is_cancelled() -> None:
    holder = with_a_shape_key()
    bpy.context.scene.frame_set(3, subframe=0.5)
    objects, task = set(bpy.data.objects), addon.module("tasks.depth_task")
    settings = task.DepthSettings(TOLERANCE, "ABSOLUTE", True, "CERTIFIED", "CONTROL", FRAMES)
    steps = task.prepare_depths(bpy.context, [holder], settings)
    assert [next(steps) for _ in range(6)] == [f"Frame {number} of {LAST}" for number in range(1, 7)]
    assert bpy.context.scene.frame_current == 5
    steps.close()
    assert (bpy.context.scene.frame_current, bpy.context.scene.frame_subframe) == (3, 0.5)
    assert set(bpy.data.objects) == objects


def test_a_mesh_that_is_swapped_on_a_frame_is_refused() -> None:
    holder, other = with_a_shape_key(), scene.add_suzanne()
    bystander = ring()
    meshes_before = [each.data for each in (holder, other)]

    def swap(changed: bpy.types.Scene, *_: object) -> None:
        holder.data = meshes_before[changed.frame_current > 5]

    bpy.app.handlers.frame_change_post.append(swap)
    bpy.context.scene.frame_set(2)
    with pytest.raises(RuntimeError, match=f"{holder.name}, on frame 6: its mesh changes over the frames"):
        compute(holder, bystander)
    bpy.app.handlers.frame_change_post.remove(swap)
    assert bpy.context.scene.frame_current == 2
    assert holder.data == meshes_before[0]
    assert not bystander.data.ccdepth.has_result


def test_a_frame_without_a_surface_is_named() -> None:
    holder = ring()
    key(holder, "scale", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    bpy.context.scene.frame_set(4)
    with pytest.raises(RuntimeError, match=rf"{holder.name}, on frame {LAST}: "):
        compute(holder, tolerance=0.001, tolerance_mode="RELATIVE", frames=f"{FIRST}-{LAST}")
    assert bpy.context.scene.frame_current == 4
    assert not holder.data.ccdepth.has_result


LINE = ("--tolerance", "0.004", "--absolute", "--method", "certified", "--vertices", "control")
SETTINGS = {"tolerance": 0.004, "method": "CERTIFIED", "vertices": "CONTROL"}


@pytest.fixture
def animated(tmp_path: Path) -> Path:
    """An animated cube that is deepest on frame 8, in a file that was saved at its first frame."""
    with_a_shape_key(scene.add_object(meshes.cube()))
    settings = bpy.context.scene
    settings.frame_start, settings.frame_end = 1, LAST
    settings.frame_set(1)
    return save(tmp_path / "animated.blend")


@pytest.mark.parametrize("frames", [f"1-{LAST}", "scene"])
def test_depths_over_frames_are_reported(
    animated: Path, tmp_path: Path, frames: str, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page's numbers and histogram are of the same frames. At the frame of the file the cube is less deep."""
    few_samples(monkeypatch)
    share_text = addon.module("ui.facts").share_text
    report, table, html = (tmp_path / f"report.{kind}" for kind in ("json", "csv", "html"))
    assert run(animated, *LINE, "--frames", frames, "--json", report, "--csv", table, "--html", html) == 0
    printed = capfd.readouterr().out
    [holder] = (each for each in bpy.data.objects if each.type == "MESH")
    addon.compute(holder, **SETTINGS, frames="SCENE")
    record = holder.data.ccdepth
    assert record.deepest == addon.depths(holder).max()
    deepest, frame = record.deepest, record.deepest_frame
    addon.compute(holder, **SETTINGS, frames="CUSTOM", frame_list=f"1-{frame - 1}")
    assert record.deepest < deepest
    [each] = report_in(report)["files"][0]["objects"]
    assert (each["deepest"], each["deepest_frame"]) == (deepest, frame)
    assert f"Deepest Depth: {deepest} at frame {frame}\n  Frames: 1-{LAST}\n" in printed
    assert each["settings"]["frames"] == ("SCENE" if frames == "scene" else "CUSTOM")
    [row] = csv.DictReader(table.open())
    assert (row["deepest"], row["deepest_frame"]) == (str(deepest), str(frame))
    addon.compute(holder, **SETTINGS, frames="SCENE")
    text = re.sub(r"<[^>]*>", "|", html.read_text(encoding="utf-8"))
    assert f"|At frame||{frame}|" in text
    for row in record.rows:
        assert f"|{row.depth}||||||{share_text(row.faces, record.faces)}|" in text
    assert run("--verify", report) == 0


def test_the_level_over_frames_is_set_in_the_file(animated: Path, tmp_path: Path) -> None:
    report, output = tmp_path / "report.json", tmp_path / "out.blend"
    content = reported(report, animated, "--levels", *LINE, "--output", output, "--frames", f"1-{LAST}")
    [each] = content["files"][0]["objects"]
    assert run("--verify", report) == 0
    [holder] = mesh_objects(output).values()
    assert holder.modifiers[-1].levels == each["level"] == holder.data.ccdepth.uniform_level
    assert bpy.context.scene.frame_current == 1
    over_frames = addon.depths(holder)
    assert bpy.context.scene.ccdepth.frames == "CUSTOM"
    addon.compute(holder, **SETTINGS, frames="CURRENT")
    assert np.all(addon.depths(holder) <= over_frames)
    assert np.any(addon.depths(holder) < over_frames)


@pytest.mark.every_blender
def test_a_render_leaves_a_count_of_faces() -> None:
    holder, render = scene.add_suzanne(), bpy.context.scene.render
    addon.finish("count_faces", holder)
    bpy.context.scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    render.engine, render.resolution_x, render.resolution_y = "CYCLES", 4, 4
    bpy.context.scene.cycles.samples, bpy.context.scene.cycles.use_denoising = 1, False
    bpy.ops.render.render()
    assert known_count(holder) is not None


@pytest.mark.every_blender
def test_what_cannot_be_examined_is_not_current(monkeypatch: pytest.MonkeyPatch, capfd: Capture) -> None:
    holder = scene.add_suzanne()
    addon.compute(holder)
    monkeypatch.setattr(addon.module("state.still_holds"), "object_state", Mock(side_effect=LookupError("odd")))
    holder.scale.x = 2.0
    bpy.context.view_layer.update()
    assert told_by_the_panel(holder) == mesh_line(holder)
    refuses("set_levels", "out of date", holder)
    assert "LookupError: odd" in capfd.readouterr().err
