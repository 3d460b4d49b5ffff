# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line's files: which are read and written, how long their units are, what stays untouched, and what is
refused as an output, because something would be lost or a report could not be verified."""

import os
import stat
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import (
    Capture,
    depths_in,
    mesh_objects,
    outputs,
    printed,
    run,
    said,
    save,
    save_cubes,
    skip_unwritten,
    writable,
)

amounts = addon.module("command_line.amounts")
blender_calls = addon.module("exchange.blender_calls")

LIMIT = ["--tolerance", "0.05", "--absolute", "--method", "certified"]


def read(path: Path) -> None:
    """Import a file by Blender's own means into an empty file of metres."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    suffix = path.suffix[1:]
    importers = {"glb": bpy.ops.import_scene.gltf, "usdc": bpy.ops.wm.usd_import}
    if not hasattr(bpy.types, "WM_OT_fbx_import"):
        importers["fbx"] = bpy.ops.import_scene.fbx
    (importers.get(suffix) or getattr(bpy.ops.wm, f"{suffix}_import"))(filepath=str(path))
    bpy.context.view_layer.update()


def box() -> np.ndarray:
    """(2, 3): the least and the largest coordinates of all that is visible, as it shows."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = [each.evaluated_get(depsgraph) for each in bpy.data.objects if each.type == "MESH" and each.visible_get()]
    corners = [each.matrix_world @ vertex.co for each in shown for vertex in each.data.vertices]
    return np.array([np.min(corners, axis=0), np.max(corners, axis=0)])


UNITS = {"0.1mm": 0.001, "0.1 mm": 0.001, "2m": 1.0, "5um": 1e-6, "5µm": 1e-6, "0.01in": 0.0254, "1thou": 0.0000254}


def test_tolerances_and_numbers_of_faces_as_typed() -> None:
    for text, unit in UNITS.items():
        typed = amounts.typed_tolerance(text)
        assert (typed.value, typed.unit, typed.mode) == (float(text.rstrip(" aceihmnoptuµ")), unit, "ABSOLUTE")
    for text, mode in (("0.001", None), ("1e-3", None), ("0.1%", "RELATIVE")):
        typed = amounts.typed_tolerance(text)
        assert (typed.value, typed.unit, typed.mode) == (pytest.approx(0.001), None, mode)
    for text, faces in (("50000", 50_000), ("50k", 50_000), ("1.5M", 1_500_000), ("2", 2)):
        assert amounts.face_budget(text) == faces
    with pytest.raises(amounts.ArgumentTypeError):
        amounts.face_budget("9" * 309)


@pytest.mark.parametrize(("scale", "expected"), [(1.0, 0.002), (0.001, 2.0), (0.01, 0.2)])
def test_a_tolerance_with_a_unit_is_that_long_in_any_scene(tmp_path: Path, scale: float, expected: float) -> None:
    bpy.context.scene.unit_settings.scale_length = scale
    path, output = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "out.blend"
    assert run(path, "--tolerance", "2mm", "--output", output, "--json", tmp_path / "report.json") == 0
    [entry] = addon.module("command_line.report_reading").read_report(tmp_path / "report.json").files
    assert entry.objects[0].tolerance == pytest.approx(0.002)
    assert mesh_objects(output)["Cube"].data.ccdepth.world_tolerance == pytest.approx(expected)


def test_a_file_in_millimetres_keeps_its_numbers_and_knows_their_length(tmp_path: Path) -> None:
    """A bare number is what it has always been, and one with a unit is that long."""
    output = tmp_path / "out.blend"
    addon.select(scene.add_object(meshes.cube()))
    bpy.ops.wm.stl_export(filepath=str(tmp_path / "cube.stl"))
    for tolerance, *unit in (("0.05",), ("50um",), ("50mm", "--unit", "m")):
        line = [tmp_path / "cube.stl", "--absolute", "--tolerance", tolerance, *unit]
        assert run(*line, "--output", output, "--overwrite") == 0
        [cube] = mesh_objects(output).values()
        assert cube.data.ccdepth.world_tolerance == pytest.approx(0.05)
        assert cube.dimensions[:] == pytest.approx((2.0, 2.0, 2.0))


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".glb", ".usdc", ".fbx"])
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_what_is_written_has_the_scenes_size_and_place(
    tmp_path: Path, suffix: str, scale: float, capfd: Capture
) -> None:
    path, report = tmp_path / f"out{suffix}", tmp_path / "report.json"
    if not writable(suffix):
        assert f"this Blender cannot write {suffix} files" in said(capfd, "--subdivide", "--output", path)
        return
    bpy.context.scene.unit_settings.scale_length = scale
    # Mirrored, sheared and beside another one with a name that not every format takes.
    parent = scene.add("Parent")
    parent.scale = (-1.0, 2.0, 1.0)
    for index, name in enumerate(("Würfel Nr. 1", "Cube.001")):
        cube = scene.add_object(meshes.cube(), name)
        cube.parent = parent
        cube.location.x, cube.rotation_euler.z = 4.0 * index, 0.5
    source = save(tmp_path / "mesh.blend")
    assert run(source, "--subdivide", *LIMIT, "--output", tmp_path / "out.blend") == 0
    mesh_objects(tmp_path / "out.blend")
    expected = box() * scale
    told = printed(capfd, source, "--subdivide", *LIMIT, "--output", path, "--json", report)
    assert f"Written: {path}" in told
    assert {each.name for each in tmp_path.iterdir()} == {"mesh.blend", "out.blend", "report.json", path.name}
    read(path)
    in_file = 1000.0 if suffix == ".stl" else 1.0
    # The files hold coordinates in single precision.
    np.testing.assert_allclose(box(), expected * in_file, rtol=1e-5, atol=1e-5 * in_file)
    written = [each.data for each in bpy.data.objects if each.type == "MESH"]
    assert not [each.name for mesh in written for each in mesh.attributes if "ccdepth" in each.name]
    # Faces look outwards: the volume inside is positive.
    assert sum(np.linalg.det(scene.mesh_data(each).positions[scene.triangles_of(each)]).sum() for each in written) > 0


@pytest.mark.every_blender
@pytest.mark.parametrize(("suffix", "kind"), [("glb", "GLB"), ("gltf", "GLTF_SEPARATE")])
def test_gltf_files_come_together_where_they_were_split(tmp_path: Path, suffix: str, kind: str) -> None:
    """A cube with flat faces has 24 vertices in such a file, and its limit surface would be six flat discs."""
    addon.select(scene.add_object(meshes.cube()))
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / f"cube.{suffix}"), use_selection=True, export_format=kind)
    assert run(tmp_path / f"cube.{suffix}", *LIMIT, "--output", tmp_path / "out.blend") == 0
    [cube] = mesh_objects(tmp_path / "out.blend").values()
    assert (len(cube.data.vertices), len(cube.data.polygons)) == (8, 12)


READ_ALONE: dict[str, tuple[str, dict[str, Any]]] = {
    ".fbx": ("export_scene.fbx", {"use_selection": True}),
    ".abc": ("wm.alembic_export", {"selected": True, "as_background_job": False}),
}


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", READ_ALONE)
def test_formats_that_are_read_alone_give_the_depths_of_the_blend_file(tmp_path: Path, suffix: str) -> None:
    """With a tolerance of 5 mm, so that the size and the axes have to come along as well."""
    writer, options = READ_ALONE[suffix]
    write = blender_calls.available(writer)
    if write is None:
        pytest.skip(f"this Blender cannot write {suffix} files")
    suzanne = scene.add_suzanne()
    suzanne.location, suzanne.rotation_euler, suzanne.scale = (3.0, 1.0, -2.0), (0.3, 0.5, 0.7), (2.0, 1.0, 0.5)
    addon.select(suzanne)
    source, path, output = save(tmp_path / "suzanne.blend"), tmp_path / f"suzanne{suffix}", tmp_path / "out.blend"
    write(filepath=str(path), **options)
    depths = []
    for each in (source, path):
        assert run(each, "--tolerance", "5mm", "--method", "certified", "--output", output, "--overwrite") == 0
        depths += depths_in(output).values()
    assert depths[0] == depths[1]
    assert len(set(depths[0])) > 2


def test_chosen_objects_alone(tmp_path: Path, capfd: Capture) -> None:
    path, output = save_cubes(tmp_path / "cubes.blend", "One", "-Two", "Three"), tmp_path / "out.blend"
    inner = scene.add_collection("Inner", bpy.data.objects["-Two"])
    scene.add_collection("Some", bpy.data.objects["One"]).children.link(inner)
    scene.add_collection("Empty")
    scene.add_collection("Excluded", scene.add_object(meshes.cube(), "Four"), alone=True)
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    save(path)
    for line, expected in (
        (["--objects", "One", "Three"], {"One", "Three"}),
        (["--objects=-Two"], {"-Two"}),
        (["--collection", "Some"], {"One", "-Two"}),
        (["--collection", "Some", "--objects", "One"], {"One"}),
    ):
        assert run(path, *LIMIT, *line, "--output", output, "--overwrite") == 0
        assert {name for name, each in mesh_objects(output).items() if each.data.ccdepth.has_result} == expected
    for line, message in (
        (["--objects", "Four"], "no mesh object “Four”"),
        (["--collection", "No\udcff"], "no collection “No\\udcff”"),
        (["--collection", "Some", "--objects", "Three"], "no mesh object “Three” in its collection “Some”"),
        (["--collection", "Empty"], "no mesh object in its collection “Empty”\n"),
        (["--collection", "Excluded"], "no mesh object in its collection “Excluded” that is not hidden"),
    ):
        assert message in said(capfd, path, *line)


@pytest.mark.every_blender
@pytest.mark.parametrize("kind", ["objects", "meshes", "collections"])
def test_what_is_linked_from_a_missing_file_is_missed(tmp_path: Path, capfd: Capture, kind: str) -> None:
    """Blender opens such a file with something empty in its place."""
    library, path, output = tmp_path / "library.blend", tmp_path / "cubes.blend", tmp_path / "out.blend"
    scene.add_collection("Lent", scene.add_object(meshes.cube(), "Lent"))
    save(library)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    linked = scene.link(library, "Lent", kind)
    root = bpy.context.scene.collection
    if kind == "collections":
        root.children.link(linked)
    else:
        root.objects.link(linked if kind == "objects" else bpy.data.objects.new("Own", linked))
    scene.add_object(meshes.cube(), "Here")
    save(path)
    library.unlink()
    assert f"“Lent” is missing: it is linked from {library}" in said(capfd, path, *LIMIT, "--output", output)
    assert not output.exists()
    assert run(path, *LIMIT, "--objects", "Here", "--output", output) == 0


@pytest.mark.every_blender
@pytest.mark.parametrize("kind", ["nodes", "image", "cache"])
def test_objects_that_depend_on_a_missing_file_fail_and_others_are_done(
    tmp_path: Path, capfd: Capture, kind: str
) -> None:
    """Nodes of another file, a texture's image, and the file of a Mesh Cache modifier; not the image of an empty."""
    needed, path = tmp_path / "needed", tmp_path / "cubes.blend"
    scene.node_tree().use_fake_user = True
    save(needed)
    bpy.data.batch_remove(bpy.data.node_groups)
    holder, other = scene.add_object(meshes.cube(), "Cube"), scene.add_object(meshes.cube(), "Other")
    if kind == "nodes":
        holder.modifiers.new("Nodes", "NODES").node_group = scene.link(needed, "Group", "node_groups")
    elif kind == "image":
        texture = bpy.data.textures.new("Image", "IMAGE")
        texture.image = bpy.data.images.new("Image", 8, 8)
        texture.image.source, texture.image.filepath = "FILE", str(needed)
        holder.modifiers.new("Displace", "DISPLACE").texture = texture
        other.parent = bpy.data.objects.new("Reference", None)
        other.parent.empty_display_type, other.parent.data = "IMAGE", texture.image
        bpy.context.collection.objects.link(other.parent)
    else:
        holder.modifiers.new("Cache", "MESH_CACHE").filepath = str(needed)
    save(path)
    assert run(path, *LIMIT) == 0
    needed.unlink()
    told = said(capfd, path, *LIMIT, "--output", tmp_path / "out.blend")
    assert "“Cube” depends on " in told
    assert f"{needed}" in told
    assert depths_in(tmp_path / "out.blend").keys() == {"Other"}


def test_nothing_that_exists_is_touched(tmp_path: Path, capfd: Capture) -> None:
    lines = ("--output out.blend", "--subdivide --output out.obj", "--picture out.png", "--json out.json")
    for line in (*lines, "--csv out.csv", "--html out.html"):
        *options, name = line.split()
        (tmp_path / name).write_text("precious")
        assert "it exists already; use --overwrite" in said(capfd, *LIMIT, *options, tmp_path / name)
        assert (tmp_path / name).read_text() == "precious"
    assert len(list(tmp_path.iterdir())) == 6


def test_materials_of_an_obj_file_lie_beside_it(tmp_path: Path, capfd: Capture) -> None:
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    bpy.data.objects["Cube"].data.materials.append(bpy.data.materials.new("Paint"))
    save(path)
    line = [path, "--subdivide", *LIMIT, "--output", tmp_path / "out.obj"]
    (tmp_path / "out.mtl").write_text("precious")
    assert "out.mtl, which belongs to it, exists already" in said(capfd, *line)
    assert (tmp_path / "out.mtl").read_text() == "precious"
    assert run(*line, "--overwrite") == 0
    assert "mtllib out.mtl" in (tmp_path / "out.obj").read_text()
    assert "newmtl Paint" in (tmp_path / "out.mtl").read_text()
    assert {each.name for each in tmp_path.glob("*out*")} == {"out.obj", "out.mtl"}


def test_several_files(tmp_path: Path, capfd: Capture) -> None:
    """A bad one is named, and the others are done; options may stand between files."""
    save_cubes(tmp_path / "one.blend", "Cube")
    save_cubes(tmp_path / "-two.blend", "Cube")
    (tmp_path / "bad.ply").write_text("this is no mesh\n")
    out = tmp_path / "new" / "out"
    line = [tmp_path / "one.blend", "--subdivide", *LIMIT, tmp_path / "bad.ply", "--output-folder", out]
    assert run(*line, "--format", "stl", "--", tmp_path / "nowhere.obj", tmp_path / "-two.blend") == 1
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("ccdepth: ")]
    assert sorted(each.name for each in out.iterdir()) == ["-two.stl", "one.stl"]
    assert [line.split(": ")[1] for line in lines] == [f"{n} of 4 files done, {4 - n} left" for n in range(1, 5)]
    for line, told in zip(lines, ("one.blend: done", "bad.ply: ", "nowhere.obj: there is no such file"), strict=False):
        assert told in line
    told = said(capfd, tmp_path / "one.blend", "--output-folder", tmp_path / "bad.ply")
    assert "bad.ply: the folder cannot be made" in told


def test_levels_are_set_unless_it_is_a_result(tmp_path: Path, capfd: Capture) -> None:
    path, output = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "out.blend"
    assert run(path, "--levels", *LIMIT, "--output", output) == 0
    cube = mesh_objects(output)["Cube"]
    [modifier] = cube.modifiers
    level = modifier.levels
    assert modifier.type == "SUBSURF"
    assert level == modifier.render_levels == cube.data.ccdepth.uniform_level > 0
    assert run(path, "--levels", *LIMIT, "--output", tmp_path / "out.ply") == 0
    read(tmp_path / "out.ply")
    [cube] = bpy.data.objects
    assert len(cube.data.polygons) == 6 * 4**level
    # A result is fine enough already.
    assert run(path, "--subdivide", *LIMIT, "--output", tmp_path / "made.blend") == 0
    message = "Cube Adaptive: it is a result, made from “Cube”; set the levels of the source"
    assert message in said(capfd, tmp_path / "made.blend", "--levels", *LIMIT, "--output", tmp_path / "again.blend")
    assert not (tmp_path / "again.blend").exists()


def test_a_number_of_faces(tmp_path: Path) -> None:
    path, output = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "out.blend"
    bpy.data.objects["Cube"].data.shade_smooth()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    assert run(path, "--subdivide", "--exact-normals", "--faces", "0.5k", "--output", output) == 0
    made = mesh_objects(output)["Cube Adaptive"].data
    assert 250 < len(made.polygons) <= 500
    assert made.has_custom_normals


def test_measuring_says_whether_the_tolerance_is_met(tmp_path: Path, capfd: Capture) -> None:
    """The limit surface of a cube of 2 m passes √3/2 m inside of its corners."""
    path, output = save_cubes(tmp_path / "cube.blend", "Cube"), tmp_path / "out.blend"
    assert "within the tolerance" in printed(capfd, path, "--measure", "--absolute", "--tolerance", "1.1")
    out, told = outputs(capfd, path, "--measure", *LIMIT, "--output", output, status=1)
    assert "not within the tolerance" in out
    assert "done, and not within the tolerance" in told
    assert mesh_objects(output)["Cube"].data.ccdepth.has_deviation
    # What is not met is not, also when it is looked at again.
    assert run(path, "--measure", *LIMIT, "--json", tmp_path / "report.json") == 1
    assert run("--verify", tmp_path / "report.json") == 1


def test_a_blend_file_is_measured_as_its_scene_shows_it(tmp_path: Path, capfd: Capture) -> None:
    path = save_cubes(tmp_path / "cube.blend", "Cube")
    bpy.context.scene.render.use_simplify = True
    bpy.context.scene.render.simplify_subdivision = 0
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    for suffix in (".blend", ".ply"):
        output = tmp_path / f"out{suffix}"
        out = printed(capfd, path, "--levels", "--measure", *LIMIT, "--output", output, status=1)
        assert "Simplify shows at most 0 levels in the viewport" in out
        assert "not within the tolerance" in out
        assert output.exists()


@pytest.mark.parametrize("option", ["--output", "--json", "--csv", "--html", "--picture"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "link to a device"])
def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path, capfd: Capture, option: str, kind: str) -> None:
    source = save_cubes(tmp_path / "cubes.blend", "One")
    # --picture and --output ask for these endings.
    there = tmp_path / ("out.png" if option == "--picture" else "out.blend")
    device = there if kind == "device" else tmp_path / "elsewhere"
    if "device" in kind:
        try:
            # Not /dev/full itself: a program that replaces it harms the whole machine.
            os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 7))
        except PermissionError:
            pytest.skip("only root can make devices")
    if kind == "pipe":
        os.mkfifo(there)
    elif kind == "folder":
        there.mkdir()
    elif kind == "link to a device":
        there.symlink_to(device)
    before_all = sorted(tmp_path.iterdir())
    before = os.stat(there)
    told = said(capfd, source, *LIMIT, option, there, "--overwrite")
    assert (os.stat(there).st_ino, os.stat(there).st_mode) == (before.st_ino, before.st_mode)
    assert "not a regular file" in told
    assert sorted(tmp_path.iterdir()) == before_all


@pytest.mark.parametrize("report", ["--json", "--csv", "--html"])
def test_no_report_is_made_of_an_input_that_is_replaced(tmp_path: Path, capfd: Capture, report: str) -> None:
    source = save_cubes(tmp_path / "cubes.blend", "One")
    before = source.read_bytes()
    for output in (("--output", source), ("--output-folder", tmp_path)):
        told = said(capfd, source, *LIMIT, *output, report, tmp_path / "report", "--overwrite", status=2)
        assert "is read, and would be replaced" in told
        assert (source.read_bytes() == before, (tmp_path / "report").exists()) == (True, False)
        # Without a report the file may be replaced.
    assert run(source, *LIMIT, "--output", source, "--overwrite") == 0
    assert source.read_bytes() != before


def test_reports_of_two_files_that_were_written_to_one_place_are_not_gathered(tmp_path: Path, capfd: Capture) -> None:
    parts = tmp_path / "parts"
    parts.mkdir()
    for name in ("x", "y"):
        (tmp_path / name).mkdir()
        source = save_cubes(tmp_path / name / "a.blend", "One")
        line = ("--subdivide", "--output-folder", tmp_path / "out", "--overwrite", "--json", parts / f"{name}.json")
        assert run(source, *LIMIT, *line) == 0
    told = said(capfd, "--gather", parts, "--json", tmp_path / "all.json")
    assert all(str(each) in told for each in (parts / "x.json", parts / "y.json", tmp_path / "out" / "a.blend"))
    assert not (tmp_path / "all.json").exists()


@pytest.mark.parametrize("suffix", [".glb", ".obj", ".ply", ".stl"])
def test_repeated_triangles_are_no_fault_of_a_file(tmp_path: Path, suffix: str) -> None:
    """Quads that share two edges can have one triangle in common, which Blender reads from .glb files once."""
    scene.clear()
    quads = [[0, 1, 2, 3], [0, 1, 2, 4]]
    mesh = bpy.data.meshes.new("Twice")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1)], [], quads)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Twice", mesh))
    mesh.calc_loop_triangles()
    assert len({tuple(sorted(each.vertices)) for each in mesh.loop_triangles}) == 3 < len(mesh.loop_triangles)
    # So far off that nothing is subdivided.
    line = [save(tmp_path / "twice.blend"), "--levels", "--absolute", "--tolerance", "9", "--measure"]
    skip_unwritten(suffix)
    assert run(*line, "--output", tmp_path / f"twice{suffix}") == 0
