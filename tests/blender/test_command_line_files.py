# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line's files: which are read and written, how long their units are, and what stays untouched."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.command_line_runs import run, save, save_cubes
from tests.blender.test_command_line import depths_in

amounts = addon.module("command_line.amounts")
mesh_files = addon.module("command_line.mesh_files")
blender_calls = addon.module("command_line.blender_calls")

LIMIT = ["--tolerance", "0.05", "--absolute", "--method", "certified"]


def read(path: Path) -> None:
    """Import a file by Blender's own means into an empty file of metres."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    if path.suffix == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(path))
    elif path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    elif path.suffix.startswith(".usd"):
        bpy.ops.wm.usd_import(filepath=str(path))
    else:
        getattr(bpy.ops.wm, f"{path.suffix[1:]}_import")(filepath=str(path))
    bpy.context.view_layer.update()


def box() -> np.ndarray:
    """(2, 3): the least and the largest coordinates of all that is visible, as it shows."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = [each.evaluated_get(depsgraph) for each in bpy.data.objects if each.type == "MESH" and each.visible_get()]
    corners = [each.matrix_world @ vertex.co for each in shown for vertex in each.data.vertices]
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


def writable(suffix: str) -> bool:
    return suffix == ".blend" or blender_calls.available(mesh_files.WRITERS[suffix]) is not None


@pytest.mark.parametrize(
    ("text", "value", "unit", "mode"),
    [
        ("0.001", 0.001, None, None),
        ("1e-3", 0.001, None, None),
        ("0.1mm", 0.1, 0.001, "ABSOLUTE"),
        ("0.1 mm", 0.1, 0.001, "ABSOLUTE"),
        ("2m", 2.0, 1.0, "ABSOLUTE"),
        ("5um", 5.0, 1e-6, "ABSOLUTE"),
        ("5µm", 5.0, 1e-6, "ABSOLUTE"),
        ("0.01in", 0.01, 0.0254, "ABSOLUTE"),
        ("1thou", 1.0, 0.0000254, "ABSOLUTE"),
        ("0.1%", 0.001, None, "RELATIVE"),
    ],
)
def test_tolerances_as_typed(text: str, value: float, unit: float | None, mode: str | None) -> None:
    typed = amounts.typed_tolerance(text)
    assert (typed.value, typed.unit, typed.mode) == (pytest.approx(value), unit, mode)


@pytest.mark.parametrize(("text", "faces"), [("50000", 50_000), ("50k", 50_000), ("1.5M", 1_500_000), ("2", 2)])
def test_numbers_of_faces_as_typed(text: str, faces: int) -> None:
    assert amounts.face_budget(text) == faces


@pytest.mark.parametrize(("scale", "expected"), [(1.0, 0.002), (0.001, 2.0), (0.01, 0.2)])
def test_a_tolerance_with_a_unit_is_that_long_whatever_the_unit_of_the_scene(
    tmp_path: Path, scale: float, expected: float
) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    assert run(path, "--tolerance", "2mm", "--output", tmp_path / "out.blend") == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    assert bpy.data.objects["Cube"].data.ccdepth.world_tolerance == pytest.approx(expected)


def test_a_file_in_millimetres_keeps_its_numbers_and_knows_their_length(tmp_path: Path) -> None:
    """A bare number is what it has always been, and one with a unit is that long."""
    scene.clear()
    addon.select(scene.add_object(meshes.cube()))
    bpy.ops.wm.stl_export(filepath=str(tmp_path / "cube.stl"))
    for tolerance, unit, expected in (("0.05", None, 0.05), ("50um", None, 0.05), ("50mm", "m", 0.05)):
        line = [tmp_path / "cube.stl", "--absolute", "--tolerance", tolerance, *(["--unit", unit] if unit else [])]
        assert run(*line, "--output", tmp_path / "out.blend", "--overwrite") == 0
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
        [cube] = bpy.data.objects
        assert cube.data.ccdepth.world_tolerance == pytest.approx(expected)
        assert cube.dimensions[:] == pytest.approx((2.0, 2.0, 2.0))


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".glb", ".usdc"])
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_what_is_written_has_the_size_and_the_place_of_the_scene(
    tmp_path: Path, suffix: str, scale: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"out{suffix}"
    if not writable(suffix):
        assert run("--subdivide", "--output", path) == 1
        assert f"this Blender cannot write {suffix} files" in capfd.readouterr().err
        return
    bpy.context.scene.unit_settings.scale_length = scale
    scene.clear()
    # Mirrored, sheared and beside another one with a name that not every format takes.
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (-1.0, 2.0, 1.0)
    for index, name in enumerate(("Würfel Nr. 1", "Cube.001")):
        cube = scene.add_object(meshes.cube(), name)
        cube.parent = parent
        cube.location.x, cube.rotation_euler.z = 4.0 * index, 0.5
    source = save(tmp_path / "mesh.blend")
    assert run(source, "--subdivide", *LIMIT, "--output", tmp_path / "out.blend") == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    expected = box() * scale
    report = tmp_path / "report.json"
    assert run(source, "--subdivide", *LIMIT, "--output", path, "--json", report) == 0
    assert f"Written: {path}" in capfd.readouterr().out
    assert {each.name for each in tmp_path.iterdir()} == {"mesh.blend", "out.blend", "report.json", path.name}
    read(path)
    in_file = 1000.0 if suffix == ".stl" else 1.0
    np.testing.assert_allclose(box(), expected * in_file, rtol=1e-5, atol=1e-5 * in_file)
    assert not [each.name for mesh in bpy.data.meshes for each in mesh.attributes if "ccdepth" in each.name]
    # Faces look outwards: the file holds as much volume as two cubes do.
    assert sum(map(volume, bpy.data.objects)) > 0


def volume(holder: bpy.types.Object) -> float:
    import bmesh

    if holder.type != "MESH":
        return 0.0
    shape = bmesh.new()
    shape.from_mesh(holder.data)
    signed = shape.calc_volume(signed=True)
    shape.free()
    return signed


def test_glb_files_come_together_where_they_were_split(tmp_path: Path) -> None:
    """A cube with flat faces has 24 vertices in such a file, and its limit surface would be six flat discs."""
    scene.clear()
    addon.select(scene.add_object(meshes.cube()))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "cube.glb"), use_selection=True)
    assert run(tmp_path / "cube.glb", *LIMIT, "--output", tmp_path / "out.blend") == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    [cube] = [each for each in bpy.data.objects if each.type == "MESH"]
    assert (len(cube.data.vertices), len(cube.data.polygons)) == (8, 12)


@pytest.mark.parametrize(
    ("suffix", "writer", "options"),
    [
        (".fbx", "export_scene.fbx", {"use_selection": True}),
        (".abc", "wm.alembic_export", {"selected": True, "as_background_job": False}),
    ],
)
def test_formats_that_are_read_alone_give_the_depths_of_the_blend_file(
    tmp_path: Path, suffix: str, writer: str, options: dict[str, Any]
) -> None:
    """With a tolerance of 5 mm, so that the size and the axes have to come along as well."""
    write = blender_calls.available(writer)
    if write is None:
        pytest.skip(f"this Blender cannot write {suffix} files")
    scene.clear()
    suzanne = scene.add_suzanne()
    suzanne.location, suzanne.rotation_euler, suzanne.scale = (3.0, 1.0, -2.0), (0.3, 0.5, 0.7), (2.0, 1.0, 0.5)
    addon.select(suzanne)
    source = save(tmp_path / "suzanne.blend")
    path = tmp_path / f"suzanne{suffix}"
    write(filepath=str(path), **options)
    line = ("--tolerance", "5mm", "--method", "certified", "--output", tmp_path / "out.blend", "--overwrite")
    assert run(source, *line) == 0
    [expected] = depths_in(tmp_path / "out.blend").values()
    assert run(path, *line) == 0
    [depths] = depths_in(tmp_path / "out.blend").values()
    assert depths == expected
    assert len(set(depths)) > 2


def test_chosen_objects_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = save_cubes(tmp_path / "cubes.blend", "One", "-Two", "Three")
    collection = bpy.data.collections.new("Some")
    bpy.context.scene.collection.children.link(collection)
    for name in ("One", "-Two"):
        collection.objects.link(bpy.data.objects[name])
    for name in ("Empty", "Excluded"):
        bpy.context.scene.collection.children.link(bpy.data.collections.new(name))
    bpy.data.collections["Excluded"].objects.link(scene.add_object(meshes.cube(), "Four"))
    bpy.context.scene.collection.objects.unlink(bpy.data.objects["Four"])
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    save(path)
    for line, expected in (
        (["--objects", "One", "Three"], {"One", "Three"}),
        (["--objects=-Two"], {"-Two"}),
        (["--collection", "Some"], {"One", "-Two"}),
        (["--collection", "Some", "--objects", "One"], {"One"}),
    ):
        assert run(path, *LIMIT, *line, "--output", tmp_path / "out.blend", "--overwrite") == 0
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
        assert {each.name for each in bpy.data.objects if each.data.ccdepth.has_result} == expected
    capfd.readouterr()
    for line, message in (
        (["--objects", "Four"], "no mesh object “Four”"),
        (["--collection", "None"], "no collection “None”"),
        (["--collection", "Some", "--objects", "Three"], "no mesh object “Three” in its collection “Some”"),
        (["--collection", "Empty"], "no mesh object in its collection “Empty”\n"),
        (["--collection", "Excluded"], "no mesh object in its collection “Excluded” that is not hidden"),
    ):
        assert run(path, *line) == 1
        assert message in capfd.readouterr().err


@pytest.mark.parametrize("kind", ["objects", "meshes", "collections"])
def test_what_is_linked_from_a_missing_file_is_missed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], kind: str
) -> None:
    """Blender opens such a file with something empty in its place."""
    library, path = tmp_path / "library.blend", tmp_path / "cubes.blend"
    scene.clear()
    lent = scene.add_object(meshes.cube(), "Lent")
    collection = bpy.data.collections.new("Lent")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(lent)
    lent.data.name = "Lent"
    save(library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        setattr(wanted, kind, ["Lent"])
    linked = getattr(bpy.data, kind)["Lent"]
    root = bpy.context.scene.collection
    if kind == "collections":
        root.children.link(linked)
    else:
        root.objects.link(linked if kind == "objects" else bpy.data.objects.new("Own", linked))
    scene.add_object(meshes.cube(), "Here")
    save(path)
    library.unlink()
    output = tmp_path / "out.blend"
    assert run(path, *LIMIT, "--output", output) == 1
    assert f"“Lent” is missing: it is linked from {library}" in capfd.readouterr().err
    assert not output.exists()
    assert run(path, *LIMIT, "--objects", "Here", "--output", output) == 0


def test_nothing_that_exists_is_touched(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    names = ("out.blend", "out.obj", "out.png", "out.json", "out.csv")
    for name in names:
        (tmp_path / name).write_text("precious")
    for line in (
        ["--output", tmp_path / "out.blend"],
        ["--subdivide", "--output", tmp_path / "out.obj"],
        ["--picture", tmp_path / "out.png"],
        ["--json", tmp_path / "out.json"],
        ["--csv", tmp_path / "out.csv"],
    ):
        assert run(*LIMIT, *line) == 1
        assert "it exists already; use --overwrite" in capfd.readouterr().err
    assert sorted(each.name for each in tmp_path.iterdir()) == sorted(names)
    assert all((tmp_path / name).read_text() == "precious" for name in names)


def test_materials_of_an_obj_file_lie_beside_it(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    bpy.data.objects["Cube"].data.materials.append(bpy.data.materials.new("Paint"))
    save(path)
    line = [path, "--subdivide", *LIMIT, "--output", tmp_path / "out.obj"]
    (tmp_path / "out.mtl").write_text("precious")
    assert run(*line) == 1
    assert "out.mtl, which belongs to it, exists already" in capfd.readouterr().err
    assert (tmp_path / "out.mtl").read_text() == "precious"
    assert run(*line, "--overwrite") == 0
    assert "mtllib out.mtl" in (tmp_path / "out.obj").read_text()
    assert "newmtl Paint" in (tmp_path / "out.mtl").read_text()
    assert {each.name for each in tmp_path.glob("*out*")} == {"out.obj", "out.mtl"}


def test_several_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A bad one is named, and the others are done; options may stand between files."""
    save_cubes(tmp_path / "one.blend", "Cube")
    save_cubes(tmp_path / "-two.blend", "Cube")
    (tmp_path / "bad.ply").write_text("this is no mesh\n")
    out = tmp_path / "new" / "out"
    line = [tmp_path / "one.blend", "--subdivide", *LIMIT, tmp_path / "bad.ply", "--output-folder", out]
    assert run(*line, "--format", "stl", "--", tmp_path / "nowhere.obj", tmp_path / "-two.blend") == 1
    printed = capfd.readouterr()
    assert sorted(each.name for each in out.iterdir()) == ["-two.stl", "one.stl"]
    assert run(*line[:-1], tmp_path / "bad.ply") == 1
    assert "bad.ply: the folder cannot be made" in capfd.readouterr().err
    lines = [line for line in printed.err.splitlines() if line.startswith("ccdepth: ")]
    assert [line.split(": ")[1] for line in lines] == [
        "1 of 4 files done, 3 left",
        "2 of 4 files done, 2 left",
        "3 of 4 files done, 1 left",
        "4 of 4 files done, 0 left",
    ]
    assert "one.blend: done" in lines[0]
    assert "bad.ply: " in lines[1]
    assert "nowhere.obj: there is no such file" in lines[2]


def test_levels_are_set(tmp_path: Path) -> None:
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    assert run(path, "--levels", *LIMIT, "--output", tmp_path / "out.blend") == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    cube = bpy.data.objects["Cube"]
    [modifier] = cube.modifiers
    assert modifier.type == "SUBSURF"
    assert modifier.levels == modifier.render_levels == cube.data.ccdepth.uniform_level > 0
    assert run(path, "--levels", *LIMIT, "--output", tmp_path / "out.ply") == 0
    read(tmp_path / "out.ply")
    [cube] = bpy.data.objects
    assert len(cube.data.polygons) == 6 * 4 ** modifier_level(tmp_path / "out.blend")


def test_levels_of_a_result_are_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """They would subdivide a mesh that is fine enough already."""
    path, made, output = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "made.blend", tmp_path / "out.blend"
    assert run(path, "--subdivide", *LIMIT, "--output", made) == 0
    before = made.read_bytes()
    capfd.readouterr()
    assert run(made, "--levels", *LIMIT, "--output", output) == 1
    [error] = [line for line in capfd.readouterr().err.splitlines() if line.startswith("ccdepth: ")]
    assert error.startswith(f"ccdepth: {made}: ")
    assert error.endswith("Levels would subdivide the result itself: set those of its source")
    assert not output.exists()
    assert made.read_bytes() == before


def modifier_level(path: Path) -> int:
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return int(bpy.data.objects["Cube"].modifiers[0].levels)


def test_a_number_of_faces(tmp_path: Path) -> None:
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    assert run(path, "--subdivide", "--faces", "0.5k", "--output", tmp_path / "out.blend") == 0
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    assert 250 < len(bpy.data.objects["Cube Adaptive"].data.polygons) <= 500


def test_measuring_says_whether_the_tolerance_is_met(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The limit surface of a cube of 2 m passes √3/2 m inside of its corners."""
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    assert run(path, "--measure", "--absolute", "--tolerance", "1.1") == 0
    assert "within the tolerance" in capfd.readouterr().out
    assert run(path, "--measure", *LIMIT, "--output", tmp_path / "out.blend") == 1
    printed = capfd.readouterr()
    assert "not within the tolerance" in printed.out
    assert "done, and not within the tolerance" in printed.err
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    assert bpy.data.objects["Cube"].data.ccdepth.has_deviation
