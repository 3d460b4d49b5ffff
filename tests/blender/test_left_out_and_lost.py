# SPDX-License-Identifier: GPL-3.0-or-later
"""All is told: what the command line leaves out, works on copies of, loses in a format, and drivers not run."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

from tests import meshes
from tests.blender import addon, runs, scene
from tests.blender.runs import COARSE, LINE, Capture, mesh_objects, printed, run, said, save, save_cubes
from tests.blender.test_report import report_in, reported, sha256


def linked_cubes(tmp_path: Path, *, override: bool = False) -> Path:
    """A file with a cube of its own, one that is linked, and an object of its own with a linked mesh."""
    library = save_cubes(tmp_path / "library.blend", "Lent")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    lent = scene.link(library, "Lent")
    bpy.context.scene.collection.objects.link(lent)
    if override:
        lent.override_create(remap_local_usages=True)
    for index, (name, mesh) in enumerate((("Lent Mesh", lent.data), ("Lent Mesh Too", lent.data))):
        scene.add(name, mesh).location.x = 5.0 * (index + 1)
    scene.add_object(meshes.cube(), "Own").location.y = 5.0
    return save(tmp_path / "cubes.blend")


NAMES = ["Lent", "Lent Mesh", "Lent Mesh Too", "Own"]


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("action", "override"),
    [(["--levels"], True), (["--subdivide", "--in-place"], False), (["--measure", "--accuracy", "0.5"], True)],
)
def test_what_is_linked_is_done_on_copies(tmp_path: Path, action: list[str], override: bool) -> None:
    source, output, report = linked_cubes(tmp_path, override=override), tmp_path / "out.blend", tmp_path / "a.json"
    before = (tmp_path / "library.blend").read_bytes()
    tolerance = ["--absolute", "--tolerance", "2m"] if "--measure" in action else COARSE
    [entry] = reported(report, source, *tolerance, *action, "--output", output)["files"]
    assert sorted(each["name"] for each in entry["objects"]) == NAMES
    # Four cubes that are alike.
    found = [tuple(each[name] for name in ("faces", "deepest", "level", "result_faces")) for each in entry["objects"]]
    assert found == [found[0]] * 4
    if action[:1] == ["--subdivide"]:
        assert [each["met"] for each in entry["objects"]] == [True] * 4
    assert run("--verify", report) == 0
    assert (tmp_path / "library.blend").read_bytes() == before
    mesh_objects(output)
    shown = [each for each in bpy.data.objects if each.type == "MESH" and each.visible_get()]
    assert len(shown) == 4
    assert {each.library for each in shown} == {None}
    assert all(each.data.ccdepth.has_result or each.data.ccdepth.has_deviation for each in shown)


def test_what_is_left_out_is_named(tmp_path: Path, capfd: Capture) -> None:
    cubes = ("Cube", "Hidden", "In It", "Excluded")
    path, report = save_cubes(tmp_path / "all.blend", *cubes), tmp_path / "report.json"
    scene.add_collection("Off", bpy.data.objects["Excluded"], alone=True).objects.link(bpy.data.objects["Cube"])
    bpy.context.view_layer.layer_collection.children["Off"].exclude = True
    bpy.data.objects["Hidden"].hide_set(True)
    bpy.data.objects["Cube"].hide_select = True
    scene.add("Label", bpy.data.curves.new("Label", "FONT"))
    scene.add("Path\x1b", bpy.data.curves.new("Path", "CURVE"))
    scene.add("Guide", bpy.data.meshes.new("Guide"))
    scene.add_light()
    scene.add("Empty")
    inside = scene.add_collection("Inside", bpy.data.objects["In It"], alone=True)
    bpy.context.scene.collection.children.unlink(inside)
    instance = scene.add("Instance")
    instance.instance_type, instance.instance_collection = "COLLECTION", inside
    save(path)
    told = said(capfd, path, *LINE, "--json", report, status=0)
    names = {"Excluded", "Guide", "Hidden", "Instance", "Label", "Path\x1b"}
    assert all(f"“{name}” is left out".replace("\x1b", "\\x1b") in told for name in names)
    [entry] = report_in(report)["files"]
    assert {*entry["left_out"]} == names
    assert [each["name"] for each in entry["objects"]] == ["Cube"]
    assert run("--verify", report) == 0
    # Nothing else was asked for.
    [entry] = reported(report, path, *LINE, "--objects", "Cube", "--overwrite")["files"]
    assert entry["left_out"] == []


def save_painted(path: Path) -> Path:
    """Two closed cubes with a UV map that has seams, colours, and a material with a texture."""
    scene.clear()
    texture = path.parent / "textures" / "paint.png"
    texture.parent.mkdir()
    image = bpy.data.images.new("Paint", 4, 4)
    image.filepath_raw, image.file_format = str(texture), "PNG"
    image.save()
    material = bpy.data.materials.new("Paint")
    if material.node_tree is None:
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    surface = next(each for each in material.node_tree.nodes if each.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])
    for name, domain in (("One", "POINT"), ("Two", "CORNER")):
        bpy.ops.mesh.primitive_cube_add()
        cube = bpy.context.object
        cube.name = name
        color = cube.data.color_attributes.new("Color", "FLOAT_COLOR", domain)
        color.data.foreach_set("color", [0.2, 0.4, 0.6, 1.0] * len(color.data))
        cube.data.color_attributes.active_color = color
        cube.data.materials.append(material)
    return save(path)


LOST: dict[str, list[str]] = {
    ".stl": ["materials", "UV maps", "colours"],
    ".ply": ["materials", "UV maps", "colours of corners"],
    ".obj": ["colours of corners"],
    **{suffix: [] for suffix in (".blend", ".glb", ".usda", ".fbx")},
}


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", LOST)
def test_what_a_format_loses_is_told(tmp_path: Path, suffix: str, capfd: Capture) -> None:
    runs.skip_unwritten(suffix)
    lost, source = LOST[suffix], save_painted(tmp_path / "cubes.blend")
    out = tmp_path / "deeper" / "out"
    out.mkdir(parents=True)
    output, report = out / f"made{suffix}", tmp_path / "report.json"
    told = said(capfd, source, *COARSE, "--subdivide", "--output", output, "--json", report, status=0)
    [entry] = report_in(report)["files"]
    assert entry["lost"] == lost
    assert (f"lost in {output}: {', '.join(lost)}" in told) == bool(lost)
    assert [each["closed"] for each in entry["objects"]] == [True, True]
    names = [output.name, *(["made.mtl"] if suffix == ".obj" else [])]
    assert sorted(each.name for each in out.iterdir()) == sorted(names)
    assert [each["path"] for each in entry["companions"]] == [f"deeper/out/{name}" for name in names[1:]]
    check_paint(out, output)
    assert run("--verify", report) == 0
    for name in names[1:]:
        assert [each["sha256"] for each in entry["companions"]] == [sha256(out / name)]
        (out / name).write_text("newmtl Other\n")
        assert run("--verify", report) == 1


def check_paint(folder: Path, output: Path) -> None:
    """The file names its texture as seen from itself, and has the colours, where its format has them."""
    texture = os.path.join("..", "..", "textures", "paint.png")
    if output.suffix == ".obj":
        assert f"map_Kd {texture}" in (folder / "made.mtl").read_text()
        vertices = [line for line in output.read_text().splitlines() if line.startswith("v ")]
        for line in vertices:
            assert list(map(float, line.split()[4:])) == pytest.approx([0.4845, 0.6652, 0.7977], abs=2e-4)
    if output.suffix == ".usda":
        assert f"@{texture}@" in output.read_text()
    if output.suffix == ".ply":
        assert b"property uchar red" in output.read_bytes()


@pytest.mark.parametrize(("suffix", "lost"), [(".obj", True), (".usdc", True), (".glb", False)])
def test_packed_images_and_further_uv_maps(tmp_path: Path, suffix: str, lost: bool) -> None:
    runs.skip_unwritten(suffix)
    source, report = save_painted(tmp_path / "cubes.blend"), tmp_path / "report.json"
    bpy.data.images["Paint"].pack()
    bpy.data.objects["One"].data.uv_layers.new(name="Second")
    save(source)
    [entry] = reported(report, source, *COARSE, "--subdivide", "--output", tmp_path / f"made{suffix}")["files"]
    assert ("images that are in no file" in entry["lost"]) == lost
    assert ("UV maps but one" in entry["lost"]) == (suffix == ".obj")


QUICK = ("--relative", "--tolerance", "0.02", "--method", "second-order")
# Not a simple expression, so that Python has to run.
EXPRESSION = "__import__('pathlib').Path({!r}).touch() or 3.0"


@pytest.fixture(autouse=True)
def the_preference_of_the_user() -> Iterator[None]:
    paths = bpy.context.preferences.filepaths
    before = paths.use_scripts_auto_execute
    yield
    paths.use_scripts_auto_execute = before


def rig(path: Path, where: str = "shape key") -> Path:
    """A file with a cube whose shape a driver decides, which leaves a trace where it runs, and another cube."""
    scene.clear()
    cube, _other = scene.add_object(meshes.cube(), "Driven"), scene.add_object(meshes.cube(), "Plain")
    holder, name = bpy.context.scene.objects["Driven"], "location"
    if where == "shape key":
        holder, name = scene.add_key(cube), "value"
        holder.data[0].co.x -= 3.0
    elif where == "modifier":
        holder, name = cube.modifiers.new("Displace", "DISPLACE"), "strength"
    elif where == "parent":
        cube.parent = holder = scene.add("Parent")
        name = "scale"
    elif where == "another driver":
        other = scene.add("Other")
        driver = cube.driver_add("scale", 0).driver
        target = driver.variables.new()
        target.name, target.targets[0].id, target.targets[0].data_path = "moved", other, "location.x"
        driver.expression, holder = "moved + 1", other
    elif where == "node group":
        tree = scene.node_tree("GeometryNodeTransform")
        cube.modifiers.new("Nodes", "NODES").node_group = tree
        moving = next(node for node in tree.nodes if "Scale" in node.inputs)
        holder, name = moving.inputs["Scale"], "default_value"
    curves = holder.driver_add(name)
    for curve in curves if isinstance(curves, list) else [curves]:
        curve.driver.expression = EXPRESSION.format(str(path.with_suffix(".trace")))
    return save(path)


@pytest.mark.every_blender
@pytest.mark.parametrize(
    ("where", "preference"),
    [*((where, False) for where in ("modifier", "parent", "another driver", "node group")), ("shape key", True)],
)
def test_without_scripts_what_needs_them_fails_and_others_are_done(
    tmp_path: Path, where: str, preference: bool
) -> None:
    source = rig(tmp_path / "rig.blend", where)
    source.with_suffix(".trace").unlink(missing_ok=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = preference
    line = (source, *QUICK, "--subdivide", "--output", tmp_path / "o.stl")
    [found] = reported(tmp_path / "r.json", *line, status=1)["files"]
    assert [each["name"] for each in found["objects"]] == ["Plain"]
    assert (found["met"], found["objects"][0]["met"]) == (False, True)
    assert "“Driven” depends on a driver that did not run" in found["error"]
    assert run("--verify", tmp_path / "r.json") == 1
    [alone] = reported(tmp_path / "alone.json", source, *QUICK, "--objects", "Driven", status=1)["files"]
    assert alone["objects"] == []
    assert not source.with_suffix(".trace").exists(), "a script ran"
    assert bpy.context.preferences.filepaths.use_scripts_auto_execute is preference


@pytest.mark.every_blender
def test_scripts_run_where_blender_was_started_so_in_all_that_a_run_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    source = rig(tmp_path / "rig.blend")
    written = ("--output", tmp_path / "o.stl", "--json", tmp_path / "r.json")
    words = [str(word) for word in (source, *QUICK, "--subdivide", *written)]
    if bpy.app.binary_path:
        status = subprocess.run([runs.program()[0], "-b", "-y", *runs.program()[2:], *words]).returncode
    else:
        # The bpy module has no options of Blender.
        monkeypatch.setattr(addon.module("exchange.mesh_files"), "scripts_allowed", lambda: True)
        monkeypatch.setattr(addon.module("exchange.blender_calls"), "scripts_allowed", lambda: True)
        status = run(*words)
    assert status == 0
    [found] = report_in(tmp_path / "r.json")["files"]
    assert (found["error"], found["met"], len(found["objects"])) == (None, True, 2)
    assert source.with_suffix(".trace").exists()
    monkeypatch.undo()
    told = printed(capfd, "--verify", tmp_path / "r.json", status=1)
    assert "“Driven” depends on a driver that did not run" in told


def test_the_last_option_of_blenders_own_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    module = addon.module("exchange.blender_calls")
    monkeypatch.setattr(module.bpy, "app", type("App", (), {"binary_path": "blender"}))
    allowing = ("-y", "--enable-autoexec", "-Y -y", "-y --command ccdepth -Y")
    for options in (*allowing, "", "-y -b -Y", "--command ccdepth -y", "-- -y"):
        monkeypatch.setattr(sys, "argv", ["blender", *options.split()])
        assert module.scripts_allowed() is (options in allowing), options


def test_a_driver_of_a_material_decides_no_shape(tmp_path: Path) -> None:
    scene.clear()
    cube = scene.add_object(meshes.cube(), "Painted")
    cube.data.materials.append(bpy.data.materials.new("Paint"))
    curve = cube.data.materials[0].driver_add("roughness")
    curve.driver.expression = EXPRESSION.format(os.fspath(tmp_path / "trace"))
    assert run(save(tmp_path / "painted.blend"), *QUICK) == 0
