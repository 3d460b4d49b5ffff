# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: their tolerances and angles, names and places, when to switch to them, and that they fit."""

import csv
import json
from math import pi, radians, tan
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests import meshes, thorough
from tests.blender import addon, scene, snapshot
from tests.blender.runs import run, said
from tests.blender.subdividing import faces, refuses, shape
from tests.blender.updating import move_vertex, set_scene, stale_line, update

task = addon.module("tasks.adaptive_task")
distances = addon.module("exchange.switch_distances")


def make_levels(*objects: bpy.types.Object, **settings: object) -> list[bpy.types.Object]:
    """The levels of detail made of the objects, in the order of their names."""
    before = set(bpy.data.objects)
    addon.finish("lods", *objects, **{"tolerance": 0.002, "count": 3, **settings})
    return sorted(set(bpy.data.objects) - before, key=lambda each: each.name)


@pytest.mark.every_blender
def test_each_is_proved_within_its_own_tolerance() -> None:
    source = scene.add_suzanne()
    source.data.shade_smooth()
    source.scale = (1.0, 2.0, 1.5)
    levels = make_levels(source, tolerance=0.004, shading_angle=radians(8))
    assert [each.name for each in levels] == ["Suzanne_LOD0", "Suzanne_LOD1", "Suzanne_LOD2"]
    assert faces(levels[0]) > faces(levels[1]) > faces(levels[2])
    for number, each in enumerate(levels):
        record = each.data.ccdepth
        assert record.world_tolerance == pytest.approx(0.004 * 4**number, rel=1e-6)
        assert record.largest_bound <= record.world_tolerance
        assert record.shading_angle == pytest.approx(radians(min(8 * 2**number, 30)), rel=1e-6)
        # The independent measurement.
        addon.measure(each, tolerance=0.004 * 4**number, time_limit=30)
        assert each.data.ccdepth.measurement.verdict == "MET"


def test_angles_beyond_thirty_degrees_stay() -> None:
    settings = task.AdaptiveSettings(0.01, "ABSOLUTE", True, "ADAPTIVE", 1000, radians(40), radians(25))
    coarser = settings.at_level(task.Level(2, 4.0))
    assert (coarser.tolerance, coarser.shading_angle) == (0.16, pytest.approx(radians(40), rel=1e-6))
    assert coarser.facet_angle == pytest.approx(radians(30), rel=1e-6)
    assert settings.at_level(task.Level(0, 4.0)) == settings


def test_each_set_has_a_collection_beside_its_source() -> None:
    home = bpy.data.collections.new("Home")
    bpy.context.scene.collection.children.link(home)
    cube, plain = scene.add_object(meshes.cube(), "Cube"), scene.add_object(meshes.cube(), "Plain")
    home.objects.link(cube)
    bpy.context.scene.collection.objects.unlink(cube)
    levels = make_levels(cube, plain, count=2)
    assert [each.name for each in levels] == ["Cube_LOD0", "Cube_LOD1", "Plain_LOD0", "Plain_LOD1"]
    assert [[other.name for other in each.users_collection] for each in levels] == [["Cube LODs"]] * 2 + [
        ["Plain LODs"]
    ] * 2
    assert [each.name for each in home.children] == ["Cube LODs"]
    assert cube.name in bpy.data.objects
    assert cube.hide_get()
    # One of them is shown and rendered in place of the source, before and after.
    for _ in range(2):
        assert [each.visible_get() for each in levels] == [True, False, True, False]
        assert [each.select_get() for each in levels] == [True, False, True, False]
        assert [each.hide_render for each in levels] == [False, True, False, True]
        assert bpy.ops.ccdepth.before_after() == {"FINISHED"}
        assert [each.visible_get() for each in (cube, plain, *levels)] == [True] * 2 + [False] * 4
        assert bpy.ops.ccdepth.before_after() == {"FINISHED"}


def test_one_level_is_what_apply_makes() -> None:
    source = scene.add_suzanne()
    addon.finish("subdivide", source, tolerance=0.01)
    [applied] = bpy.context.selected_objects
    source.hide_set(False)
    [level] = make_levels(source, tolerance=0.01, count=1)
    np.testing.assert_array_equal(shape(level), shape(applied))


def test_the_distance_is_that_of_a_pixel() -> None:
    """Seen from there, the proved distance covers a pixel in the middle of the view; independently by Blender's
    projection matrix."""
    source = scene.add_object(meshes.landscape(4, 3))
    source.scale = (2.0, 2.0, 2.0)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 1600, 900, 50
    camera.data.angle = radians(60)
    for fit in ("HORIZONTAL", "VERTICAL"):
        camera.data.sensor_fit = fit
        source.hide_set(False)
        for each in make_levels(source, count=2):
            graph = bpy.context.evaluated_depsgraph_get()
            matrix = np.array(camera.calc_matrix_camera(graph, x=800, y=450))
            error, distance = each["ccdepth_error"], each["ccdepth_distance"]
            assert error == each.data.ccdepth.largest_bound > 0
            above = matrix @ [0.0, error, -distance, 1.0]
            # Projected, the view is from -1 to 1; lengths are in single precision.
            assert above[1] / above[3] * 450 / 2 == pytest.approx(1.0, rel=1e-5)
            middle = np.array([each.matrix_world @ v.co for v in each.data.vertices])
            sphere = np.linalg.norm(np.ptp(middle, axis=0)) / 2
            edge = matrix @ [0.0, sphere, -distance - sphere, 1.0]
            assert each["ccdepth_screen_size"] == pytest.approx(edge[1] / edge[3], rel=1e-4)


def test_numbers_take_the_place_of_a_camera() -> None:
    source = scene.add_object(meshes.cube(), "Cube")
    bpy.context.scene.camera = None
    [level] = make_levels(source, count=1)
    height = bpy.context.scene.render.resolution_y
    assert level["ccdepth_distance"] == pytest.approx(level["ccdepth_error"] * height / (2 * tan(radians(25))))
    set_scene(view_angle=pi / 2, view_height=100)
    update(level, tolerance=0.002)
    assert level["ccdepth_distance"] == pytest.approx(level["ccdepth_error"] * 50, rel=1e-6)


@pytest.mark.every_blender
def test_update_makes_the_whole_set_anew() -> None:
    set_scene(tolerance=0.002)
    source = scene.add_suzanne()
    levels = make_levels(source)
    before = [shape(each) for each in levels]
    errors = [each["ccdepth_error"] for each in levels]
    assert not any(map(stale_line, levels))
    move_vertex(source.data)
    assert all(stale_line(each).startswith("Out of date: “Suzanne”") for each in levels)
    set_scene(tolerance=0.004)
    update(levels[1])
    assert sorted(each.name for each in bpy.data.objects if each != source) == [each.name for each in levels]
    assert not any(map(stale_line, levels))
    assert all(len(one) != len(shape(each)) for one, each in zip(before, levels, strict=True))
    for number, (error, each) in enumerate(zip(errors, levels, strict=True)):
        assert each.data.ccdepth.world_tolerance == pytest.approx(0.004 * 4**number, rel=1e-6)
        assert each["ccdepth_error"] != error


def test_reduce_counts_for_every_level() -> None:
    levels = make_levels(scene.add_object(meshes.landscape(4, 3)), count=2, tolerance=0.01, reduce=True)
    assert all(each.data.ccdepth.unreduced_triangles > faces(each) for each in levels)


def test_a_tolerance_beyond_the_mesh_makes_its_own_faces() -> None:
    cube = scene.add_object(meshes.cube(), "Cube")
    levels = make_levels(cube, count=4, tolerance=1.0, step=1000.0, shading_angle=0.0)
    assert [faces(each) for each in levels] == [6] * 4
    assert not any(each.data.validate() for each in levels)


def corners(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The positions, the UVs and the tangents of the corners of triangles, (C, 3), (C, 2), (C, 3)."""
    mesh.calc_tangents(uvmap=mesh.uv_layers.active.name)
    positions = np.array([mesh.vertices[loop.vertex_index].co for loop in mesh.loops])
    tangents = np.array([loop.tangent for loop in mesh.loops])
    return positions, scene.read(mesh, mesh.uv_layers.active.name), tangents


@pytest.mark.parametrize("level", thorough.each([1, 2], [1]))
def test_seams_and_tangents_agree(level: int) -> None:
    """On both sides of every seam, and everywhere else, a corner of a coarser level has a corner of the finest one
    beside it, with about its UV and its tangent."""
    bpy.ops.mesh.primitive_torus_add(major_segments=8, minor_segments=6, generate_uvs=True)
    source = bpy.context.object
    bpy.ops.object.shade_smooth()
    source.modifiers.new("Subdivision", "SUBSURF").uv_smooth = "PRESERVE_BOUNDARIES"
    levels = make_levels(source, tolerance=0.0005, shading_angle=radians(3))
    (fine, fine_uvs, fine_tangents), (coarse, uvs, tangents) = corners(levels[0].data), corners(levels[level].data)
    # In the (u, v, 6 positions) space corners on two sides of a seam are far from each other.
    here, there = np.hstack([coarse, uvs]), np.hstack([fine, fine_uvs])
    apart, nearest = pytest.importorskip("scipy.spatial").cKDTree(there).query(here)
    # The finest level has edges of this length at most in this space.
    assert apart.max() < 0.05
    assert np.all((tangents * fine_tangents[nearest]).sum(axis=1) > np.cos(radians(15)))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"count": 0}, "There can be 1 to 16 levels of detail, not 0"),
        ({"count": 17}, "There can be 1 to 16 levels of detail, not 17"),
        ({"step": 1.0}, "The step must be more than 1, and at most 1000; it is 1"),
        ({"step": -2.0}, "The step must be more than 1"),
        ({"step": float("nan")}, "The step must be more than 1"),
        ({"tolerance": 0.0}, "must be greater than zero"),
        ({"tolerance": 1e30, "step": 1000.0, "count": 16}, "too large"),
        ({"max_faces": 10, "tolerance": 0.001}, "10 are allowed"),
    ],
)
def test_bad_input_is_refused_in_a_line(settings: dict[str, object], message: str) -> None:
    refuses("lods", message, scene.add_object(meshes.cube(), "Cube"), **{"tolerance_mode": "ABSOLUTE", **settings})


def test_results_and_hidden_objects_are_refused() -> None:
    source = scene.add_object(meshes.cube(), "Cube")
    levels = make_levels(source)
    refuses("lods", "it was made by subdivision already; select the object it came from", levels[0])
    with addon.edit_mode(levels[0]), snapshot.unchanged():
        assert not bpy.ops.ccdepth.lods.poll()


def test_nothing_is_made_when_a_coarser_level_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even the finer levels that were there."""
    making = addon.module("operators.adaptive_operator")
    made = making.make_meshes

    def fail_at_the_last(context: object, answers: list, settings: object, **others: object) -> object:
        if settings.tolerance > 0.02:
            raise addon.module("tasks.surfaces").ComputeError("no more")
        return made(context, answers, settings, **others)

    monkeypatch.setattr(making, "make_meshes", fail_at_the_last)
    refuses("lods", "no more", scene.add_suzanne(), tolerance=0.002, tolerance_mode="ABSOLUTE", count=3)


def read(path: Path) -> dict[str, bpy.types.Object]:
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        (bpy.ops.wm.fbx_import if hasattr(bpy.types, "WM_OT_fbx_import") else bpy.ops.import_scene.fbx)(
            filepath=str(path)
        )
    return {each.name: each for each in bpy.data.objects}


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", thorough.each([".glb", ".fbx", ".blend"], [".glb", ".fbx"]))
def test_the_command_line_writes_a_set_with_a_certificate(tmp_path: Path, suffix: str) -> None:
    bpy.context.scene.unit_settings.scale_length = 0.01
    for name in ("One", "Two"):
        scene.add_object(meshes.landscape(4, 3), name)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    output, report, table = tmp_path / f"out{suffix}", tmp_path / "report.json", tmp_path / "table.csv"
    line = ["--lods", "2", "--lod-step", "3", "--tolerance", "1%", "--view-angle", "40", "--view-height", "720"]
    assert run(tmp_path / "two.blend", *line, "--output", output, "--json", report, "--csv", table) == 0
    assert run("--verify", report) == 0
    entries = json.loads(report.read_text(encoding="utf-8"))["files"][0]["objects"]
    assert [each["result"] for each in entries] == ["One_LOD0", "Two_LOD0", "One_LOD1", "Two_LOD1"]
    assert entries[2]["tolerance"] == pytest.approx(3 * entries[0]["tolerance"], rel=1e-6)
    assert all(each["met"] for each in entries)
    with table.open() as rows:
        assert [float(row["lod_distance_m"]) for row in csv.DictReader(rows)] == [e["lod_distance"] for e in entries]
    found = read(output) if suffix != ".blend" else {}
    for each in entries:
        assert each["lod_distance"] == pytest.approx(each["proved"] * 720 / (2 * tan(radians(20))), rel=1e-6)
        if found:
            holder = found[each["result"]]
            # The file is in metres, where the scene is in centimetres.
            assert holder["ccdepth_distance"] == pytest.approx(each["lod_distance"], rel=1e-6)
            assert holder["ccdepth_error"] == pytest.approx(each["proved"], rel=1e-6)
            assert holder.parent.name == f"{each['name']} LODs"
    if suffix == ".fbx":
        assert output.read_bytes().count(b"LodGroup") >= 2


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["--lods", "17"], "There can be 1 to 16 levels of detail, not 17"),
        (["--lods", "2", "--lod-step", "1"], "The step must be more than 1, and at most 1000; it is 1"),
    ],
)
def test_the_command_line_refuses_bad_numbers(
    tmp_path: Path, line: list[str], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert message in said(capfd, *line, "--output", tmp_path / "out.glb", status=1)
    assert not [*tmp_path.iterdir()]


def test_the_table_rounds_to_the_side_that_holds() -> None:
    [level] = make_levels(scene.add_object(meshes.cube(), "Cube"), count=1)
    texts = addon.module("ui.levels_panel").switch_texts
    switch = distances.Switch(0, 0.00123401, 12.3401, 0.09999)
    faces_text = f"{faces(level):,}"
    assert texts(bpy.context.scene, level, switch) == ("0", faces_text, "0.0013 m", "13 m", "9.9 %")
