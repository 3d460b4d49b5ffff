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
from tests.blender.command_line_runs import CHECKOUT, Capture, program, run, save, save_cubes

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


def test_jobs_report_the_same_and_in_the_same_order(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names with spaces, quotes, line breaks and a leading dash, and a file that is broken."""
    monkeypatch.chdir(tmp_path)
    names = ("-one", "th'r\"ee four", "fünf\n")
    for name in names:
        save_cubes(tmp_path / f"{name}.blend", f"Cube of {name}")
    (tmp_path / "bad.glb").write_bytes(b"glTF but not more")
    sources = ["bad.glb", *(f"{name}.blend" for name in names)]
    line = ["--subdivide", "--tolerance", "50mm", "--format", "stl", "--json", "-"]
    reports = []
    for jobs in (0, 2):
        folder = tmp_path / f"out{jobs}"
        folder.mkdir()
        capfd.readouterr()
        words = [*line, *(["--jobs", jobs] if jobs else []), "--output-folder", folder, "--", *sources]
        if jobs:
            process = ended(tmp_path, *words)
            status, printed, told = process.returncode, process.stdout, process.stderr
        else:
            status = run(*words)
            printed, told = capfd.readouterr()
        assert status == 1, told
        assert sorted(each.name for each in folder.iterdir()) == sorted(f"{name}.stl" for name in names)
        assert "4 of 4 files done, 0 left" in told
        assert "bad.glb" in told
        reports.append(files_of(printed))
    assert [each["error"] is None for each in reports[0]] == [False, True, True, True]
    assert [each["input"]["path"] for each in reports[0]] == [(tmp_path / source).as_posix() for source in sources]
    assert reports[0] == reports[1]


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("jobs", "names", "most_starts"),
    [(1, "one,two,deadly,deadly too,three", 4), (2, "one,two,deadly,three,deadly too,four", 6)],
)
def test_a_file_that_ends_its_process_takes_no_other_with_it(
    tmp_path: Path, capfd: Capture, jobs: int, names: str, most_starts: int
) -> None:
    scene.add_object(meshes.cube())
    report, made, stems = tmp_path / "report.json", tmp_path / "out", names.split(",")
    sources = [save(tmp_path / f"{stem}.blend") for stem in stems]
    line = [*sources, "--subdivide", "--tolerance", "50mm", "--format", "stl", "--output-folder", made]
    assert run(*line, "--json", report, "--jobs", jobs, process=deadly_program(tmp_path)) == 1
    entries = json.loads(report.read_text(encoding="utf-8"))["files"]
    assert [each["input"]["path"] for each in entries] == [source.name for source in sources]
    errors = {each["input"]["path"]: each["error"] for each in entries if each["error"] is not None}
    assert errors == dict.fromkeys(("deadly.blend", "deadly too.blend"), "Blender ended with status -9: the end")
    assert {each.stem for each in made.iterdir()} == set(stems) - {"deadly", "deadly too"}
    # Starting Blender is most of the time here: once for each job, and at most twice more for each that is deadly; once
    # where its process has done nothing before.
    starts = (tmp_path / "starts.txt").read_text().count("start")
    assert starts <= most_starts
    assert f"{len(sources)} of {len(sources)} files done, 0 left" in capfd.readouterr().err


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


@pytest.mark.parametrize("jobs", [[], ["--jobs", "1"]])
def test_what_is_told_of_a_file_is_in_order(tmp_path: Path, jobs: list[str]) -> None:
    """In one log of the standard output and the standard error, as farms keep it; objects may have a file's name."""
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    for name in ("one", "two"):
        save_cubes(tmp_path / f"{name}.blend", f"{name}.obj")
    line = [*program(), "one.blend", "two.blend", *jobs]
    to_one = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    log = subprocess.run(line, timeout=300, cwd=tmp_path, env=buffered, check=True, **to_one).stdout
    order = [log.index("\none.obj\n"), log.index("1 of 2 files done"), log.index("\ntwo.obj\n")]
    assert order == sorted(order)
    assert log.index("2 of 2 files done") > order[-1]


def test_names_of_objects_may_look_like_files_in_other_processes(tmp_path: Path) -> None:
    source = save_cubes(tmp_path / "one.blend", "one.obj")
    assert run(source, "--jobs", "1", "--objects", "one.obj", process=program()) == 0


def test_a_process_that_ends_before_its_file_is_done_is_the_failure_of_that_file(
    tmp_path: Path, capfd: Capture
) -> None:
    sources = [save(tmp_path / name) for name in ("one.blend", "two.blend")]
    capfd.readouterr()
    # A program that ends with status 1, whatever it is given.
    assert run(*sources, "--jobs", "2", "--csv", "-", process=["false"]) == 1
    rows = capfd.readouterr().out.splitlines()[1:]
    assert len(rows) == 2
    assert all("Blender ended with status 1" in row for row in rows)
