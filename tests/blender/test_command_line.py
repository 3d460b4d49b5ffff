# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, called as Blender calls it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.command_line_runs import run

SUZANNE_FACES = 500


def depths_in(path: Path) -> dict[str, list[int]]:
    """The depths on the meshes of a .blend file, by object."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    meshes = [holder for holder in bpy.data.objects if holder.type == "MESH"]
    return {holder.name: addon.depths(holder).tolist() for holder in meshes if "ccdepth" in holder.data.attributes}


def write_mesh_file(path: Path) -> None:
    """Suzanne alone, in a file of the path's format."""
    scene.clear()
    addon.select(scene.add_suzanne())
    if path.suffix == ".blend":
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    else:
        getattr(bpy.ops.wm, f"{path.suffix[1:]}_export")(filepath=str(path))


def test_without_a_mesh_it_measures_suzanne(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("--output", tmp_path / "suzanne.blend") == 0
    printed = capfd.readouterr().out
    written = depths_in(tmp_path / "suzanne.blend")["Suzanne"]
    assert len(written) == SUZANNE_FACES
    for depth, count in zip(*np.unique(written, return_counts=True), strict=True):
        assert f"{depth:>8}{count:>14,}" in printed


def test_the_depths_are_those_of_the_operator(tmp_path: Path) -> None:
    assert run("--tolerance", "0.01", "--absolute", "--vertices", "limit", "--output", tmp_path / "out.blend") == 0
    written = depths_in(tmp_path / "out.blend")["Suzanne"]
    scene.clear()
    suzanne = scene.add_suzanne()
    addon.compute(suzanne, tolerance=0.01, vertices="LIMIT")
    assert written == addon.depths(suzanne).tolist()


def test_a_level_that_is_not_known_is_no_level() -> None:
    """Records of earlier versions do not have it."""
    holder = scene.add_object(meshes.cube())
    addon.compute(holder)
    table = addon.module("command_line.report_text").depth_table
    assert f"at level {holder.data.ccdepth.uniform_level}: " in table(holder.data.ccdepth)
    holder.data.ccdepth.property_unset("uniform_level")
    assert "not known" in table(holder.data.ccdepth)
    assert "-1" not in table(holder.data.ccdepth)


@pytest.mark.parametrize("suffix", [".blend", ".obj", ".ply", ".stl"])
def test_every_format_can_be_read(tmp_path: Path, suffix: str) -> None:
    mesh = tmp_path / f"mesh{suffix}"
    write_mesh_file(mesh)
    assert run(mesh, "--output", tmp_path / "out.blend") == 0
    [depths] = depths_in(tmp_path / "out.blend").values()
    # An STL file holds triangles alone.
    assert len(depths) == (SUZANNE_FACES if suffix != ".stl" else 968)


def test_the_mesh_file_itself_stays_as_it_is(tmp_path: Path) -> None:
    mesh = tmp_path / "mesh.blend"
    write_mesh_file(mesh)
    before = mesh.read_bytes()
    assert run(mesh) == 0
    assert mesh.read_bytes() == before


def test_all_visible_meshes_of_a_file_are_measured(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for index, name in enumerate(("Shown", "Unselectable", "Hidden")):
        holder = scene.add_suzanne()
        holder.name = name
        holder.hide_select = index == 1
        holder.hide_set(index == 2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mesh.blend"), copy=True)
    assert run(tmp_path / "mesh.blend", "--output", tmp_path / "out.blend") == 0
    assert "Left out because it is hidden: Hidden" in capfd.readouterr().out
    assert set(depths_in(tmp_path / "out.blend")) == {"Shown", "Unselectable"}


def test_a_file_saved_in_edit_mode_is_measured(tmp_path: Path) -> None:
    with addon.edit_mode(scene.add_suzanne()):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mesh.blend"), copy=True)
    assert run(tmp_path / "mesh.blend", "--output", tmp_path / "out.blend") == 0
    assert len(depths_in(tmp_path / "out.blend")["Suzanne"]) == SUZANNE_FACES


def test_the_settings_of_a_file_are_used_unless_others_are_given(tmp_path: Path) -> None:
    scene.add_suzanne()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.vertices = "ABSOLUTE", 0.125, "LIMIT"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mesh.blend"), copy=True)
    assert run(tmp_path / "mesh.blend", "--vertices", "control", "--output", tmp_path / "out.blend") == 0
    assert depths_in(tmp_path / "out.blend")
    settings, record = bpy.context.scene.ccdepth, bpy.data.objects["Suzanne"].data.ccdepth
    for holder in (settings, record):
        assert (holder.tolerance, holder.tolerance_mode, holder.vertices) == (0.125, "ABSOLUTE", "CONTROL")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tolerance", "0"], "The tolerance must be greater than zero"),
        (["--tolerance", "-1"], "The tolerance must be greater than zero"),
        (["--tolerance", "nan"], "The tolerance is not a finite number"),
        (["--tolerance", "inf"], "The tolerance is not a finite number"),
        (["--tolerance", "1e39"], "The tolerance is too large a number"),
        (["--tolerance", "1e-12"], "single-precision"),
        (["nowhere.obj"], "there is no such file"),
        (["--objects", "Cube"], "ccdepth: Suzanne: there is no mesh object “Cube” in it"),
        (["--collection", "Some"], "ccdepth: Suzanne: there is no collection “Some” in it"),
        (["mesh.xyz"], "not a .blend, .obj, .ply, .stl,"),
        (["--picture", "picture.jpg"], "its name must end in .png"),
        (["--picture", "nowhere/picture.png"], "there is no folder"),
    ],
)
def test_what_cannot_be_done_is_said_and_nothing_is_written(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert run(*arguments, "--output", tmp_path / "out.blend") == 1
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".blend", ".obj", ".ply", ".stl"])
def test_a_file_that_holds_no_mesh_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str) -> None:
    (tmp_path / f"broken{suffix}").write_text("this is no mesh\n")
    assert run(tmp_path / f"broken{suffix}") == 1
    assert "ccdepth: " in capfd.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ["--tolerance", "fine"],
        ["--method", "guess"],
        ["--unknown"],
        ["--max-faces", "99999999999999"],
        ["--max-faces", "0"],
        ["--max-faces", "-5"],
        ["--max-faces", "many"],
        ["--tolerance", "1 cubit"],
        ["--tolerance", "0.1mm", "--relative"],
        ["--tolerance", "0.1%", "--absolute"],
        ["--tolerance", "0.1", "--faces", "50k"],
        ["--faces", "none"],
        ["--faces", "0"],
        ["--unit", "cubit"],
        ["--jobs", "0"],
        ["--jobs", "1.5"],
        ["--measure", "--accuracy", "nan"],
        ["--measure", "--accuracy", "0"],
        ["--measure", "--time-limit=-1"],
        ["--measure", "--time-limit", "1e400"],
        ["--levels", "--subdivide"],
        ["--subdivide", "--output", "mesh.xyz"],
        ["--output", "mesh.stl"],
        ["--measure", "--output-folder", ".", "--format", "stl"],
        ["--subdivide", "--measure"],
        ["--measure", "--picture", "out.png"],
        ["--format", "stl"],
        ["--output", "out.blend", "--output-folder", "."],
        ["one.obj", "two.obj", "--output", "out.blend"],
        ["one.obj", "two.obj", "--picture", "out.png"],
        ["one.obj", "folder/one.ply", "--output-folder", "."],
        ["--json", "-", "--csv", "-"],
        ["--json", "same", "--csv", "same", "--overwrite"],
        ["--subdivide", "--output", "same.stl", "--json", "same.stl", "--overwrite"],
        ["mesh.obj", "--json", "mesh.obj", "--overwrite"],
        ["mesh.png", "--picture", "mesh.png", "--overwrite"],
        ["mesh.obj", "--verify", "report.json"],
        # What would be taken no notice of.
        ["--verify", "report.json", "--tolerance", "1mm"],
        ["--verify", "report.json", "--levels"],
        ["--verify", "report.json", "--overwrite"],
        # Another way to the same place.
        ["mesh.obj", "--json", "./nowhere/../mesh.obj", "--overwrite"],
        ["--json", "same", "--csv", "./nowhere/../same", "--overwrite"],
        # The materials of an .obj file go there.
        ["--subdivide", "--output", "same.obj", "--json", "same.mtl", "--overwrite"],
        ["--objects", "Cube", "mesh.blend"],
    ],
)
def test_a_line_that_makes_no_sense_is_refused(capfd: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert run(*arguments) == 2
    assert "usage: ccdepth" in capfd.readouterr().err


def test_a_report_does_not_follow_a_link_to_a_file_that_is_read(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mesh, link = tmp_path / "mesh.obj", tmp_path / "report.json"
    mesh.write_text("precious")
    try:
        link.symlink_to(mesh)
    except OSError:
        pytest.skip("no links can be made here")
    for line in ([mesh, "--json", link], [link, "--csv", mesh]):
        assert run(*line, "--overwrite") == 2
        assert "mesh.obj is read, and would be replaced" in capfd.readouterr().err
    assert mesh.read_text() == "precious"


def test_help_is_no_failure(capfd: pytest.CaptureFixture[str]) -> None:
    assert run("--help") == 0
    assert "--tolerance" in capfd.readouterr().out


@pytest.mark.parametrize("in_place", [False, True])
def test_it_subdivides_adaptively(tmp_path: Path, capfd: pytest.CaptureFixture[str], in_place: bool) -> None:
    line = ["--subdivide", "--tolerance", "0.01", "--absolute", "--mode", "per-face", "--transitions", "ngons"]
    assert run(*line, *(["--in-place"] if in_place else []), "--output", tmp_path / "out.blend") == 0
    printed = capfd.readouterr().out
    [(name, written)] = depths_in(tmp_path / "out.blend").items()
    assert name == ("Suzanne" if in_place else "Suzanne Adaptive")
    assert bpy.data.objects[name].visible_get()
    assert len([holder for holder in bpy.data.objects if holder.visible_get()]) == 1
    assert f"{name}: {len(written):,} faces made from {SUZANNE_FACES}" in printed
    scene.clear()
    addon.select(scene.add_suzanne())
    bpy.ops.ccdepth.subdivide(tolerance=0.01, tolerance_mode="ABSOLUTE", mode="PER_FACE", transitions="NGONS")
    [result] = bpy.context.selected_objects
    assert written == addon.depths(result).tolist()


def test_proved_distances_are_rounded_up(capfd: pytest.CaptureFixture[str]) -> None:
    """The first six tolerances of a row, of whose distances some would be rounded down."""
    for number in range(6):
        assert run("--subdivide", "--absolute", "--tolerance", 0.03 + 0.001 * number) == 0
        [printed] = re.findall(r"largest distance proved: (\S+);", capfd.readouterr().out)
        [result] = [each for each in bpy.data.objects if each.name == "Suzanne Adaptive"]
        record = result.data.ccdepth
        assert record.largest_bound <= float(printed) <= record.largest_bound * 1.001 + 1e-9


@pytest.mark.parametrize("in_place", [False, True])
def test_a_picture_of_adaptive_meshes_shows_their_distances(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], in_place: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(addon.module("command_line.picture"), "SAMPLES", 1)
    path = tmp_path / "picture.png"
    line = ["--subdivide", "--tolerance", "0.01", *(["--in-place"] if in_place else []), "--picture", path]
    assert run(*line) == 0
    assert f"Written: {path}" in capfd.readouterr().out
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--max-faces", "1000"], "1,000 are allowed"),
        (["--tolerance", "nan"], "The tolerance is not a finite number"),
    ],
)
def test_what_cannot_be_subdivided_is_said_and_nothing_is_written(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert run("--subdivide", *arguments, "--output", tmp_path / "out.blend") == 1
    assert message in capfd.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not bpy.app.binary_path, reason="needs Blender's own program")
@pytest.mark.parametrize(("arguments", "status"), [([], 0), (["--tolerance", "0"], 1), (["--unknown"], 2)])
def test_blender_passes_the_exit_status_on(arguments: list[str], status: int) -> None:
    command = [bpy.app.binary_path, "-b", "--command", "ccdepth", *arguments]
    assert subprocess.run(command, timeout=120, capture_output=True).returncode == status


def test_names_cannot_command_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Names of objects, shown and hidden, of modifiers and of files."""
    for name, hidden in (("Red\x1b[31m\u202e", False), ("Bell\x07\x9b2J", True)):
        holder = scene.add_suzanne()
        holder.name = name
        holder.hide_set(hidden)
        holder.modifiers.new("Cloth\x1b]0;title\x07", "CLOTH")
    mesh = tmp_path / "mesh\x1b[2J.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(mesh), copy=True)
    capfd.readouterr()
    assert run(mesh, "--no-modifiers", "--output", tmp_path / "out\x1b[1m.blend") == 0
    assert run(mesh) == 1
    assert run(mesh, "--output", tmp_path / "nowhere\x1b" / "out.blend") == 1
    printed = capfd.readouterr()
    # Blender itself prints which files it reads and writes.
    own = [
        line
        for line in (printed.out + printed.err).splitlines()
        if "Read blend: " not in line and "Info: Saved" not in line
    ]
    text = "\n".join(own)
    assert not [line for line in own if any(mark in line for mark in "\x1b\x07\x9b\u202e")]
    assert "Red\\x1b[31m\\u202e" in text
    assert "Bell\\x07\\x9b2J" in text
    assert "Cloth\\x1b]0;title\\x07" in text


@pytest.mark.parametrize("tolerance", [float("inf"), 1e39])
def test_the_operator_refuses_what_blender_takes_for_infinity(tolerance: float) -> None:
    addon.select(scene.add_suzanne())
    with pytest.raises(RuntimeError, match=r"not a finite number|too large"):
        bpy.ops.ccdepth.compute(tolerance=tolerance, tolerance_mode="ABSOLUTE")
