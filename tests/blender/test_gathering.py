# SPDX-License-Identifier: GPL-3.0-or-later
"""Several reports made one."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.blender import addon
from tests.blender.command_line_runs import run, save_cubes

picture = addon.module("command_line.picture")

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
        (lambda content: None, "and so has"),
        (lambda content: content.update(action="measure"), "its action is measure"),
        (lambda content: content.update(blender="1.0"), "another version"),
        (lambda content: content.pop("program"), "another version"),
        (lambda content: content.update(format="other"), "not a CC Depth report"),
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
    assert run("--gather", tmp_path / "nowhere", "--csv", tmp_path / "all.csv") == 1
    assert "there is no such folder" in capfd.readouterr().err


def test_lines_that_make_no_sense(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for line, message in (
        (["part.blend", "--gather", tmp_path, "--json", "-"], "takes a folder of reports and nothing else"),
        (["--gather", tmp_path, "--json", "-", "--tolerance", "1mm"], "takes a folder of reports and nothing else"),
        (["--gather", tmp_path, "--json", "-", "--jobs", "2"], "takes a folder of reports and nothing else"),
        (["--gather", tmp_path], "--gather writes a report"),
        (["--gather", tmp_path, "--json", "-", "--draw"], "--draw is for --gather with --html"),
        (["--html", "-", "--draw"], "--draw is for --gather with --html"),
    ):
        assert run(*line) == 2
        assert message in capfd.readouterr().err


def texts_and_pixels(page: str) -> list[str | bytes]:
    """A page with its pictures; of .png files from the pixels on, as Blender writes before how long they took."""
    parts: list[str | bytes] = list(re.split(r'src="data:[^,]*,([^"]*)"', page))
    for index in range(1, len(parts), 2):
        content = b64decode(parts[index])
        parts[index] = content[max(0, content.find(b"IDAT")) :]
    return parts


def test_pictures_of_a_gathered_page_are_those_of_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The same as in the page of one run; none, and the reason, of a file that has changed since."""
    monkeypatch.setattr(picture, "SAMPLES", 2)
    folder = tmp_path / "parts"
    folder.mkdir()
    line = (
        "--subdivide",
        "--tolerance",
        "50mm",
        "--format",
        "stl",
        "--overwrite",
        "--output-folder",
        tmp_path / "made",
    )
    sources = [save_cubes(tmp_path / f"{name}.blend", name) for name in ("One", "Two")]
    for number, source in enumerate(sources):
        assert run(source, *line, "--json", folder / f"{number}.json") == 0
    assert run(*sources, *line, "--html", tmp_path / "whole.html") == 0
    whole = (tmp_path / "whole.html").read_text(encoding="utf-8")
    gather = ("--gather", folder, "--html", tmp_path / "page.html", "--overwrite")
    assert run(*gather, "--draw") == 0
    assert "2 of 2 files drawn" in capfd.readouterr().err
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    # Reports name files as seen from where they are.
    assert texts_and_pixels(page.replace(f"{folder}/../", f"{tmp_path}/")) == texts_and_pixels(whole)
    assert run(*gather) == 0
    undrawn = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert undrawn.count("Without pictures: reports hold none; --gather with --draw makes them") == 2
    assert "<img" not in undrawn
    save_cubes(sources[0], "One", "Another")
    assert run(*gather, "--draw") == 0
    changed = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert changed.count("<img") == 2
    assert "One.blend is not the file that the report names" in changed
