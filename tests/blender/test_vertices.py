# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices as the objects' own modifiers have them, and files and scripts that name them."""

from __future__ import annotations

import json
import re
import shutil
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
from tests.blender.updating import stale_line

pytestmark = pytest.mark.every_blender

# ``make.py`` beside it says how it was made.
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


def found(holder: bpy.types.Object) -> tuple[list[int], list[float], int]:
    """What Compute Depth found."""
    return addon.depths(holder).tolist(), addon.bounds(holder).tolist(), holder.data.ccdepth.uniform_level


@pytest.mark.parametrize(("own", "expected"), [(None, "LIMIT"), ("LIMIT", "LIMIT"), ("CONTROL", "CONTROL")])
def test_vertices_are_those_of_the_objects_own_modifier(own: str | None, expected: str) -> None:
    holder = scene.add_suzanne()
    of = {}
    for vertices in VERTICES:
        addon.compute(holder, vertices=vertices)
        of[vertices] = found(holder)
    assert of["CONTROL"] != of["LIMIT"]
    with_modifier(holder, own)
    addon.compute(holder)
    record = holder.data.ccdepth
    assert found(holder) == of[expected]
    assert (record.vertices, record.follows_objects) == (expected, True)
    bpy.ops.ccdepth.set_levels()
    assert [each.use_limit_surface for each in holder.modifiers] == [expected == "LIMIT"]
    assert stale_line(holder) == ""


def test_the_modifier_is_the_one_whose_surface_is_used() -> None:
    """The first Catmull-Clark one that shows in the viewport; where none shows, the first."""
    holder = with_modifier(with_modifier(scene.add_object(meshes.cube()), "LIMIT"), "CONTROL")
    shown_vertices = addon.module("exchange.modifiers").shown_vertices
    first, second = holder.modifiers
    for visible, expected in (((True, True), "LIMIT"), ((False, True), "CONTROL"), ((False, False), "LIMIT")):
        first.show_viewport, second.show_viewport = visible
        assert shown_vertices(holder, "OBJECT") == expected
        assert [shown_vertices(holder, named) for named in VERTICES] == list(VERTICES)
    first.subdivision_type = "SIMPLE"
    assert shown_vertices(holder, "OBJECT") == "CONTROL"


def test_objects_of_one_mesh_keep_their_own_vertices() -> None:
    """Each face has the deepest depth for any of them, and Set Subdivision Levels leaves the vertices of each."""
    control = with_modifier(scene.add_suzanne(), "CONTROL")
    limit = with_modifier(scene.add_mesh(control.data), "LIMIT")
    of = {}
    for vertices in VERTICES:
        addon.compute(control, limit, vertices=vertices)
        of[vertices] = addon.depths(control)
    addon.compute(control, limit)
    np.testing.assert_array_equal(addon.depths(control), np.maximum(of["CONTROL"], of["LIMIT"]))
    assert (control.data.ccdepth.vertices, addon.facts(control)["Vertices"]) == ("OBJECT", "From Modifier")
    bpy.ops.ccdepth.set_levels()
    assert [each.modifiers[0].use_limit_surface for each in (control, limit)] == [False, True]
    assert stale_line(control) == stale_line(limit) == ""


def test_frames_have_the_vertices_of_each() -> None:
    """Use Limit Surface can be animated: on for the first frame, and off from the second on."""
    holder = with_modifier(scene.add_suzanne(), "LIMIT")
    modifier = holder.modifiers[0]
    of = {}
    for vertices in VERTICES:
        addon.compute(holder, vertices=vertices)
        of[vertices] = addon.depths(holder)
    for frame, is_on in ((1, True), (2, False)):
        modifier.use_limit_surface = is_on
        modifier.keyframe_insert("use_limit_surface", frame=frame)
    bpy.context.scene.frame_set(1)
    addon.compute(holder, frames="CUSTOM", frame_list="1,2")
    np.testing.assert_array_equal(addon.depths(holder), np.maximum(of["CONTROL"], of["LIMIT"]))
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
def test_only_a_setting_that_names_other_vertices_makes_depths_out_of_date(
    computed: str, settings: bpy.types.PropertyGroup
) -> None:
    """Of an object without a modifier, which has vertices on the limit surface."""
    holder = scene.add_object(meshes.cube())
    settings.vertices = computed
    addon.compute(holder)
    for now in ("OBJECT", "CONTROL", "LIMIT"):
        settings.vertices = now
        is_other = now != "OBJECT" and now != ("CONTROL" if computed == "CONTROL" else "LIMIT")
        assert stale_line(holder) == (SETTINGS_LINE if is_other else ""), now


def test_another_method_makes_nothing_out_of_date_and_the_panel_names_the_one(
    settings: bpy.types.PropertyGroup,
) -> None:
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
        addon.select(holder)
        bpy.ops.ccdepth.set_levels()
        assert holder.modifiers[0].use_limit_surface == (vertices == "LIMIT")
        depths = addon.depths(holder)
        bpy.ops.ccdepth.compute()
        assert record.method == settings.method
        if name != "Untouched":
            np.testing.assert_array_equal(addon.depths(holder), depths)


@pytest.mark.parametrize("asked", ["object", "limit"])
def test_reports_say_which_vertices_were_used_for_each_object(
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
    assert sorted(texts) == sorted(
        {"LIMIT": "Limit Surface", "CONTROL": "Control Mesh"}[each] for each in expected.values()
    )
    assert run("--verify", report) == 0
    shown = {name: each.modifiers[0].use_limit_surface for name, each in mesh_objects(output).items()}
    assert shown == {name: vertices == "LIMIT" for name, vertices in expected.items()}
    content = json.loads(report.read_text(encoding="utf-8"))
    for each in content["files"][0]["objects"]:
        del each["vertices"]
    report.write_text(json.dumps(content), encoding="utf-8")
    assert run("--verify", report) == (0 if asked == "limit" else 1)
