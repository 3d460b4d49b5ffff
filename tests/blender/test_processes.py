# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes at a time, and the command line in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.test_full_disk import CHECKOUT, program

command_line = addon.module("command_line.command")


def ended(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*program(), *map(str, arguments)]
    return subprocess.run(
        command, timeout=300, capture_output=True, text=True, encoding="utf-8", cwd=folder, check=False
    )


def files_of(printed: str) -> list[dict[str, Any]]:
    """What a report says of each file, but for where it was written."""
    # Blender itself may have printed warnings before our command began.
    files = json.loads(printed[printed.index("{\n") :])["files"]
    return [{**each, "output": each["output"] and {**each["output"], "path": None}} for each in files]


def test_jobs_report_the_same_and_in_the_same_order(tmp_path: Path) -> None:
    """Names with spaces, quotes, line breaks and a leading dash, and a file that is broken."""
    names = ("-one", "th'r\"ee four", "fünf\n")
    for name in names:
        scene.clear()
        scene.add_object(meshes.cube(), f"Cube of {name}")
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / f"{name}.blend"), copy=True)
    (tmp_path / "bad.glb").write_bytes(b"glTF but not more")
    sources = ["bad.glb", *(f"{name}.blend" for name in names)]
    line = ["--subdivide", "--tolerance", "50mm", "--format", "stl", "--json", "-"]
    printed = {}
    for jobs in (0, 1, 2):
        folder = tmp_path / f"out{jobs}"
        folder.mkdir()
        others = ["--jobs", jobs] if jobs else []
        run = ended(tmp_path, *line, *others, "--output-folder", folder, "--", *sources)
        assert run.returncode == 1, run.stderr
        assert sorted(each.name for each in folder.iterdir()) == sorted(f"{name}.stl" for name in names)
        printed[jobs] = files_of(run.stdout)
        assert "4 of 4 files done, 0 left" in run.stderr
        assert "bad.glb" in run.stderr
    assert [each["error"] is None for each in printed[0]] == [False, True, True, True]
    assert [each["input"]["path"] for each in printed[0]] == [(tmp_path / source).as_posix() for source in sources]
    assert printed[0] == printed[1] == printed[2]


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_file_that_ends_its_process_takes_no_other_with_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], jobs: int
) -> None:
    names = ["one.blend", "two.blend", "deadly.blend", "three.blend", "deadly too.blend", "four.blend"]
    scene.add_object(meshes.cube())
    for name in names:
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / name), copy=True)
    (tmp_path / "out").mkdir()
    line = [*(str(tmp_path / name) for name in names), "--subdivide", "--tolerance", "50mm", "--format", "stl"]
    files = ["--output-folder", str(tmp_path / "out"), "--json", str(tmp_path / "report.json"), "--jobs", str(jobs)]
    assert command_line.run([*line, *files], program="ccdepth", process=deadly_program(tmp_path)) == 1
    entries = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["files"]
    assert [each["input"]["path"] for each in entries] == names
    errors = {each["input"]["path"]: each["error"] for each in entries if each["error"] is not None}
    assert errors == dict.fromkeys(("deadly.blend", "deadly too.blend"), "Blender ended with status -9: the end")
    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == [
        "four.stl",
        "one.stl",
        "three.stl",
        "two.stl",
    ]
    # Starting Blender is most of the time here: once for each job, and at most twice more for each that is deadly.
    starts = (tmp_path / "starts.txt").read_text().count("start")
    assert starts <= jobs + 2 * 2
    assert "6 of 6 files done, 0 left" in capfd.readouterr().err


def deadly_program(folder: Path) -> list[str]:
    """The command line in another process, which some files kill."""
    script = folder / "deadly.py"
    command = [sys.executable, str(script)]
    text = f"""
import os, runpy, signal, sys
from importlib import import_module
import bpy

def deadly_or_done(source, options):
    if source.name.startswith("deadly"):
        print("the end", file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    return done(source, options)

sys.path.insert(0, {str(CHECKOUT)!r})
with open({str(folder / "starts.txt")!r}, "a") as starts:
    starts.write("start ")
command = import_module({command_line.__name__!r})
done, command.process_file = command.process_file, deadly_or_done
"""
    if bpy.app.binary_path:
        command = [bpy.app.binary_path, "-b", "--python", str(script), "--command", "ccdepth"]
    else:
        text += f"runpy.run_path({str(CHECKOUT / 'scripts' / 'heat_map.py')!r})"
    script.write_text(text, encoding="utf-8")
    return command


def test_what_is_told_of_a_file_is_in_order(tmp_path: Path) -> None:
    """In one log of the standard output and the standard error, as farms keep it; objects may have a file's name."""
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    names = ["one", "two"]
    for name in names:
        scene.clear()
        scene.add_object(meshes.cube(), f"{name}.obj")
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cubes.blend"), copy=True)
        (tmp_path / "cubes.blend").rename(tmp_path / f"{name}.blend")
    for jobs in ([], ["--jobs", "1"]):
        line = [*program(), "one.blend", "two.blend", *jobs]
        to_one = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        log = subprocess.run(line, timeout=300, cwd=tmp_path, env=buffered, check=True, **to_one).stdout
        order = [log.index("\none.obj\n"), log.index("1 of 2 files done"), log.index("\ntwo.obj\n")]
        assert order == sorted(order)
        assert log.index("2 of 2 files done") > order[-1]
    run = ended(tmp_path, "one.blend", "--jobs", "1", "--objects", "one.obj")
    assert run.returncode == 0, run.stderr


def test_a_process_that_ends_before_its_file_is_done_is_the_failure_of_that_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for name in ("one.blend", "two.blend"):
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / name), copy=True)
    line = [str(tmp_path / "one.blend"), str(tmp_path / "two.blend"), "--jobs", "2", "--csv", "-"]
    capfd.readouterr()
    # A program that ends with status 1, whatever it is given.
    assert command_line.run(line, program="ccdepth", process=["false"]) == 1
    rows = capfd.readouterr().out.splitlines()[1:]
    assert len(rows) == 2
    assert all("Blender ended with status 1" in row for row in rows)
