# SPDX-License-Identifier: GPL-3.0-or-later
"""--frames: depths and levels over frames, and what reports say of them."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import addon
from tests.blender.command_line_runs import run, save
from tests.blender.test_frames import LAST, with_a_shape_key
from tests.blender.test_report import report_in

LINE = ("--tolerance", "0.004", "--absolute", "--method", "certified")


@pytest.fixture
def animated(tmp_path: Path) -> Path:
    """An animated object, in a file that was saved at its first frame."""
    with_a_shape_key()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, LAST
    scene.frame_set(1)
    return save(tmp_path / "animated.blend")


def expected() -> tuple[int, int]:
    """The deepest depth over all frames and the worst frame, of the object in the open file."""
    [holder] = (each for each in bpy.data.objects if each.type == "MESH")
    addon.compute(holder, tolerance=0.004, method="CERTIFIED", frames="SCENE")
    return int(addon.depths(holder).max()), holder.data.ccdepth.worst_frame


@pytest.mark.parametrize("frames", [f"1-{LAST}", "scene"])
def test_depths_over_frames_are_reported(
    animated: Path, tmp_path: Path, frames: str, capfd: pytest.CaptureFixture[str]
) -> None:
    report, table = tmp_path / "report.json", tmp_path / "table.csv"
    assert run(animated, *LINE, "--frames", frames, "--json", report, "--csv", table) == 0
    printed = capfd.readouterr().out
    content = report_in(report)
    [each] = content["files"][0]["objects"]
    deepest, worst = expected()
    assert (each["deepest"], each["worst_frame"]) == (deepest, worst)
    assert f"deepest at frame {worst}, of frames 1-{LAST}" in printed
    assert each["settings"]["frames"] == ("SCENE" if frames == "scene" else "CUSTOM")
    [row] = csv.DictReader(table.open())
    assert (row["deepest"], row["worst_frame"]) == (str(deepest), str(worst))
    assert run("--verify", report) == 0


def test_the_level_over_frames_is_set_in_the_file(animated: Path, tmp_path: Path) -> None:
    report, output = tmp_path / "report.json", tmp_path / "out.blend"
    line = ("--levels", *LINE, "--output", output, "--json", report)
    assert run(animated, *line, "--frames", f"1-{LAST}") == 0
    [each] = report_in(report)["files"][0]["objects"]
    assert run("--verify", report) == 0
    bpy.ops.wm.open_mainfile(filepath=str(output))
    [holder] = (each for each in bpy.data.objects if each.type == "MESH")
    assert holder.modifiers[-1].levels == each["level"] == holder.data.ccdepth.uniform_level
    assert bpy.context.scene.frame_current == 1
    over_frames = addon.depths(holder)
    assert bpy.context.scene.ccdepth.frames == "CUSTOM"
    addon.compute(holder, tolerance=0.004, method="CERTIFIED", frames="CURRENT")
    assert np.all(addon.depths(holder) <= over_frames)
    assert np.any(addon.depths(holder) < over_frames)


def test_the_page_is_about_the_same_frames(animated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers, histogram and methods alike. At the frame of the file the cube is less deep."""
    monkeypatch.setattr(addon.module("command_line.picture"), "SAMPLES", 1)
    html = tmp_path / "report.html"
    assert run(animated, *LINE, "--frames", "scene", "--html", html) == 0
    text = re.sub(r"<[^>]*>", "|", html.read_text(encoding="utf-8"))
    deepest, worst = expected()
    record = next(each.data for each in bpy.data.objects if each.type == "MESH").ccdepth
    assert f"|Worst frame||{worst}|" in text
    assert f"|Certified||{deepest}||{record.uniform_level}||{int(record.uniform_faces):,}|" in text
    for row in record.rows:
        assert f"|{row.depth}|||{row.faces:,} ({row.faces / record.faces:.1%})|" in text


def test_without_frames_none_is_named(animated: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    assert run(animated, *LINE, "--json", report) == 0
    assert report_in(report)["files"][0]["objects"][0]["worst_frame"] is None


def test_processes_are_given_the_same_frames() -> None:
    parser = addon.module("command_line.arguments").Parser("ccdepth")
    options = parser.parsed(["a.blend", "--frames=-3-12/5"])
    assert "--frames=-3-12/5" in parser.arguments_for_others(options)
    assert parser.parsed(["a.blend", *parser.arguments_for_others(options)]).frames == "-3-12/5"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (("--frames", "1-"), "are no frames"),
        (("--frames", "9-1"), "the first comes before the last"),
        (("--frames", "1-9", "--subdivide"), "--frames is for depths and --levels"),
        (("--frames", "1-9", "--measure"), "--frames is for depths and --levels"),
    ],
)
def test_lines_that_make_no_sense(line: tuple[str, ...], message: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(*line) == 2
    assert message in capfd.readouterr().err


def test_negative_frames_stand_in_the_report(animated: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    assert run(animated, *LINE, "--frames=-2", "--json", report) == 0
    assert report_in(report)["files"][0]["objects"][0]["worst_frame"] == -2
    assert run("--verify", report) == 0
