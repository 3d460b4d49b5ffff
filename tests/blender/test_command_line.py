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
from tests.blender.runs import Capture, depths_in, few_samples, program, run, said, save

SUZANNE_FACES = 500

FORMATS = (".blend", ".obj", ".ply", ".stl")


def write_mesh_file(path: Path) -> None:
    """Suzanne alone, in a file of the path's format."""
    scene.clear()
    addon.select(scene.add_suzanne())
    if path.suffix == ".blend":
        save(path)
    else:
        getattr(bpy.ops.wm, f"{path.suffix[1:]}_export")(filepath=str(path))


def test_without_a_mesh_it_measures_suzanne_as_the_operator_does(tmp_path: Path, capfd: Capture) -> None:
    output = tmp_path / "suzanne.blend"
    sharp = {"tolerance": 0.01, "method": "SHARP", "vertices": "LIMIT"}
    for line, settings in (
        ("--method certified", {"method": "CERTIFIED"}),
        ("--tolerance 0.01 --absolute --method sharp --vertices limit", sharp),
    ):
        assert run(*line.split(), "--output", output, "--overwrite") == 0
        printed = capfd.readouterr().out
        [(name, written)] = depths_in(output).items()
        assert (name, len(written)) == ("Suzanne", SUZANNE_FACES)
        for depth, count in zip(*np.unique(written, return_counts=True), strict=True):
            assert f"{depth:>8}{count:>14,}" in printed
        scene.clear()
        suzanne = scene.add_suzanne()
        addon.compute(suzanne, **settings)
        assert written == addon.depths(suzanne).tolist()


def test_a_level_that_is_not_known_is_no_level() -> None:
    """Records of earlier versions do not have it."""
    holder = scene.add_object(meshes.cube())
    addon.compute(holder)
    assert f"Faces at Level {holder.data.ccdepth.uniform_level}" in addon.facts(holder)
    holder.data.ccdepth.property_unset("uniform_level")
    assert not [name for name in addon.facts(holder) if "Level" in name]


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_can_be_read_and_stays_as_it_is(tmp_path: Path, suffix: str) -> None:
    mesh = tmp_path / f"mesh{suffix}"
    write_mesh_file(mesh)
    before = mesh.read_bytes()
    assert run(mesh, "--method", "certified", "--output", tmp_path / "out.blend") == 0
    [depths] = depths_in(tmp_path / "out.blend").values()
    # An STL file holds triangles alone.
    assert len(depths) == (SUZANNE_FACES if suffix != ".stl" else 968)
    assert mesh.read_bytes() == before


@pytest.mark.every_blender
def test_a_file_saved_in_edit_mode_is_measured(tmp_path: Path) -> None:
    with addon.edit_mode(scene.add_suzanne()):
        save(tmp_path / "mesh.blend")
    assert run(tmp_path / "mesh.blend", "--output", tmp_path / "out.blend") == 0
    assert len(depths_in(tmp_path / "out.blend")["Suzanne"]) == SUZANNE_FACES


def test_the_settings_of_a_file_are_used_unless_others_are_given(tmp_path: Path) -> None:
    scene.add_suzanne()
    settings = bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.vertices = "ABSOLUTE", 0.125, "LIMIT"
    save(tmp_path / "mesh.blend")
    assert run(tmp_path / "mesh.blend", "--vertices", "control", "--output", tmp_path / "out.blend") == 0
    assert depths_in(tmp_path / "out.blend")
    settings, record = bpy.context.scene.ccdepth, bpy.data.objects["Suzanne"].data.ccdepth
    for holder in (settings, record):
        assert (holder.tolerance, holder.tolerance_mode, holder.vertices) == (0.125, "ABSOLUTE", "CONTROL")


IMPOSSIBLE = {
    "--tolerance 1e39": "The tolerance is too large a number",
    "--tolerance 1e-12": "single-precision",
    "nowhere.obj": "there is no such file",
    "--objects Cube": "ccdepth: Suzanne: there is no mesh object “Cube” in it",
    "--collection Some": "ccdepth: Suzanne: there is no collection “Some” in it",
    "mesh.xyz": "not a .blend, .obj, .ply, .stl,",
    "--picture picture.jpg": "its name must end in .png",
    "--picture nowhere/picture.png": "there is no folder",
    "--subdivide --max-faces 1000": "1,000 are allowed",
}


@pytest.mark.parametrize("line", IMPOSSIBLE)
def test_what_cannot_be_done_is_said_and_nothing_is_written(tmp_path: Path, capfd: Capture, line: str) -> None:
    assert IMPOSSIBLE[line] in said(capfd, *line.split(), "--output", tmp_path / "out.blend")
    assert not list(tmp_path.iterdir())


def test_a_file_that_holds_no_mesh_is_refused(tmp_path: Path, capfd: Capture) -> None:
    for suffix in FORMATS:
        (tmp_path / f"broken{suffix}").write_text("this is no mesh\n")
        assert "ccdepth: " in said(capfd, tmp_path / f"broken{suffix}")


# Lines that make no sense, with a part of what is said of each; an underscore stands for a space within a word.
WRONG_LINES = """
--tolerance fine | is not a tolerance
--tolerance 0 | “0” is not
--tolerance -1 | “-1” is not
--tolerance=-1mm | “-1mm” is not
--tolerance 0% | “0%” is not
--tolerance nan | a finite number greater than zero
--subdivide --tolerance inf | a finite number greater than zero
--method guess | invalid choice
--unknown | unrecognized arguments
--max-faces 99999999999999 | is not between 1 and
--max-faces 0 | is not between 1 and
--max-faces -5 | is not between 1 and
--max-faces many | invalid
--tolerance 1_cubit | is not a tolerance
--tolerance 0.1mm --relative | a tolerance of 0.1mm is not relative
--tolerance 0.1% --absolute | a tolerance of 0.1% is not absolute
--tolerance 0.1 --faces 50k | not allowed with argument
--faces none | is not a number of faces
--faces 0 | is not a number of faces
--unit cubit | invalid choice
--jobs 0 | is not a whole number of at least 1
--jobs 1.5 | is not a whole number of at least 1
--measure --accuracy nan | is not a number greater than zero
--measure --accuracy 0 | is not a number greater than zero
one.obj --file-timeout 0 | is not a number of seconds greater than zero
--file-timeout 5 | --file-timeout is for files
--measure --time-limit=-1 | is not a number of seconds
--measure --time-limit 1e400 | is not a number of seconds
--frames 1- | are no frames
--frames 9-1 | the first comes before the last
--frames 1-9 --subdivide | --frames is for depths and --levels
--frames 1-9 --measure | --frames is for depths and --levels
--levels --subdivide | cannot be used together
--subdivide --output mesh.xyz | its name must end in
--output mesh.stl | .stl files hold meshes that are made
--measure --output-folder . --format stl | .stl files hold meshes that are made
--subdivide --measure | --measure measures what was written
--measure --picture out.png | --measure makes none
--format stl | --format is for --output-folder
--output out.blend --output-folder . | cannot be used together
one.obj two.obj --output out.blend | are for a single file
one.obj two.obj --picture out.png | are for a single file
one.obj folder/one.ply --output-folder . | several files would be written to
--json - --csv - | only one report can go to the standard output
--json same --csv same --overwrite | several files would be written to
--subdivide --output same.stl --json same.stl --overwrite | several files would be written to
mesh.obj --json mesh.obj --overwrite | is read, and would be replaced
mesh.png --picture mesh.png --overwrite | is read, and would be replaced
mesh.obj --verify report.json | --verify takes a report and nothing else
--verify report.json --tolerance 1mm | --verify takes a report and nothing else
--verify report.json --levels | --verify takes a report and nothing else
--verify report.json --overwrite | --verify takes a report and nothing else
mesh.obj --json ./nowhere/../mesh.obj --overwrite | is read, and would be replaced
--json same --csv ./nowhere/../same --overwrite | several files would be written to
--subdivide --output same.obj --json same.mtl --overwrite | several files would be written to
--objects Cube mesh.blend | put the files before it
part.blend --gather . --json - | takes a folder of reports and nothing else
--gather . --json - --tolerance 1mm | takes a folder of reports and nothing else
--gather . --json - --jobs 2 | takes a folder of reports and nothing else
--gather . | --gather writes a report
--gather . --html - --pictures | --pictures is for --json
--html - --pictures | --pictures is for --json
"""


@pytest.mark.parametrize("case", WRONG_LINES.strip().splitlines())
def test_a_line_that_makes_no_sense_is_refused(capfd: Capture, case: str) -> None:
    line, _, message = case.partition(" | ")
    assert run(*(word.replace("_", " ") for word in line.split())) == 2
    printed = " ".join(capfd.readouterr().err.split())
    assert "usage: ccdepth" in printed
    assert message in printed


def test_a_report_does_not_replace_a_link_to_a_file_that_is_read(tmp_path: Path, capfd: Capture) -> None:
    mesh, link, way = tmp_path / "mesh.obj", tmp_path / "report.json", tmp_path / "way"
    mesh.write_text("precious")
    try:
        link.symlink_to(mesh)
        way.symlink_to(tmp_path, target_is_directory=True)
    except OSError:
        pytest.skip("no links can be made here")
    for name, line in (
        ("report.json", [link, "--json", link]),
        ("mesh.obj", [link, "--csv", mesh]),
        ("mesh.obj", [mesh, "--csv", way / mesh.name]),
    ):
        assert f"{name} is read, and would be replaced" in said(capfd, *line, "--overwrite", status=2)
    assert mesh.read_text() == "precious"


def test_help_is_no_failure(capfd: Capture) -> None:
    assert run("--help") == 0
    assert "--tolerance" in capfd.readouterr().out


@pytest.mark.every_blender
@pytest.mark.parametrize("in_place", [False, True])
def test_it_subdivides_adaptively(
    tmp_path: Path, capfd: Capture, in_place: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The picture shows the distances."""
    few_samples(monkeypatch)
    path = tmp_path / "picture.png"
    line = ["--subdivide", "--tolerance", "0.01", "--absolute", "--mode", "per-face", "--transitions", "ngons"]
    files = ["--picture", path, "--output", tmp_path / "out.blend"]
    assert run(*line, *(["--in-place"] if in_place else []), *files) == 0
    printed = capfd.readouterr().out
    assert f"Written: {path}" in printed
    assert path.read_bytes().startswith(b"\x89PNG")
    [(name, written)] = depths_in(tmp_path / "out.blend").items()
    assert name == ("Suzanne" if in_place else "Suzanne Adaptive")
    assert bpy.data.objects[name].visible_get()
    assert len([holder for holder in bpy.data.objects if holder.visible_get()]) == 1
    assert f"{name}\n  Faces: {len(written):,}\n  Control Faces: {SUZANNE_FACES}\n" in printed
    scene.clear()
    addon.select(scene.add_suzanne())
    bpy.ops.ccdepth.subdivide(tolerance=0.01, tolerance_mode="ABSOLUTE", mode="PER_FACE", transitions="NGONS")
    [result] = bpy.context.selected_objects
    assert written == addon.depths(result).tolist()


def test_proved_distances_are_rounded_up(capfd: Capture) -> None:
    """The first six tolerances of a row, of whose distances some would be rounded down."""
    for number in range(6):
        assert run("--subdivide", "--absolute", "--tolerance", 0.03 + 0.001 * number) == 0
        [printed] = re.findall(r"Largest Distance: (\S+) m", capfd.readouterr().out)
        record = bpy.data.objects["Suzanne Adaptive"].data.ccdepth
        assert record.largest_bound <= float(printed) <= record.largest_bound * 1.001 + 1e-9


@pytest.mark.every_blender
@pytest.mark.skipif(not bpy.app.binary_path, reason="needs Blender's own program")
@pytest.mark.parametrize(("arguments", "status"), [([], 0), (["--tolerance", "1e-12"], 1), (["--unknown"], 2)])
def test_blender_passes_the_exit_status_on(arguments: list[str], status: int) -> None:
    assert subprocess.run([*program(), *arguments], timeout=120, capture_output=True).returncode == status


def test_names_cannot_command_the_terminal(tmp_path: Path, capfd: Capture) -> None:
    """Names of objects, shown and hidden, of modifiers and of files."""
    for name, hidden in (("Red\x1b[31m\u202e", False), ("Bell\x07\x9b2J", True)):
        holder = scene.add_suzanne()
        holder.name = name
        holder.hide_set(hidden)
        holder.modifiers.new("Cloth\x1b]0;title\x07", "CLOTH")
    mesh = save(tmp_path / "mesh\x1b[2J.blend")
    capfd.readouterr()
    assert run(mesh, "--no-modifiers", "--output", tmp_path / "out\x1b[1m.blend") == 0
    assert run(mesh) == 1
    assert run(mesh, "--output", tmp_path / "nowhere\x1b" / "out.blend") == 1
    printed = capfd.readouterr()
    # Blender itself prints which files it reads and writes.
    lines = [
        line for line in (printed.out + printed.err).splitlines() if not re.search("Read blend: |Info: Saved", line)
    ]
    assert not [line for line in lines if any(mark in line for mark in "\x1b\x07\x9b\u202e")]
    for escaped in ("Red\\x1b[31m\\u202e", "Bell\\x07\\x9b2J", "Cloth\\x1b]0;title\\x07"):
        assert escaped in "\n".join(lines)
