# SPDX-License-Identifier: GPL-3.0-or-later
"""Several reports made one."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.blender.command_line_runs import run, save_cubes

LINE = ["--absolute", "--tolerance", "50mm", "--method", "certified"]


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    """A folder with the reports of two files, one of which is not there."""
    folder = tmp_path / "parts"
    folder.mkdir()
    source = save_cubes(tmp_path / "cubes.blend", "One", "Two")
    assert run(source, *LINE, "--json", folder / "1.json") == 0
    assert run(tmp_path / "missing.obj", *LINE, "--json", folder / "2.json") == 1
    return folder


def test_the_parts_make_the_report_of_one_run(tmp_path: Path, parts: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole, gathered = tmp_path / "whole.json", tmp_path / "gathered.json"
    assert run(tmp_path / "cubes.blend", tmp_path / "missing.obj", *LINE, "--json", whole) == 1
    capfd.readouterr()
    assert run("--gather", parts, "--json", gathered, "--csv", tmp_path / "all.csv", "--html", tmp_path / "a.html") == 1
    assert gathered.read_bytes() == whole.read_bytes()
    told = capfd.readouterr().err
    assert "missing.obj: there is no such file" in told
    assert "cubes.blend" not in told
    assert len((tmp_path / "all.csv").read_text(encoding="utf-8").splitlines()) == 4
    assert "there is no such file" in (tmp_path / "a.html").read_text(encoding="utf-8")
    (parts / "2.json").unlink()
    assert run("--gather", parts, "--json", gathered, "--overwrite") == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: None, "and so does"),
        (lambda content: content.update(action="measure"), "its action is measure"),
        (lambda content: content.update(blender="1.0"), "another version"),
        (lambda content: content.update(format="other"), "no report of CC Depth"),
    ],
)
def test_reports_that_make_no_whole(
    tmp_path: Path,
    parts: Path,
    capfd: pytest.CaptureFixture[str],
    change: Callable[[dict[str, Any]], None],
    message: str,
) -> None:
    content = json.loads((parts / "1.json").read_text(encoding="utf-8"))
    change(content)
    (parts / "3.json").write_text(json.dumps(content), encoding="utf-8")
    capfd.readouterr()
    assert run("--gather", parts, "--json", tmp_path / "all.json") == 1
    assert message in capfd.readouterr().err
    assert not (tmp_path / "all.json").exists()


def test_an_empty_folder_has_no_report(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run("--gather", tmp_path, "--csv", tmp_path / "all.csv") == 1
    assert "there are no reports in it" in capfd.readouterr().err


def test_lines_that_make_no_sense(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for line, message in (
        (["part.blend", "--gather", tmp_path, "--json", "-"], "takes a folder of reports alone"),
        (["--gather", tmp_path], "--gather writes a report"),
    ):
        assert run(*line) == 2
        assert message in capfd.readouterr().err
