# SPDX-License-Identifier: GPL-3.0-or-later
"""Outputs that the command line refuses, because what is there would be lost or a report could not be verified."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from tests.blender.command_line_runs import Capture, run, save_cubes

LINE = ("--absolute", "--tolerance", "50mm", "--method", "second-order")


@pytest.mark.parametrize("option", ["--output", "--json", "--csv", "--html", "--picture"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "link to a device"])
def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path, capfd: Capture, option: str, kind: str) -> None:
    source = save_cubes(tmp_path / "cubes.blend", "One")
    # --picture and --output ask for these endings.
    there = tmp_path / ("out.png" if option == "--picture" else "out.blend")
    device = there if kind == "device" else tmp_path / "elsewhere"
    if "device" in kind:
        try:
            # Not /dev/full itself: a program that replaces it harms the whole machine.
            os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 7))
        except PermissionError:
            pytest.skip("only root can make devices")
    if kind == "pipe":
        os.mkfifo(there)
    elif kind == "folder":
        there.mkdir()
    elif kind == "link to a device":
        there.symlink_to(device)
    before_all = sorted(tmp_path.iterdir())
    before = os.stat(there)
    assert run(source, *LINE, option, there, "--overwrite") == 1
    assert (os.stat(there).st_ino, os.stat(there).st_mode) == (before.st_ino, before.st_mode)
    assert "not a regular file" in capfd.readouterr().err
    assert sorted(tmp_path.iterdir()) == before_all


@pytest.mark.parametrize("report", ["--json", "--csv", "--html"])
def test_no_report_is_made_of_an_input_that_is_replaced(tmp_path: Path, capfd: Capture, report: str) -> None:
    source = save_cubes(tmp_path / "cubes.blend", "One")
    before = source.read_bytes()
    for output in (("--output", source), ("--output-folder", tmp_path)):
        assert run(source, *LINE, *output, report, tmp_path / "report", "--overwrite") == 2
        assert "is read, and would be replaced" in capfd.readouterr().err
        assert (source.read_bytes() == before, (tmp_path / "report").exists()) == (True, False)
        # Without a report the file may be replaced.
    assert run(source, *LINE, "--output", source, "--overwrite") == 0
    assert source.read_bytes() != before


def test_reports_of_two_files_that_were_written_to_one_place_are_not_gathered(tmp_path: Path, capfd: Capture) -> None:
    parts = tmp_path / "parts"
    parts.mkdir()
    for name in ("x", "y"):
        (tmp_path / name).mkdir()
        source = save_cubes(tmp_path / name / "a.blend", "One")
        line = ("--subdivide", "--output-folder", tmp_path / "out", "--overwrite", "--json", parts / f"{name}.json")
        assert run(source, *LINE[:3], *line) == 0
    assert run("--gather", parts, "--json", tmp_path / "all.json") == 1
    told = capfd.readouterr().err
    assert all(str(each) in told for each in (parts / "x.json", parts / "y.json", tmp_path / "out" / "a.blend"))
    assert not (tmp_path / "all.json").exists()
