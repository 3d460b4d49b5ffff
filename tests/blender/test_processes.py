# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes at a time, and the command line in a process of its own."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.test_full_disk import program

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
    for jobs in (1, 2):
        folder = tmp_path / f"out{jobs}"
        folder.mkdir()
        run = ended(tmp_path, *line, "--jobs", jobs, "--output-folder", folder, "--", *sources)
        assert run.returncode == 1, run.stderr
        assert sorted(each.name for each in folder.iterdir()) == sorted(f"{name}.stl" for name in names)
        printed[jobs] = files_of(run.stdout)
        assert "4 of 4 files done, 0 left" in run.stderr
        assert "bad.glb" in run.stderr
    assert [each["error"] is None for each in printed[1]] == [False, True, True, True]
    assert [each["input"]["path"] for each in printed[1]] == [(tmp_path / source).as_posix() for source in sources]
    assert printed[1] == printed[2]


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
