# SPDX-License-Identifier: GPL-3.0-or-later
"""Tolerances at the press of a button: one that fits the Face Limit, and presets."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from tests.blender import addon, scene
from tests.blender.subdividing import faces, known_count, subdivide
from tests.blender.updating import made_result, set_scene


@pytest.mark.parametrize("mode", ["RELATIVE", "ABSOLUTE"])
def test_a_refusal_offers_a_tolerance_that_fits(mode: str) -> None:
    settings = bpy.context.scene.ccdepth
    holder = scene.add_suzanne()
    settings.tolerance_mode, settings.max_faces = mode, 4_000
    settings.tolerance = settings.relative_tolerance = 1e-6
    addon.select(holder)
    with pytest.raises(RuntimeError, match=r"4,000 are allowed; a tolerance of .* would fit"):
        bpy.ops.ccdepth.subdivide()
    bpy.context.view_layer.update()
    fitting = known_count(holder).fitting
    other = settings.relative_tolerance if mode == "ABSOLUTE" else settings.tolerance
    assert bpy.ops.ccdepth.use_tolerance(tolerance=fitting) == {"FINISHED"}
    assert known_count(holder) is None
    assert other == (settings.relative_tolerance if mode == "ABSOLUTE" else settings.tolerance)
    assert bpy.ops.ccdepth.subdivide() == {"FINISHED"}
    assert 1_000 < faces(bpy.context.active_object) <= 4_000


def test_a_refused_update_offers_one_as_well() -> None:
    _, result = made_result()
    set_scene(tolerance=1e-5, max_faces=2_000)
    addon.select(result)
    with pytest.raises(RuntimeError, match="would fit"):
        bpy.ops.ccdepth.update()
    bpy.context.view_layer.update()
    bpy.ops.ccdepth.use_tolerance(tolerance=known_count(result).fitting)
    assert bpy.ops.ccdepth.update() == {"FINISHED"}
    assert faces(result) <= 2_000


def test_a_count_of_a_result_is_forgotten_when_its_source_changes() -> None:
    source, result = made_result()
    source.hide_set(False)
    addon.select(result)
    bpy.ops.ccdepth.count_faces()
    assert known_count(result) is not None
    source.data.vertices[0].co.x += 0.1
    source.data.update()
    bpy.context.view_layer.update()
    assert known_count(result) is None


def test_a_bad_tolerance_is_not_taken() -> None:
    before = bpy.context.scene.ccdepth.relative_tolerance
    for tolerance in (0.0, -1.0, float("nan")):
        with pytest.raises(RuntimeError, match="tolerance"):
            bpy.ops.ccdepth.use_tolerance(tolerance=tolerance)
    assert bpy.context.scene.ccdepth.relative_tolerance == before


def presets() -> dict[str, str]:
    """The files of all presets there are, by the names that are shown."""
    folders = bpy.utils.preset_paths("ccdepth/tolerance")
    paths = [str(path) for folder in folders for path in sorted(Path(folder).glob("*.py"))]
    return {bpy.path.display_name(Path(path).name): path for path in paths}


def choose(path: str) -> None:
    bpy.ops.script.execute_preset(filepath=path, menu_idname="CCDEPTH_PT_tolerance_presets")


@pytest.mark.every_blender
def test_there_are_presets_from_coarse_to_fine() -> None:
    settings = bpy.context.scene.ccdepth
    found = presets()
    assert set(found) == {"Draft", "Standard", "Fine", "Print 0.1 mm"}
    tolerances = []
    for name in ("Draft", "Standard", "Fine"):
        settings.tolerance_mode = "ABSOLUTE"
        choose(found[name])
        assert settings.tolerance_mode == "RELATIVE"
        tolerances.append(settings.relative_tolerance)
    assert tolerances == sorted(tolerances, reverse=True)
    assert tolerances[1] == settings.bl_rna.properties["relative_tolerance"].default


@pytest.mark.parametrize(("scale", "tolerance"), [(1.0, 0.0001), (0.001, 0.1)])
def test_the_preset_for_printing_is_a_tenth_of_a_millimetre_in_any_unit(scale: float, tolerance: float) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    choose(presets()["Print 0.1 mm"])
    settings = bpy.context.scene.ccdepth
    assert (settings.tolerance_mode, settings.tolerance) == ("ABSOLUTE", pytest.approx(tolerance))


@pytest.mark.every_blender
def test_presets_of_ones_own_are_added_and_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bpy.utils, "user_resource", lambda *_, path="", **__: str(tmp_path / path))
    monkeypatch.setattr(bpy.utils, "preset_paths", lambda folder: [str(tmp_path / "presets" / folder)])
    (tmp_path / "presets/ccdepth/tolerance").mkdir(parents=True)
    set_scene(tolerance=0.123, relative_tolerance=0.0456, tolerance_mode="RELATIVE")
    assert bpy.ops.ccdepth.tolerance_preset_add(name="Mine") == {"FINISHED"}
    set_scene(tolerance=1.0, relative_tolerance=1.0)
    choose(str(tmp_path / "presets/ccdepth/tolerance/Mine.py"))
    settings = bpy.context.scene.ccdepth
    assert (settings.tolerance_mode, settings.relative_tolerance) == ("RELATIVE", pytest.approx(0.0456))
    assert settings.tolerance == pytest.approx(0.123)
    assert bpy.ops.ccdepth.tolerance_preset_add(name="Mine", remove_name=True) == {"FINISHED"}
    assert not list((tmp_path / "presets/ccdepth/tolerance").iterdir())


def test_a_preset_makes_a_result_out_of_date() -> None:
    bpy.context.scene.ccdepth.tolerance_mode = "RELATIVE"
    choose(presets()["Draft"])
    settings = bpy.context.scene.ccdepth
    [result] = subdivide(scene.add_suzanne(), tolerance=settings.relative_tolerance, tolerance_mode="RELATIVE")
    changed = addon.module("state.result_record").settings_have_changed
    assert not changed(result, settings)
    choose(presets()["Fine"])
    assert changed(result, settings)
