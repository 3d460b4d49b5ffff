# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line, called as Blender calls it; and the examples and what README shows, run as people run them."""

import csv
import io
import re
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, runs, scene
from tests.blender.runs import CHECKOUT, Capture, depths_in, mesh_objects, printed, run, said, save
from tests.blender.subdividing import subdivide

SUZANNE_FACES = 500

FORMATS = (".blend", ".obj", ".ply", ".stl")


@pytest.fixture
def cube_file(tmp_path: Path) -> Path:
    """A cube of 2 m, with Blender's settings of a new file."""
    bpy.context.scene.ccdepth.property_unset("method")
    scene.add_object(meshes.cube(), "Cube")
    return save(tmp_path / "cube.blend")


def test_without_a_mesh_it_measures_suzanne_as_the_operator_does(tmp_path: Path, capfd: Capture) -> None:
    output = tmp_path / "suzanne.blend"
    sharp = {"tolerance": 0.01, "method": "SHARP", "vertices": "LIMIT"}
    for line, settings in (
        ("--method certified", {"method": "CERTIFIED"}),
        ("--method distance --effort quick", {"method": "DISTANCE", "effort": "QUICK"}),
        ("--tolerance 0.01 --absolute --method sharp --vertices limit", sharp),
    ):
        told = printed(capfd, *line.split(), "--output", output, "--overwrite")
        [(name, written)] = depths_in(output).items()
        assert (name, len(written)) == ("Suzanne", SUZANNE_FACES)
        for depth, count in zip(*np.unique(written, return_counts=True), strict=True):
            assert f"{depth:>8}{count:>14,}" in told
        scene.clear()
        suzanne = scene.add_suzanne()
        addon.compute(suzanne, **settings)
        assert written == addon.depths(suzanne).tolist()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["suzanne.blend"]


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_can_be_read_and_stays_as_it_is(tmp_path: Path, suffix: str) -> None:
    mesh = tmp_path / f"mesh{suffix}"
    addon.select(scene.add_suzanne())
    if suffix == ".blend":
        save(mesh)
    else:
        getattr(bpy.ops.wm, f"{suffix[1:]}_export")(filepath=str(mesh))
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
--tolerance=-1mm | “-1mm” is not
--tolerance nan | a finite number greater than zero
--subdivide --tolerance inf | a finite number greater than zero
--method guess | invalid choice
--unknown | unrecognized arguments
--max-faces 99999999999999 | is not between 1 and
--max-faces 0 | is not between 1 and
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
--levels --subdivide | cannot be used together
--subdivide --lods 3 | cannot be used together
--lods 0 | is not a whole number of at least 1
--lod-step 2 | are for --lods
--subdivide --view-height 900 | are for --lods
--lods 3 --in-place | --in-place is not for it
--lods 3 --picture out.png | --picture is not for --lods
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
--subdivide --output same.stl --json same.stl --overwrite | several files would be written to
mesh.png --picture mesh.png --overwrite | is read, and would be replaced
mesh.obj --verify report.json | --verify takes a report and nothing else
--verify report.json --tolerance 1mm | --verify takes a report and nothing else
--verify report.json --overwrite | --verify takes a report and nothing else
mesh.obj --json ./nowhere/../mesh.obj --overwrite | is read, and would be replaced
--json same --csv ./nowhere/../same --overwrite | several files would be written to
--subdivide --output same.obj --json same.mtl --overwrite | several files would be written to
--objects Cube mesh.blend | put the files before it
part.blend --gather . --json - | takes a folder of reports and nothing else
--gather . --json - --tolerance 1mm | takes a folder of reports and nothing else
--gather . | --gather writes a report
--gather . --html - --pictures | --pictures is for --json
--html - --pictures | --pictures is for --json
"""


@pytest.mark.parametrize("case", WRONG_LINES.strip().splitlines())
def test_a_line_that_makes_no_sense_is_refused(capfd: Capture, case: str) -> None:
    line, _, message = case.partition(" | ")
    told = " ".join(said(capfd, *(word.replace("_", " ") for word in line.split()), status=2).split())
    assert "usage: ccdepth" in told
    assert message in told


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
    assert "--tolerance" in printed(capfd, "--help")


@pytest.mark.every_blender
@pytest.mark.parametrize("in_place", [False, True])
def test_it_subdivides(
    cube_file: Path, tmp_path: Path, capfd: Capture, in_place: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The picture shows the distances."""
    runs.few_samples(monkeypatch)
    path = tmp_path / "picture.png"
    line = ["--subdivide", "--tolerance", "0.01", "--absolute", "--mode", "per-face"]
    files = ["--picture", path, "--output", tmp_path / "out.blend"]
    told = printed(capfd, cube_file, *line, *(["--in-place"] if in_place else []), *files)
    assert f"Written: {path}" in told
    assert path.read_bytes().startswith(b"\x89PNG")
    [(name, written)] = depths_in(tmp_path / "out.blend").items()
    assert name == ("Cube" if in_place else "Cube Adaptive")
    assert bpy.data.objects[name].visible_get()
    assert len([holder for holder in bpy.data.objects if holder.visible_get()]) == 1
    assert f"{name}\n  Faces: {len(written):,}\n  Control Faces: 6\n" in told
    [result] = subdivide(mesh_objects(cube_file)["Cube"], tolerance=0.01, mode="PER_FACE")
    assert written == addon.depths(result).tolist()


def test_proved_distances_are_rounded_up(cube_file: Path, capfd: Capture) -> None:
    """The first six tolerances of a row, of whose distances some would be rounded down."""
    for number in range(6):
        told = printed(capfd, cube_file, "--subdivide", "--absolute", "--tolerance", 0.03 + 0.001 * number)
        [distance] = re.findall(r"Distance: (\S+) m", told)
        record = bpy.data.objects["Cube Adaptive"].data.ccdepth
        assert record.largest_bound <= float(distance) <= record.largest_bound * 1.001 + 1e-9


@pytest.mark.every_blender
@pytest.mark.skipif(not bpy.app.binary_path, reason="needs Blender's own program")
@pytest.mark.parametrize(("arguments", "status"), [([], 0), (["--tolerance", "1e-12"], 1), (["--unknown"], 2)])
def test_blender_passes_the_exit_status_on(arguments: list[str], status: int) -> None:
    assert subprocess.run([*runs.program(), *arguments], timeout=120, capture_output=True).returncode == status


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
    both = (printed.out + printed.err).splitlines()
    lines = [line for line in both if not re.search("Read blend: |Info: Saved", line)]
    assert not [line for line in lines if any(mark in line for mark in "\x1b\x07\x9b\u202e")]
    for escaped in ("Red\\x1b[31m\\u202e", "Bell\\x07\\x9b2J", "Cloth\\x1b]0;title\\x07"):
        assert escaped in "\n".join(lines)


# What stands in for Blender's own program where there is none.
STAND_IN = """
import os, runpy, sys, traceback
sys.path.insert(0, {checkout!r})
import bpy, ccdepth_addon
ccdepth_addon.register()
if {file!r}:
    bpy.ops.wm.open_mainfile(filepath={file!r})
sys.argv = ["blender", "--", *{arguments!r}]
try:
    runpy.run_path({script!r})
    sys.stdout.flush()
except BaseException:
    traceback.print_exc()
    os._exit(1)
os._exit(0)
"""


def example_command(name: str, file: Path | None, *arguments: object) -> list[str]:
    """What runs an example with a file open."""
    script, given = str(CHECKOUT / "examples" / name), [str(argument) for argument in arguments]
    opened = [] if file is None else [str(file)]
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", *opened, "--python-exit-code", "1", "--python", script, "--", *given]
    text = STAND_IN.format(checkout=str(CHECKOUT), file="".join(opened), arguments=given, script=script)
    return [sys.executable, "-c", text]


def printed_by(name: str, file: Path | None, *arguments: object) -> str:
    """What the example prints."""
    ended = subprocess.run(example_command(name, file, *arguments), timeout=120, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_set_levels(cube_file: Path, tmp_path: Path) -> None:
    printed_by("set_levels.py", cube_file, 0.05, tmp_path / "out.blend")
    [modifier] = mesh_objects(tmp_path / "out.blend")["Cube"].modifiers
    assert modifier.levels == modifier.render_levels > 0
    assert modifier.use_limit_surface


def test_batch_depth(cube_file: Path) -> None:
    row = printed_by("batch_depth.py", cube_file, 0.05).splitlines()[-1].split("\t")
    cube = mesh_objects(cube_file)["Cube"]
    addon.compute(cube, tolerance=0.05)
    record = cube.data.ccdepth
    assert record.method == "DISTANCE"
    assert row == [str(cube_file), "Cube", "6", str(record.uniform_level), record.uniform_faces]


def test_print_stl(cube_file: Path, tmp_path: Path) -> None:
    printed = printed_by("print_stl.py", cube_file, 50, tmp_path / "out.stl")
    bpy.ops.wm.stl_import(filepath=str(tmp_path / "out.stl"))
    [cube] = bpy.context.selected_objects
    assert f"{len(cube.data.polygons)} triangles, proved to be within" in printed
    # The middles of a cube's limit surface are a third inwards, and it touches its box there.
    sides = np.array(cube.dimensions)
    np.testing.assert_allclose(sides, sides.mean(), rtol=0.05)
    assert 1000.0 < sides.max() < 2000.0


def test_lod_chain(cube_file: Path, tmp_path: Path) -> None:
    printed_by("lod_chain.py", cube_file, 0.002, tmp_path / "out.glb")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out.glb"))
    faces = [len(bpy.data.objects[f"Cube_LOD{level}"].data.polygons) for level in range(3)]
    assert faces[0] > 2 * faces[1] > 4 * faces[2]
    assert not [each.name for mesh in bpy.data.meshes for each in mesh.color_attributes]


def test_folder_report(cube_file: Path) -> None:
    (cube_file.parent / "bad.blend").write_text("this is no file of Blender's")
    printed = printed_by("folder_report.py", None, cube_file.parent)
    rows = list(csv.reader(io.StringIO(printed[printed.index("file,object") :])))[1:]
    by_file = {row[0]: row for row in rows if row and row[0].endswith(".blend")}
    # The limit surface passes √3/2 m inside of the corners.
    _, name, most, least, error = by_file["cube.blend"]
    assert (name, error) == ("Cube", "")
    assert float(least) <= 0.75**0.5 <= float(most)
    cube = mesh_objects(cube_file)["Cube"]
    addon.measure(cube, time_limit=10)
    # Rounded to the nearest, the one would be too little or the other too much.
    assert (float(most), float(least)) == (cube.data.ccdepth.deviation, cube.data.ccdepth.deviation_reached)
    assert float(most) < 0.95
    assert by_file["bad.blend"][4]


# A part of her size, as README says.
TOLERANCE = 1e-3


def test_numbers_of_faces_are_what_is_made() -> None:
    """Shaded smooth, with subdivision levels, by distance alone, in the picture of both, after the first clicks, and
    by the quicker method, in README's order."""
    text = re.sub(r"\s+", " ", (CHECKOUT / "README.md").read_text(encoding="utf-8"))
    found = re.findall(r"([\d,]+)(?: faces| with CC Depth)", text)
    suzanne = scene.add_suzanne()
    uniform = []
    for method in ("DISTANCE", "CERTIFIED"):
        addon.compute(suzanne, tolerance=TOLERANCE, tolerance_mode="RELATIVE", vertices="LIMIT", method=method)
        # Of a triangle three quads are made first, of a quad four, and of each of these four at every later level.
        uniform.append(len(suzanne.data.loops) * 4 ** (suzanne.data.ccdepth.uniform_level - 1))
    made = []
    for is_smooth in (False, True):
        scene.clear()
        suzanne = scene.add_suzanne()
        suzanne.data.polygons.foreach_set("use_smooth", np.full(len(suzanne.data.polygons), is_smooth))
        addon.select(suzanne)
        bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE")
        made.append(len(bpy.context.object.data.polygons))
    assert [int(number.replace(",", "")) for number in found] == [
        *(made[1], uniform[0], made[0]),
        *(uniform[0], made[1], made[1], uniform[1]),
    ]
