# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples and what README shows, run as people run them."""

from __future__ import annotations

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
from tests.blender import addon, scene
from tests.blender.runs import CHECKOUT, mesh_objects, save

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


def run(name: str, file: Path | None, *arguments: object) -> str:
    """What the example prints."""
    ended = subprocess.run(example_command(name, file, *arguments), timeout=120, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture
def cube_file(tmp_path: Path) -> Path:
    """A cube of 2 m, with Blender's settings of a new file."""
    bpy.context.scene.ccdepth.property_unset("method")
    scene.add_object(meshes.cube(), "Cube")
    return save(tmp_path / "cube.blend")


def test_set_levels(cube_file: Path, tmp_path: Path) -> None:
    run("set_levels.py", cube_file, 0.05, tmp_path / "out.blend")
    [modifier] = mesh_objects(tmp_path / "out.blend")["Cube"].modifiers
    assert modifier.levels == modifier.render_levels > 0
    assert modifier.use_limit_surface


def test_batch_depth(cube_file: Path) -> None:
    row = run("batch_depth.py", cube_file, 0.05).splitlines()[-1].split("\t")
    cube = mesh_objects(cube_file)["Cube"]
    addon.compute(cube, tolerance=0.05)
    record = cube.data.ccdepth
    assert record.method == "DISTANCE"
    assert row == [str(cube_file), "Cube", "6", str(record.uniform_level), record.uniform_faces]


def test_print_stl(cube_file: Path, tmp_path: Path) -> None:
    printed = run("print_stl.py", cube_file, 50, tmp_path / "out.stl")
    bpy.ops.wm.stl_import(filepath=str(tmp_path / "out.stl"))
    [cube] = bpy.context.selected_objects
    assert f"{len(cube.data.polygons)} triangles, proved to be within" in printed
    # The middles of a cube's limit surface are a third inwards, and it touches its box there.
    sides = np.array(cube.dimensions)
    np.testing.assert_allclose(sides, sides.mean(), rtol=0.05)
    assert 1000.0 < sides.max() < 2000.0


def test_lod_chain(cube_file: Path, tmp_path: Path) -> None:
    run("lod_chain.py", cube_file, 0.002, tmp_path / "out.glb")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "out.glb"))
    faces = [len(bpy.data.objects[f"Cube_LOD{level}"].data.polygons) for level in range(3)]
    assert faces[0] > 2 * faces[1] > 4 * faces[2]
    assert not [each.name for mesh in bpy.data.meshes for each in mesh.color_attributes]


def test_folder_report(cube_file: Path) -> None:
    (cube_file.parent / "bad.blend").write_text("this is no file of Blender's")
    printed = run("folder_report.py", None, cube_file.parent)
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


# README


README = Path(__file__).resolve().parent.parent.parent / "README.md"

# A part of her size, as README says.
TOLERANCE = 1e-3


def test_numbers_of_faces_are_what_is_made() -> None:
    """With subdivision levels, with CC Depth, in the picture of both, and by the quicker method, in README's order."""
    text = re.sub(r"\s+", " ", README.read_text(encoding="utf-8"))
    found = re.findall(r"([\d,]+)(?: faces| with CC Depth)", text)
    suzanne = scene.add_suzanne()
    uniform = []
    for method in ("DISTANCE", "CERTIFIED"):
        addon.compute(suzanne, tolerance=TOLERANCE, tolerance_mode="RELATIVE", vertices="LIMIT", method=method)
        # Of a triangle three quads are made first, of a quad four, and of each of these four at every later level.
        uniform.append(len(suzanne.data.loops) * 4 ** (suzanne.data.ccdepth.uniform_level - 1))
    bpy.ops.ccdepth.subdivide(tolerance=TOLERANCE, tolerance_mode="RELATIVE", output="IN_PLACE")
    made = len(bpy.context.object.data.polygons)
    assert [int(number.replace(",", "")) for number in found] == [uniform[0], made, uniform[0], made, uniform[1]]
