# SPDX-License-Identifier: GPL-3.0-or-later
"""Several reports made one."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import pytest

from tests.blender.command_line_runs import Capture, few_samples, run, said, save_cubes
from tests.blender.test_report import report_in

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


def test_the_parts_make_the_report_of_one_run(tmp_path: Path, parts: Path, capfd: Capture) -> None:
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
        ({}, "and so has"),
        ({"action": "measure"}, "its action is measure"),
        ({"blender": "1.0"}, "another version"),
        ({"program": None}, "another version"),
        ({"format": "other"}, "not a CC Depth report"),
    ],
)
def test_reports_that_make_no_whole(
    tmp_path: Path, parts: Path, capfd: Capture, change: dict[str, Any], message: str
) -> None:
    content = json.loads((parts / "1.json").read_text(encoding="utf-8")) | change
    known = {name: value for name, value in content.items() if value is not None}
    (parts / "3.json").write_text(json.dumps(known), encoding="utf-8")
    capfd.readouterr()
    assert message in said(capfd, "--gather", parts, "--json", tmp_path / "all.json")
    assert not (tmp_path / "all.json").exists()


def test_an_empty_folder_has_no_report(tmp_path: Path, capfd: Capture) -> None:
    for folder, message in (
        (tmp_path, "there are no reports in it"),
        (tmp_path / "nowhere", "there is no such folder"),
    ):
        assert message in said(capfd, "--gather", folder, "--csv", tmp_path / "all.csv")


def texts_and_pixels(page: str) -> list[str | bytes]:
    """A page with its pictures; of .png files from the pixels on, as Blender writes before how long they took."""
    parts: list[str | bytes] = list(re.split(r'src="data:[^,]*,([^"]*)"', page))
    for index in range(1, len(parts), 2):
        content = b64decode(parts[index])
        parts[index] = content[max(0, content.find(b"IDAT")) :]
    return parts


def test_pictures_of_a_gathered_page_are_those_of_its_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    """The same as in the page of one run, where the reports hold them."""
    few_samples(monkeypatch)
    folder, html = tmp_path / "parts", tmp_path / "page.html"
    folder.mkdir()
    line = [
        "--subdivide",
        "--tolerance",
        "50mm",
        "--format",
        "stl",
        "--overwrite",
        "--output-folder",
        tmp_path / "made",
    ]
    sources = [save_cubes(tmp_path / f"{name}.blend", name) for name in ("One", "Two")]
    for number, source in enumerate(sources):
        assert run(source, *line, "--pictures", "--json", folder / f"{number}.json") == 0
        report_in(folder / f"{number}.json")
    assert run(*sources, *line, "--html", tmp_path / "whole.html") == 0

    assert run("--gather", folder, "--html", html, "--json", tmp_path / "bare.json") == 0
    # Reports name files as seen from where they are.
    page = html.read_text(encoding="utf-8").replace(f"{folder}/../", f"{tmp_path}/")
    assert texts_and_pixels(page) == texts_and_pixels((tmp_path / "whole.html").read_text(encoding="utf-8"))
    content = report_in(tmp_path / "bare.json")
    assert not any("pictures" in each for each in content["files"])
    assert run("--gather", folder, "--pictures", "--json", tmp_path / "all.json") == 0
    assert [len(each["pictures"]) for each in report_in(tmp_path / "all.json")["files"]] == [1, 1]
    assert run("--verify", tmp_path / "all.json") == 0
    content = report_in(folder / "0.json")
    content["files"][0]["pictures"][0]["heat_map"] = "no picture!"
    (folder / "0.json").write_text(json.dumps(content), encoding="utf-8")
    assert "it is not a CC Depth report" in said(capfd, "--gather", folder, "--html", html, "--overwrite")
