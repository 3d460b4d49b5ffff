# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertices as the objects' own modifiers have them, and files and scripts that name them."""

import json
import re
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


@pytest.mark.parametrize("asked", ["object", "limit"])
def test_reports_say_which_vertices_each_object_has(
    asked: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Levels set in the file leave them to each object unless they are named."""
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
