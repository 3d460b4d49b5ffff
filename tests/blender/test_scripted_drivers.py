# SPDX-License-Identifier: GPL-3.0-or-later
"""Files with scripted drivers: one policy for a run, and no certificate of a shape that was not evaluated."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.command_line_runs import program, run, save

LINE = ("--relative", "--tolerance", "0.02", "--method", "second-order")
# Not a simple expression, so that Python has to run.
EXPRESSION = "__import__('pathlib').Path({!r}).touch() or 3.0"


@pytest.fixture(autouse=True)
def the_preference_of_the_user() -> Iterator[None]:
    paths = bpy.context.preferences.filepaths
    before = paths.use_scripts_auto_execute
    yield
    paths.use_scripts_auto_execute = before


def rig(path: Path, where: str = "shape key") -> Path:
    """A file with a cube whose shape a driver decides, which leaves a trace where it runs, and another cube."""
    scene.clear()
    cube, _other = scene.add_object(meshes.cube(), "Driven"), scene.add_object(meshes.cube(), "Plain")
    holder, name = bpy.context.scene.objects["Driven"], "location"
    if where == "shape key":
        cube.shape_key_add(name="Basis")
        holder, name = cube.shape_key_add(name="Key"), "value"
        holder.data[0].co.x -= 3.0
    elif where == "modifier":
        holder, name = cube.modifiers.new("Displace", "DISPLACE"), "strength"
    elif where == "parent":
        cube.parent = holder = scene.add("Parent")
        name = "scale"
    elif where == "another driver":
        other = scene.add("Other")
        driver = cube.driver_add("scale", 0).driver
        target = driver.variables.new()
        target.name, target.targets[0].id, target.targets[0].data_path = "moved", other, "location.x"
        driver.expression, holder = "moved + 1", other
    elif where == "node group":
        tree = scene.node_tree("GeometryNodeTransform")
        cube.modifiers.new("Nodes", "NODES").node_group = tree
        moving = next(node for node in tree.nodes if "Scale" in node.inputs)
        holder, name = moving.inputs["Scale"], "default_value"
    curves = holder.driver_add(name)
    for curve in curves if isinstance(curves, list) else [curves]:
        curve.driver.expression = EXPRESSION.format(str(path.with_suffix(".trace")))
    return save(path)


def reported(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))["files"][0]


@pytest.mark.every_blender
@pytest.mark.parametrize("preference", [False, True])
@pytest.mark.parametrize("where", ["shape key", "modifier", "parent", "another driver", "node group"])
def test_without_scripts_an_object_that_needs_them_fails_and_the_others_are_done(
    tmp_path: Path, where: str, preference: bool
) -> None:
    source = rig(tmp_path / "rig.blend", where)
    source.with_suffix(".trace").unlink(missing_ok=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = preference
    assert run(source, *LINE, "--subdivide", "--output", tmp_path / "o.stl", "--json", tmp_path / "r.json") == 1
    found = reported(tmp_path / "r.json")
    assert [each["name"] for each in found["objects"]] == ["Plain"]
    assert (found["met"], found["objects"][0]["met"]) == (False, True)
    assert "“Driven” depends on a driver that did not run" in found["error"]
    assert run("--verify", tmp_path / "r.json") == 1
    assert run(source, *LINE, "--objects", "Driven", "--json", tmp_path / "alone.json") == 1
    assert reported(tmp_path / "alone.json")["objects"] == []
    assert not source.with_suffix(".trace").exists(), "a script ran"
    assert bpy.context.preferences.filepaths.use_scripts_auto_execute is preference


@pytest.mark.every_blender
def test_scripts_run_where_blender_was_started_so_in_all_that_a_run_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    source = rig(tmp_path / "rig.blend")
    if bpy.app.binary_path:
        status = subprocess.run([program()[0], "-b", "-y", *program()[2:], *words(source, tmp_path)]).returncode
    else:
        # The bpy module has no options of Blender.
        monkeypatch.setattr(addon.module("command_line.mesh_files"), "scripts_allowed", lambda: True)
        monkeypatch.setattr(addon.module("command_line.scripted_drivers"), "scripts_allowed", lambda: True)
        status = run(*words(source, tmp_path))
    assert status == 0
    found = reported(tmp_path / "r.json")
    assert (found["error"], found["met"], len(found["objects"])) == (None, True, 2)
    assert source.with_suffix(".trace").exists()
    monkeypatch.undo()
    capfd.readouterr()
    assert run("--verify", tmp_path / "r.json") == 1
    assert "“Driven” depends on a driver that did not run" in capfd.readouterr().out


def words(source: Path, folder: Path) -> list[str]:
    line = (source, *LINE, "--subdivide", "--output", folder / "o.stl", "--json", folder / "r.json")
    return [str(word) for word in line]


def test_the_last_option_of_blenders_own_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    module = addon.module("command_line.scripted_drivers")
    monkeypatch.setattr(module.bpy, "app", type("App", (), {"binary_path": "blender"}))
    allowing = ("-y", "--enable-autoexec", "-Y -y", "-y --command ccdepth -Y")
    for options in (*allowing, "", "-y -b -Y", "--command ccdepth -y", "-- -y"):
        monkeypatch.setattr(sys, "argv", ["blender", *options.split()])
        assert module.scripts_allowed() is (options in allowing), options


def test_a_driver_of_a_material_decides_no_shape(tmp_path: Path) -> None:
    scene.clear()
    cube = scene.add_object(meshes.cube(), "Painted")
    cube.data.materials.append(bpy.data.materials.new("Paint"))
    curve = cube.data.materials[0].driver_add("roughness")
    curve.driver.expression = EXPRESSION.format(os.fspath(tmp_path / "trace"))
    assert run(save(tmp_path / "painted.blend"), *LINE) == 0
