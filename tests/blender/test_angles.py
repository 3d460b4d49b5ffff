# SPDX-License-Identifier: GPL-3.0-or-later
"""The shading angle and the facet angle: what is stored, told, counted and refused."""

import json
from math import degrees, inf, nan, radians
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene, snapshot
from tests.blender.runs import few_samples, outputs, printed, said, save
from tests.blender.subdividing import faces, known_count, refused, subdivide

# A distance at which the angles decide on these meshes.
ROUGH = 0.2

ANGLE = radians(4)

# Settings, attributes and normals are in single precision.
ROUNDING = 3e-6


def smooth(data: meshes.MeshData, name: str = "Mesh") -> bpy.types.Object:
    holder = scene.add_object(data, name)
    holder.data.shade_smooth()
    return holder


def corner_normals(holder: bpy.types.Object) -> np.ndarray:
    found: np.ndarray = scene.values_of(holder.data.corner_normals, "vector", np.float32, 3)
    return found


@pytest.mark.every_blender
def test_normals_and_angles_are_stored() -> None:
    holder = smooth(meshes.landscape(4, 4))
    holder.data.polygons[0].use_smooth = False
    [plain] = subdivide(holder, tolerance=ROUGH, shading_angle=0.0)
    assert not plain.data.has_custom_normals
    assert "ccdepth_angle" not in plain.data.attributes
    [made] = subdivide(holder, tolerance=ROUGH, shading_angle=ANGLE, facet_angle=2 * ANGLE)
    assert faces(made) > faces(plain)
    record, angles = made.data.ccdepth, scene.read(made.data, "ccdepth_angle")[:, 0]
    is_smooth = np.array([polygon.use_smooth for polygon in made.data.polygons])
    assert 0 < record.largest_shading_angle <= record.shading_angle == pytest.approx(ANGLE)
    assert 0 < record.largest_facet_angle <= record.facet_angle == pytest.approx(2 * ANGLE)
    assert record.largest_shading_angle == angles[is_smooth].max()
    assert record.largest_facet_angle == angles[~is_smooth].max()
    # Triangles and stored normals are apart where the surface bends; flat faces show their own.
    sizes = [polygon.loop_total for polygon in made.data.polygons]
    own = np.repeat(scene.values_of(made.data.polygons, "normal", np.float32, 3), sizes, axis=0)
    turned = np.linalg.norm(corner_normals(made) - own, axis=1)
    assert turned[np.repeat(~is_smooth, sizes)].max() < ROUNDING < 0.01 < turned[np.repeat(is_smooth, sizes)].max()
    told, allowed = addon.facts(made)["Shading Angle"].split(" of ")
    assert allowed == "4°"
    assert 0 <= float(told.removesuffix("°")) - degrees(record.largest_shading_angle) < 1e-3


@pytest.mark.every_blender
@pytest.mark.parametrize("has_groups", [False, True])
def test_normals_are_those_of_the_surface_in_the_object_s_space(
    has_groups: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder = smooth(meshes.torus(8, 6))
    holder.scale, holder.rotation_euler = (1.0, -0.5, 2.0), (0.3, 0.5, 0.7)
    if has_groups:
        holder.vertex_groups.new(name="Group").add([0], 1.0, "REPLACE")
    [made] = subdivide(holder, tolerance=0.01, shading_angle=ANGLE)
    # The same mesh with the normals that are computed for it in its own space.
    placing = addon.module("operators.place_results")
    new_mesh = placing.new_mesh
    monkeypatch.setattr(placing, "new_mesh", lambda *arguments, normals, **others: new_mesh(*arguments, **others))
    [other] = subdivide(holder, tolerance=0.01, shading_angle=ANGLE)
    # Normals stored as angles have 16 bits.
    np.testing.assert_allclose(corner_normals(made), corner_normals(other), atol=1e-3 if has_groups else 1e-5, rtol=0)


@pytest.mark.parametrize("setting", ["shading_angle", "facet_angle"])
@pytest.mark.parametrize("angle", [-0.01, radians(90), inf, nan])
def test_other_angles_are_refused(setting: str, angle: float) -> None:
    refused(smooth(meshes.cube()), match="0° or more, and less than 90°", **{setting: angle})


def test_angles_beyond_the_face_limit_are_refused_with_angles_that_fit() -> None:
    holder = smooth(meshes.landscape(4, 4))
    alone, limit = faces(*subdivide(holder, tolerance=ROUGH, shading_angle=0.0)), 100
    holder.hide_set(False)
    told = r"shading angle of [\d.]+° would fit"
    refused(holder, match=told, tolerance=ROUGH, shading_angle=radians(1), max_faces=limit)
    count = known_count_with(holder, shading_angle=radians(1), tolerance=ROUGH, max_faces=limit)
    assert count.are_too_many
    assert count.by_distance == alone <= limit < count.faces
    fitting = count.fitting.shading_angle
    assert alone < faces(*subdivide(holder, tolerance=ROUGH, shading_angle=fitting, max_faces=limit)) <= limit
    # One step less is too much.
    holder.hide_set(False)
    refused(holder, match="faces", tolerance=ROUGH, shading_angle=fitting / 1.25, max_faces=limit)
    finer = faces(*subdivide(holder, tolerance=ROUGH / 4, shading_angle=0.0))
    told = f"while the distance alone needs about {finer}"
    holder.hide_set(False)
    refused(holder, match=told, tolerance=ROUGH / 4, shading_angle=radians(1), max_faces=finer - 1)


def known_count_with(holder: bpy.types.Object, **settings: Any) -> Any:
    for name, value in {"tolerance_mode": "ABSOLUTE", **settings}.items():
        setattr(bpy.context.scene.ccdepth, name, value)
    addon.finish("count_faces", holder)
    return known_count(holder)


def test_the_cost_of_angles_is_counted() -> None:
    holder = smooth(meshes.landscape(4, 4))
    count = known_count_with(holder, tolerance=ROUGH, shading_angle=ANGLE)
    assert count.by_distance == faces(*subdivide(holder, tolerance=ROUGH, shading_angle=0.0))
    # What is not set comes from the scene.
    [made] = subdivide(holder, tolerance=ROUGH)
    assert count.faces == faces(made) > count.by_distance
    # So it does for Update Result.
    bpy.context.scene.ccdepth.shading_angle = 0.0
    assert addon.module("state.result_record").settings_have_changed(made, bpy.context.scene.ccdepth)
    addon.finish("update", made)
    assert faces(made) == count.by_distance
    # Flat faces cost nothing.
    holder.data.shade_flat()
    assert known_count_with(holder, shading_angle=ANGLE).by_distance is None


def test_a_tolerance_that_is_found_comes_with_its_angles() -> None:
    holder, settings = smooth(meshes.landscape(3, 3)), bpy.context.scene.ccdepth
    settings.tolerance_mode, settings.tolerance, settings.shading_angle = "ABSOLUTE", ROUGH, ANGLE
    addon.finish("find_tolerance", holder, face_budget=600)
    ratio = settings.tolerance / ROUGH
    assert ratio < 1
    assert settings.shading_angle == pytest.approx(ANGLE * ratio**0.5, rel=ROUNDING)
    count = known_count(holder)
    assert 0.9 * 600 < count.faces == faces(*subdivide(holder, tolerance=settings.tolerance)) <= 600
    # Angles end below a right angle.
    settings.tolerance, settings.shading_angle = 1e-5, ANGLE
    addon.finish("find_tolerance", holder, face_budget=10)
    assert settings.shading_angle < radians(90)


@pytest.mark.parametrize(("scale", "meshes_made"), [((2.0, 2.0, 2.0), 1), ((1.0, 1.0, 2.0), 2)])
def test_uneven_scales_do_not_share_a_mesh(scale: tuple[float, float, float], meshes_made: int) -> None:
    holder = smooth(meshes.cube())
    other = scene.add_object(meshes.cube(), "Other")
    other.data, other.scale = holder.data, scale
    for angle, expected in ((ANGLE, meshes_made), (0.0, 1)):
        made = subdivide(holder, other, tolerance=ROUGH, shading_angle=angle)
        assert len({each.data for each in made}) == expected


def test_a_reduced_mesh_tells_no_proved_angle() -> None:
    [made] = subdivide(smooth(meshes.landscape(4, 4)), tolerance=ROUGH, shading_angle=ANGLE, reduce=True)
    assert made.data.has_custom_normals
    assert "ccdepth_angle" not in made.data.attributes
    assert not made.data.ccdepth.shading_angle


@pytest.mark.every_blender
@pytest.mark.parametrize("has_groups", [False, True])
def test_exact_normals_can_be_removed(has_groups: bool) -> None:
    holder = smooth(meshes.cube())
    assert not bpy.ops.ccdepth.remove_normals.poll()
    if has_groups:
        holder.vertex_groups.new(name="Group").add([0], 1.0, "REPLACE")
    made, other = (subdivide(holder, tolerance=ROUGH, shading_angle=ANGLE)[0] for _ in range(2))
    before = scene.mesh_data(made.data).positions
    addon.finish("remove_normals", made)
    assert not made.data.has_custom_normals
    assert other.data.has_custom_normals
    assert "ccdepth_angle" not in made.data.attributes
    assert not made.data.ccdepth.shading_angle
    np.testing.assert_array_equal(scene.mesh_data(made.data).positions, before)
    # Its distances still hold.
    assert made.data.ccdepth.largest_bound > 0


def test_the_heat_map_shows_angles() -> None:
    heat_map, legend = addon.module("state.heat_map"), addon.module("ui.legend_contents").legend
    [made] = subdivide(smooth(meshes.landscape(4, 4)), tolerance=ROUGH, shading_angle=ANGLE)
    kind, settings = heat_map.Shown.ANGLE, bpy.context.scene.ccdepth
    settings.distance_range, settings.distance_top = "FIXED", 100.0
    assert heat_map.has_shown(made.data, kind)
    assert heat_map.top(kind, heat_map.tolerance_of(made.data, kind), settings) == pytest.approx(ANGLE)
    found = legend(bpy.context.scene, kind, [made])
    assert (found.title, found.notes[0], found.has_beyond) == ("Proved Angle (°)", "for 4°", False)
    assert [mark.number for mark in found.marks] == ["0", "1", "2", "3", "4"]
    addon.finish("compute", made, tolerance=ROUGH)
    assert not heat_map.has_shown(made.data, kind)


def test_presets_have_angles() -> None:
    module, settings = addon.module("ui.tolerances"), bpy.context.scene.ccdepth
    found = {}
    for preset in module.presets(bpy.context.scene):
        bpy.ops.ccdepth.use_preset(name=preset.name)
        found[preset.name] = [round(degrees(each), 3) for each in (settings.shading_angle, settings.facet_angle)]
    shown = {"Draft": [10, 0], "Game LOD0": [10, 0], "Standard": [5, 0], "Fine": [2, 0], "Render Close-Up": [1, 0]}
    assert found == {**shown, "Print 0.1 mm": [0, 15], "Print 0.05 mm": [0, 10], "CAD Exchange": [0, 10]}
    names = {*addon.module("state.properties").PRESET_SETTINGS, "shown_tolerance_mode"}
    with snapshot.unchanged(lambda path: path[-1] in names):
        bpy.ops.ccdepth.use_preset(name="Standard")


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", [".obj", ".stl"])
def test_the_command_line_takes_angles_in_degrees(
    suffix: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    few_samples(monkeypatch)
    smooth(meshes.landscape(2, 2))
    file, output, report = save(tmp_path / "hills.blend"), tmp_path / f"hills{suffix}", tmp_path / "report.json"
    arguments = (file, "--subdivide", "--tolerance", ROUGH, "--absolute", "--output", output, "--json", report)
    arguments += ("--shading-angle", 4, "--facet-angle", 20, "--html", tmp_path / "page.html")
    out, err = outputs(capfd, *arguments)
    [entry] = json.loads(report.read_text())["files"][0]["objects"]
    has_normals, page = suffix == ".obj", (tmp_path / "page.html").read_text()
    # Without normals in the file only the facets count.
    lost = "the shading angle (the format has no normals)"
    assert (lost not in err) == (lost not in page) == has_normals
    name, word = ("proved_shading", "Shading") if has_normals else ("proved_facets", "Facet")
    assert entry["settings"]["shading_angle"] == pytest.approx(radians(4) if has_normals else 0)
    assert entry["settings"]["facet_angle"] == pytest.approx(radians(20))
    assert {each for each in ("proved_shading", "proved_facets") if entry[each] is not None} == {name}
    assert f"{word} Angle: " in out
    assert f"Proved {word.lower()} angle, at most" in page
    printed(capfd, "--verify", report)
    forged = report.read_text().replace(f'"{name}": {entry[name]}', f'"{name}": 0.4')
    report.write_text(forged)
    assert f"{name} 0.4, beyond its" in printed(capfd, "--verify", report, status=1)


@pytest.mark.parametrize("angle", ["-1", "90", "nan", "5deg"])
def test_the_command_line_refuses_other_angles(angle: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert "angle" in said(capfd, "--subdivide", f"--shading-angle={angle}", status=2)
