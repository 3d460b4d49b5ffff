# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices as the objects' own modifiers have them, and files and scripts that name them.

A file of 308a89a opens with all it holds: depths, adaptive objects, measurements, and what is kept updated.
"""

import json
import re
import shutil
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import bpy
import numpy as np
import pytest

from ccdepth_addon.core import VERTICES
from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import few_samples, mesh_objects, run, save
from tests.blender.test_staleness import SETTINGS_LINE, mesh_line
from tests.blender.updating import move_vertex, set_scene, stale_line, update

pytestmark = pytest.mark.every_blender

# What is in it, and how it was made, is told beside it.
OLD_FILE = Path(__file__).with_name("saved_by_308a89a") / "depths.blend"
OLD_METHODS = ("CERTIFIED", "SHARP", "SECOND_ORDER", "FIRST_ORDER")


@pytest.fixture(autouse=True)
def settings() -> bpy.types.PropertyGroup:
    """A tolerance at which control and limit vertices need other depths of a cube and of Suzanne."""
    found = bpy.context.scene.ccdepth
    found.method, found.tolerance_mode, found.tolerance = "CERTIFIED", "ABSOLUTE", 0.02
    return found


def with_modifier(holder: bpy.types.Object, vertices: str | None) -> bpy.types.Object:
    """The object with a Subdivision Surface modifier that shows these vertices; for None without."""
    if vertices is not None:
        scene.add_subdivision(holder, 1).use_limit_surface = vertices == "LIMIT"
    return holder


def found(*holders: bpy.types.Object, **settings: object) -> tuple[list[int], list[float], int]:
    """What Compute Depth finds for objects of one mesh."""
    addon.compute(*holders, **settings)
    holder = holders[0]
    return addon.depths(holder).tolist(), addon.bounds(holder).tolist(), holder.data.ccdepth.uniform_level


@pytest.mark.parametrize(("own", "expected"), [(None, "LIMIT"), ("LIMIT", "LIMIT"), ("CONTROL", "CONTROL")])
def test_vertices_are_those_of_the_objects_own_modifier(own: str | None, expected: str) -> None:
    holder = scene.add_suzanne()
    of = {vertices: found(holder, vertices=vertices) for vertices in VERTICES}
    assert of["CONTROL"] != of["LIMIT"]
    with_modifier(holder, own)
    assert found(holder) == of[expected]
    record = holder.data.ccdepth
    assert (record.vertices, record.follows_objects) == (expected, True)
    bpy.ops.ccdepth.set_levels()
    assert [each.use_limit_surface for each in holder.modifiers] == [expected == "LIMIT"]
    assert stale_line(holder) == ""


def test_objects_of_one_mesh_keep_their_own_vertices() -> None:
    """Each face has the deepest depth for any of them, and Set Subdivision Levels leaves the vertices of each."""
    control = with_modifier(scene.add_suzanne(), "CONTROL")
    limit = with_modifier(scene.add_mesh(control.data), "LIMIT")
    of = {vertices: found(control, limit, vertices=vertices)[0] for vertices in VERTICES}
    np.testing.assert_array_equal(found(control, limit)[0], np.maximum(of["CONTROL"], of["LIMIT"]))
    assert (control.data.ccdepth.vertices, addon.facts(control)["Vertices"]) == ("OBJECT", "From Modifier")
    bpy.ops.ccdepth.set_levels()
    assert [each.modifiers[0].use_limit_surface for each in (control, limit)] == [False, True]
    assert stale_line(control) == stale_line(limit) == ""


def test_frames_have_the_vertices_of_each() -> None:
    """Use Limit Surface can be animated: on for the first frame, and off from the second on."""
    holder = with_modifier(scene.add_suzanne(), "LIMIT")
    modifier = holder.modifiers[0]
    of = {vertices: found(holder, vertices=vertices)[0] for vertices in VERTICES}
    scene.animate(modifier, "use_limit_surface", {1: True, 2: False})
    bpy.context.scene.frame_set(1)
    depths, *_ = found(holder, frames="CUSTOM", frame_list="1,2")
    np.testing.assert_array_equal(depths, np.maximum(of["CONTROL"], of["LIMIT"]))
    assert holder.data.ccdepth.vertices == "OBJECT"
    bpy.context.scene.ccdepth.frames, bpy.context.scene.ccdepth.frame_list = "CUSTOM", "1,2"
    for frame in (1, 2):
        bpy.context.scene.frame_set(frame)
        assert stale_line(holder) == ""


def test_use_limit_surface_of_the_modifier_matters_to_what_follows_it_alone() -> None:
    holder = with_modifier(scene.add_object(meshes.cube()), "CONTROL")
    [modifier] = holder.modifiers
    addon.compute(holder)
    modifier.use_limit_surface = True
    assert stale_line(holder) == mesh_line(holder)
    with pytest.raises(RuntimeError, match="out of date"):
        bpy.ops.ccdepth.set_levels()
    modifier.use_limit_surface = False
    assert stale_line(holder) == ""
    addon.compute(holder, vertices="CONTROL")
    modifier.use_limit_surface = True
    assert stale_line(holder) == ""
    bpy.ops.ccdepth.set_levels()
    assert not modifier.use_limit_surface
    addon.compute(holder)
    bpy.ops.ccdepth.subdivide(output="IN_PLACE")
    assert not holder.data.ccdepth.follows_objects


@pytest.mark.parametrize("computed", ["OBJECT", "CONTROL", "LIMIT"])
def test_only_a_setting_of_other_vertices_makes_depths_stale(computed: str, settings: bpy.types.PropertyGroup) -> None:
    """Of an object without a modifier, which has vertices on the limit surface."""
    holder = scene.add_object(meshes.cube())
    settings.vertices = computed
    addon.compute(holder)
    for now in ("OBJECT", "CONTROL", "LIMIT"):
        settings.vertices = now
        is_other = now != "OBJECT" and now != ("CONTROL" if computed == "CONTROL" else "LIMIT")
        assert stale_line(holder) == (SETTINGS_LINE if is_other else ""), now


def test_another_method_makes_nothing_out_of_date_and_the_panel_names_it(settings: bpy.types.PropertyGroup) -> None:
    holder, other = scene.add_object(meshes.cube()), scene.add_object(meshes.cube())
    addon.compute(other, vertices="CONTROL")
    addon.compute(holder, method="SHARP")
    settings.method = "DISTANCE"
    assert stale_line(holder) == ""
    assert (addon.facts(holder)["Method"], addon.facts(holder)["Vertices"]) == ("Sharp", "Limit Surface")
    ways = addon.module("ui.facts").ways([holder.data.ccdepth, other.data.ccdepth])
    assert [each.value for each in ways] == ["Sharp, Certified", "Limit Surface, Control Mesh"]


def test_a_file_of_308a89a_keeps_its_methods_and_vertices(tmp_path: Path) -> None:
    """Those that it names, in settings and results. Where the settings were never touched, none were stored: they are
    the defaults of today, and the result keeps what it was computed with."""
    copy = shutil.copy(OLD_FILE, tmp_path)
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    named = {f"{method} {vertices}": (method, vertices) for method, vertices in product(OLD_METHODS, VERTICES)}
    for name, (method, vertices) in {**named, "Untouched": ("CERTIFIED", "CONTROL")}.items():
        bpy.context.window.scene = bpy.data.scenes[name]
        settings, holder = bpy.context.scene.ccdepth, bpy.data.objects[name]
        record = holder.data.ccdepth
        if name == "Untouched":
            assert not settings.is_property_set("method")
            assert not settings.is_property_set("vertices")
            assert (settings.method, settings.vertices) == ("DISTANCE", "OBJECT")
        else:
            assert (settings.method, settings.vertices) == (method, vertices)
        assert (record.method, record.vertices, record.follows_objects) == (method, vertices, False)
        assert stale_line(holder) == ""
        # Blender makes what is set.
        record.uniform_level, record.uniform_faces, record.quality = 1, "24", 0
        addon.finish("set_levels", holder)
        assert holder.modifiers[0].use_limit_surface == (vertices == "LIMIT")
        depths = addon.depths(holder)
        bpy.ops.ccdepth.compute()
        assert record.method == settings.method
        if name != "Untouched":
            np.testing.assert_array_equal(addon.depths(holder), depths)


@pytest.mark.parametrize("asked", ["object", "limit"])
def test_reports_say_which_vertices_each_object_has(
    asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Levels set in the file leave them to each object unless they are named. A report in which settings alone name
    them, as those of earlier versions, is checked as well."""
    few_samples(monkeypatch)
    expected = {}
    for own in (None, *VERTICES):
        name = with_modifier(scene.add_object(meshes.cube()), own).name
        expected[name] = "LIMIT" if asked == "limit" else own or "LIMIT"
    report, page, output = tmp_path / "report.json", tmp_path / "report.html", tmp_path / "out.blend"
    line = ["--levels", "--tolerance", "0.02", "--absolute", "--output", output, "--json", report, "--html", page]
    source = save(tmp_path / "cubes.blend")
    assert run(source, *line, "--vertices", asked) == 0
    entries = json.loads(report.read_text(encoding="utf-8"))["files"][0]["objects"]
    assert {each["name"]: each["vertices"] for each in entries} == expected
    assert {each["settings"]["vertices"] for each in entries} == {"LIMIT" if asked == "limit" else "OBJECT"}
    texts = re.findall(r"<dt>Vertices</dt><dd>([^<]*)", page.read_text(encoding="utf-8"))
    words = {"LIMIT": "Limit Surface", "CONTROL": "Control Mesh"}
    assert sorted(texts) == sorted(words[each] for each in expected.values())
    assert run("--verify", report) == 0
    shown = {name: each.modifiers[0].use_limit_surface for name, each in mesh_objects(output).items()}
    assert shown == {name: vertices == "LIMIT" for name, vertices in expected.items()}
    content = json.loads(report.read_text(encoding="utf-8"))
    for each in content["files"][0]["objects"]:
        del each["vertices"]
    report.write_text(json.dumps(content), encoding="utf-8")
    assert run("--verify", report) == (0 if asked == "limit" else 1)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[dict[str, bpy.types.Object]]:
    """The objects of the file, opened from a copy, by name."""
    bpy.ops.wm.open_mainfile(filepath=str(shutil.copy(OLD_FILE.with_name("results.blend"), tmp_path)))
    yield dict(bpy.data.objects)
    bpy.ops.wm.read_homefile(use_empty=True)


def measured_line(holder: bpy.types.Object) -> str:
    stale_line(holder)
    return addon.module("ui.deviation_panel").stale_line(bpy.context.scene.ccdepth, holder.data)


def test_depths_are_there_and_hold(opened: dict[str, bpy.types.Object]) -> None:
    settings = bpy.context.scene.ccdepth
    assert (settings.method, settings.vertices, settings.tolerance_mode) == ("CERTIFIED", "CONTROL", "ABSOLUTE")
    small, large, moving = (opened[name] for name in ("Small", "Large", "Moving"))
    record = small.data.ccdepth
    assert (record.faces, record.method, record.vertices, record.deepest) == (6, "CERTIFIED", "CONTROL", 3)
    assert addon.depths(small).tolist() == [3] * 6
    assert (addon.bounds(small) <= record.world_tolerance).all()
    assert stale_line(small) == stale_line(large) == ""
    assert (moving.data.ccdepth.frames, moving.data.ccdepth.worst_frame) == ("1-3", 3)
    set_scene(frames="CUSTOM", frame_list="1-3")
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        assert stale_line(moving) == ""
    large.scale.x = 4.0
    assert stale_line(small) != ""


def test_adaptive_objects_are_there_with_their_sources_and_settings(opened: dict[str, bpy.types.Object]) -> None:
    kept, reduced, in_place = (opened[name] for name in ("Kept Adaptive", "Reduced Adaptive", "In Place"))
    assert (kept.ccdepth.source, kept.ccdepth.keep_updated) == (opened["Kept"], True)
    assert not opened["Kept"].visible_get()
    assert stale_line(kept) == ""
    assert (reduced.ccdepth.reduce, reduced.ccdepth.exact_normals) == (True, True)
    assert reduced.data.ccdepth.unreduced_triangles > len(reduced.data.polygons)
    assert stale_line(reduced) == SETTINGS_LINE
    assert (in_place.data.ccdepth.subdivision, in_place.ccdepth.source) == ("PER_FACE", None)
    for each in (kept, reduced, in_place):
        record = each.data.ccdepth
        assert record.base_faces == 6
        assert addon.bounds(each).max() == np.float32(record.largest_bound) <= record.world_tolerance
    move_vertex(opened["Kept"].data)
    assert stale_line(kept) == "Out of date: “Kept” changed"
    before = len(kept.data.polygons)
    update(kept)
    assert stale_line(kept) == ""
    assert len(kept.data.polygons) != before or kept.data.ccdepth.largest_bound > 0


def test_measurements_are_there_and_hold(opened: dict[str, bpy.types.Object]) -> None:
    own, kept = opened["Own"], opened["Kept Adaptive"]
    for holder, against in ((own, "Own"), (kept, "Kept")):
        record = holder.data.ccdepth
        assert (record.measurement.measured, record.measurement.against) == (holder.name, against)
        assert addon.deviations(holder).max() <= np.float32(record.deviation)
        assert 0 < record.deviation_reached <= record.deviation
        assert measured_line(holder) == ""
    assert kept.data.ccdepth.measurement.verdict == "MET"
    move_vertex(own.data)
    move_vertex(opened["Kept"].data)
    assert measured_line(own) != ""
    assert measured_line(kept) != ""
