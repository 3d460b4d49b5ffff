# SPDX-License-Identifier: GPL-3.0-or-later
"""A file of 308a89a opens with all it holds: depths, adaptive objects, measurements, and what is kept updated."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender import addon
from tests.blender.updating import move_vertex, set_scene, stale_line, update

pytestmark = pytest.mark.every_blender

# ``make.py`` beside it says how it was made.
OLD_FILE = Path(__file__).with_name("saved_by_308a89a") / "results.blend"

SETTINGS_LINE, SOURCE_LINE = "Out of date: settings changed", "Out of date: “Kept” changed"


@pytest.fixture(autouse=True)
def opened(tmp_path: Path) -> Iterator[dict[str, bpy.types.Object]]:
    """The objects of the file, opened from a copy, by name."""
    bpy.ops.wm.open_mainfile(filepath=str(shutil.copy(OLD_FILE, tmp_path)))
    yield dict(bpy.data.objects)
    bpy.ops.wm.read_homefile(use_empty=True)


def measured_line(holder: bpy.types.Object) -> str:
    stale_line(holder)
    return addon.module("ui.deviation_panel").stale_line(bpy.context.scene.ccdepth, holder.data)


def test_depths_are_there_and_hold(opened: dict[str, bpy.types.Object]) -> None:
    settings = bpy.context.scene.ccdepth
    assert (settings.method, settings.vertices, settings.tolerance_mode) == ("CERTIFIED", "CONTROL", "ABSOLUTE")
    small, large, moving = (opened[name] for name in ("Small", "Large", "Moving"))
    record = small.data.ccdepth
    assert (record.faces, record.method, record.vertices, record.deepest) == (6, "CERTIFIED", "CONTROL", 3)
    assert addon.depths(small).tolist() == [3] * 6
    assert (addon.bounds(small) <= record.world_tolerance).all()
    assert stale_line(small) == stale_line(large) == ""
    assert (moving.data.ccdepth.frames, moving.data.ccdepth.worst_frame) == ("1-3", 3)
    set_scene(frames="CUSTOM", frame_list="1-3")
    for frame in (1, 2, 3):
        bpy.context.scene.frame_set(frame)
        assert stale_line(moving) == ""
    large.scale.x = 4.0
    assert stale_line(small) != ""


def test_adaptive_objects_are_there_with_their_sources_and_settings(opened: dict[str, bpy.types.Object]) -> None:
    kept, reduced, in_place = (opened[name] for name in ("Kept Adaptive", "Reduced Adaptive", "In Place"))
    assert (kept.ccdepth.source, kept.ccdepth.keep_updated) == (opened["Kept"], True)
    assert not opened["Kept"].visible_get()
    assert stale_line(kept) == ""
    assert (reduced.ccdepth.reduce, reduced.ccdepth.exact_normals) == (True, True)
    assert reduced.data.ccdepth.unreduced_triangles > len(reduced.data.polygons)
    assert stale_line(reduced) == SETTINGS_LINE
    assert (in_place.data.ccdepth.subdivision, in_place.ccdepth.source) == ("PER_FACE", None)
    for each in (kept, reduced, in_place):
        record = each.data.ccdepth
        assert record.base_faces == 6
        assert addon.bounds(each).max() == np.float32(record.largest_bound) <= record.world_tolerance
    move_vertex(opened["Kept"].data)
    assert stale_line(kept) == SOURCE_LINE
    before = len(kept.data.polygons)
    update(kept)
    assert stale_line(kept) == ""
    assert len(kept.data.polygons) != before or kept.data.ccdepth.largest_bound > 0


def test_measurements_are_there_and_hold(opened: dict[str, bpy.types.Object]) -> None:
    own, kept = opened["Own"], opened["Kept Adaptive"]
    for holder, against in ((own, "Own"), (kept, "Kept")):
        record = holder.data.ccdepth
        assert (record.measurement.measured, record.measurement.against) == (holder.name, against)
        assert addon.deviations(holder).max() <= np.float32(record.deviation)
        assert 0 < record.deviation_reached <= record.deviation
        assert measured_line(holder) == ""
    assert kept.data.ccdepth.measurement.verdict == "MET"
    move_vertex(own.data)
    move_vertex(opened["Kept"].data)
    assert measured_line(own) != ""
    assert measured_line(kept) != ""
