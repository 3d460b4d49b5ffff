# SPDX-License-Identifier: GPL-3.0-or-later
"""--frames: depths and levels over frames, and what reports say of them."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.command_line_runs import Capture, few_samples, mesh_objects, run, save
from tests.blender.test_frames import LAST, with_a_shape_key
from tests.blender.test_report import report_in

LINE = ("--tolerance", "0.004", "--absolute", "--method", "certified", "--vertices", "control")
SETTINGS = {"tolerance": 0.004, "method": "CERTIFIED", "vertices": "CONTROL"}


@pytest.fixture
def animated(tmp_path: Path) -> Path:
    """An animated cube that is deepest on frame 8, in a file that was saved at its first frame."""
    with_a_shape_key(scene.add_object(meshes.cube()))
    settings = bpy.context.scene
    settings.frame_start, settings.frame_end = 1, LAST
    settings.frame_set(1)
    return save(tmp_path / "animated.blend")


def expected() -> bpy.types.PropertyGroup:
    """The record of the depths over all frames, of the object in the open file."""
    [holder] = (each for each in bpy.data.objects if each.type == "MESH")
    addon.compute(holder, **SETTINGS, frames="SCENE")
    assert holder.data.ccdepth.deepest == addon.depths(holder).max()
    return holder.data.ccdepth


@pytest.mark.parametrize("frames", [f"1-{LAST}", "scene"])
def test_depths_over_frames_are_reported(
    animated: Path, tmp_path: Path, frames: str, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers and the histogram of the page are about the same frames. At the frame of the file the cube is less
    deep."""
    few_samples(monkeypatch)
    report, table, html = (tmp_path / f"report.{kind}" for kind in ("json", "csv", "html"))
    assert run(animated, *LINE, "--frames", frames, "--json", report, "--csv", table, "--html", html) == 0
    printed = capfd.readouterr().out
    record = expected()
    deepest, worst = record.deepest, record.worst_frame
    assert worst == 8
    [each] = report_in(report)["files"][0]["objects"]
    assert (each["deepest"], each["worst_frame"]) == (deepest, worst)
    assert f"Deepest Depth: {deepest} at frame {worst}\n  Frames: 1-{LAST}\n" in printed
    assert each["settings"]["frames"] == ("SCENE" if frames == "scene" else "CUSTOM")
    [row] = csv.DictReader(table.open())
    assert (row["deepest"], row["worst_frame"]) == (str(deepest), str(worst))
    text = re.sub(r"<[^>]*>", "|", html.read_text(encoding="utf-8"))
    assert f"|Worst frame||{worst}|" in text
    for row in record.rows:
        assert f"|{row.depth}|||{row.faces:,} ({row.faces / record.faces:.1%})|" in text
    assert run("--verify", report) == 0


def test_the_level_over_frames_is_set_in_the_file(animated: Path, tmp_path: Path) -> None:
    report, output = tmp_path / "report.json", tmp_path / "out.blend"
    line = ("--levels", *LINE, "--output", output, "--json", report)
    assert run(animated, *line, "--frames", f"1-{LAST}") == 0
    [each] = report_in(report)["files"][0]["objects"]
    assert run("--verify", report) == 0
    [holder] = mesh_objects(output).values()
    assert holder.modifiers[-1].levels == each["level"] == holder.data.ccdepth.uniform_level
    assert bpy.context.scene.frame_current == 1
    over_frames = addon.depths(holder)
    assert bpy.context.scene.ccdepth.frames == "CUSTOM"
    addon.compute(holder, **SETTINGS, frames="CURRENT")
    assert np.all(addon.depths(holder) <= over_frames)
    assert np.any(addon.depths(holder) < over_frames)


@pytest.mark.parametrize(("frames", "worst"), [([], None), (["--frames=-2"], -2)])
def test_no_frame_and_negative_ones_stand_in_the_report(
    animated: Path, tmp_path: Path, frames: list[str], worst: int | None
) -> None:
    report = tmp_path / "report.json"
    assert run(animated, *LINE, *frames, "--json", report) == 0
    assert report_in(report)["files"][0]["objects"][0]["worst_frame"] == worst
    assert run("--verify", report) == 0
