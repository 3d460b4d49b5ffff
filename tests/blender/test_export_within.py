# SPDX-License-Identifier: GPL-3.0-or-later
"""Export Within Tolerance: files that another Blender has measured, and a scene that stays as it was."""

import json
import sys
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from tests import meshes, thorough
from tests.blender import addon, runs, scene, snapshot
from tests.blender.subdividing import refuses

export = addon.module("operators.export_within")

# An absolute one, in metres.
SETTINGS = {"tolerance": 0.02, "tolerance_mode": "ABSOLUTE"}


@pytest.fixture(autouse=True)
def _another_blender(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(export, "own_process", lambda *_: runs.program())


def smooth(data: meshes.MeshData, name: str) -> bpy.types.Object:
    holder = scene.add_object(data, name)
    holder.data.shade_smooth()
    return holder


def exported(path: Path, *objects: bpy.types.Object, **settings: Any) -> None:
    """Export the objects; the file stays as it was."""
    addon.select(*objects)
    with snapshot.unchanged():
        assert bpy.ops.ccdepth.export_within(filepath=str(path), **SETTINGS | settings) == {"FINISHED"}


def report_of(path: Path) -> dict[str, Any]:
    """The only file of a certificate."""
    [entry] = json.loads(path.with_name(f"{path.name}.json").read_text(encoding="utf-8"))["files"]
    return entry


@pytest.mark.every_blender
@pytest.mark.parametrize("suffix", thorough.each([".stl", ".obj", ".ply", ".glb", ".usdc"], [".stl", ".glb"]))
def test_the_file_is_measured_and_the_scene_stays_as_it_was(tmp_path: Path, suffix: str, capfd: runs.Capture) -> None:
    """Also with a name, a scale and a shear that not every format has, and objects that share a mesh."""
    runs.skip_unwritten(suffix)
    parent, cube = scene.add("Parent"), smooth(meshes.creased_cube(), "Cube, 1/2")
    parent.scale, parent.rotation_euler = (1.0, 2.0, 0.5), (0.3, 0.2, 0.1)
    cube.parent, cube.rotation_euler = parent, (0.4, 0.5, 0.6)
    twin = scene.add("Twin", cube.data)
    twin.location.x = 9.0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    path = tmp_path / f"made{suffix}"
    exported(path, cube, twin, certificate=True)
    entry = report_of(path)
    triangles = sum(each["triangles"] for each in entry["objects"])
    told = capfd.readouterr().out
    assert f"Info: made{suffix}: {triangles:,} triangles, at most 0.0" in told
    assert "m from the surface (measured in the file)" in told
    assert [(each["name"], each["met"]) for each in entry["objects"]] == [("Cube, 1/2", True), ("Twin", True)]
    assert {each.name for each in tmp_path.iterdir()} <= {
        *("source.blend", path.name, f"{path.name}.json", "made.mtl"),
    }
    assert runs.run("--verify", path.with_name(f"{path.name}.json")) == 0


def test_lengths_are_those_of_the_unit(tmp_path: Path) -> None:
    """In .stl files millimetres, unless another unit is chosen; of a scene in centimetres."""
    bpy.context.scene.unit_settings.scale_length = 0.01
    cube = scene.add_object(meshes.cube(), "Cube")
    for unit, length in (("FORMAT", 0.001), ("INCHES", 0.0254)):
        exported(tmp_path / "cube.stl", cube, unit=unit)
        corners = np.fromfile(
            tmp_path / "cube.stl", dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")], offset=84
        )["corners"]
        # The middle of a face of the limit surface of a cube from -1 to 1, by the mask for a vertex of four faces:
        # level 1 has it at 1, its edges at 3/4 and its corners at 5/9. Files hold single precision.
        assert np.abs(corners).max() * length / 0.01 == pytest.approx((16 + 4 * 3 + 4 * 5 / 9) / 36, rel=1e-6)
    assert not list(tmp_path.glob("*.json"))


def test_a_file_is_measured_by_the_tolerance_at_each_place(tmp_path: Path, capfd: runs.Capture) -> None:
    """Two faces of a cube may be off by ten times as much, and are by more than the tolerance."""
    cube = scene.add_object(meshes.cube(), "Cube")
    for name, factor in (("Fine", 1.0), ("Coarse", 10.0)):
        material = bpy.data.materials.new(name)
        material.ccdepth.tolerance_factor = factor
        cube.data.materials.append(material)
    cube.data.polygons.foreach_set("material_index", [1, 1, 0, 0, 0, 0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    exported(tmp_path / "cube.obj", cube, tolerance_by="MATERIAL", certificate=True)
    told = capfd.readouterr().out
    assert "of its tolerance from the surface (measured in the file)" in told
    assert "not within" not in told
    [entry] = report_of(tmp_path / "cube.obj")["objects"]
    assert entry["factors"] == [1.0, 10.0]
    assert entry["measured"]["proved"] <= entry["tolerance"] < entry["proved"]
    assert runs.run("--verify", tmp_path / "cube.obj.json") == 0


@pytest.mark.every_blender
def test_modifiers_below_the_surface_go_on_and_are_measured(tmp_path: Path, capfd: runs.Capture) -> None:
    """What they change is no longer within the tolerance, and that is told."""
    cube = scene.add_object(meshes.cube(), "Cube")
    scene.add_subdivision(cube, 1)
    exported(tmp_path / "cube.obj", cube)
    assert "not within" not in capfd.readouterr().out
    cube.modifiers.new("Displace", "DISPLACE").strength = 0.5
    exported(tmp_path / "cube.obj", cube)
    assert "Warning: cube.obj: " in (told := capfd.readouterr().out)
    assert "and not within the tolerance of 0.02 m" in told


def test_a_result_is_made_anew_from_its_hidden_source_in_its_own_place(tmp_path: Path, capfd: runs.Capture) -> None:
    source = scene.add_object(meshes.cube(), "Cube")
    addon.finish("subdivide", source, tolerance=0.3, tolerance_mode="ABSOLUTE")
    result = bpy.data.objects["Cube Adaptive"]
    assert not source.visible_get()
    result.location, result.scale = (5.0, 0.0, 0.0), (3.0, 1.0, 1.0)
    coarse = len(result.data.polygons)
    exported(tmp_path / "cube.ply", result)
    told = capfd.readouterr().out
    assert "not within" not in told
    triangles = int(told.split("cube.ply: ")[1].split(" triangles")[0].replace(",", ""))
    assert triangles > 4 * coarse
    addon.select(result)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    refuses("export_within", "select “Cube”", filepath=str(tmp_path / "cube.ply"), certificate=True, **SETTINGS)
    bpy.data.objects.remove(source)
    refuses("export_within", "a result without a source", filepath=str(tmp_path / "cube.ply"), **SETTINGS)


def test_edit_mode_goes_on(tmp_path: Path) -> None:
    cube = scene.add_object(meshes.cube(), "Cube")
    with addon.edit_mode(cube):
        assert bpy.ops.ccdepth.export_within(filepath=str(tmp_path / "cube.obj"), **SETTINGS) == {"FINISHED"}
        assert bpy.context.mode == "EDIT_MESH"
    assert len(bpy.data.objects) == 1


@pytest.mark.every_blender
def test_what_cannot_be_exported_is_refused_and_nothing_is_changed(tmp_path: Path) -> None:
    keyed, hidden = scene.add_object(meshes.cube(), "Keyed"), scene.add_object(meshes.cube(), "Hidden")
    scene.add_key(keyed, "Key")
    for message, objects, settings in (
        ("its name must end in .obj", [keyed], {"filepath": str(tmp_path / "cube.dxf")}),
        ("its name must end in .obj", [keyed], {"filepath": str(tmp_path / "cube")}),
        ("there is no folder", [keyed], {"filepath": str(tmp_path / "nowhere" / "cube.stl")}),
        ("is not a regular file", [keyed], {"filepath": str(tmp_path / "folder.stl")}),
        ("Save the .blend file first", [keyed], {"certificate": True}),
        ("Hidden: the object is hidden", [hidden], {}),
        ("Keyed: Reduce cannot keep its shape keys", [keyed], {"reduce": True}),
        ("The tolerance must be greater than zero", [keyed], {"tolerance": 0.0}),
    ):
        (tmp_path / "folder.stl").mkdir(exist_ok=True)
        hidden.hide_set(False)
        addon.select(*objects)
        hidden.hide_set("Hidden" in message)
        given = {"filepath": str(tmp_path / "cube.stl"), **SETTINGS, **settings}
        refuses("export_within", message, **given)
        assert [each.name for each in tmp_path.iterdir()] == ["folder.stl"]


ENDING = {
    "another Blender that fails": ("print('no memory'); sys.exit(3)", "Blender ended with status 3: no memory"),
    "another Blender that says nothing": ("", "Blender ended with status 0: it printed nothing"),
}


@pytest.mark.parametrize("case", ENDING)
def test_a_file_that_cannot_be_measured_takes_no_place(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, message = ENDING[case]
    monkeypatch.setattr(export, "own_process", lambda *_: [sys.executable, "-c", f"import sys; {code}"])
    refused(tmp_path, message)


def test_a_file_that_is_cut_off_takes_no_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = export.write_meshes

    def cut_off(objects: object, path: Path, scale: float) -> object:
        lost = write(objects, path, scale)
        path.write_bytes(path.read_bytes()[:-50])
        return lost

    monkeypatch.setattr(export, "write_meshes", cut_off)
    refused(tmp_path, "is the disk full")


def test_esc_ends_the_other_blender_and_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Esc: the work raises. The other Blender would take a minute."""
    job = addon.module("operators.mesh_operators")
    monkeypatch.setattr(export, "own_process", lambda *_: [sys.executable, "-c", "import time; time.sleep(60)"])

    def cancelled(*_: object) -> None:
        raise job.Cancelled

    monkeypatch.setattr(export, "_wait", cancelled)
    begin = time.monotonic()
    refused(tmp_path, "was stopped, and nothing was changed")
    assert time.monotonic() - begin < 30


def refused(tmp_path: Path, message: str) -> None:
    """The export to an existing file is refused, which stays as it was, with nothing beside it."""
    path = tmp_path / "cube.ply"
    path.write_text("precious")
    addon.select(scene.add_object(meshes.cube(), "Cube"))
    refuses("export_within", message, filepath=str(path), **SETTINGS)
    assert path.read_text() == "precious"
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_names_are_those_of_the_objects(tmp_path: Path) -> None:
    runs.skip_unwritten(".obj")
    cube = scene.add_object(meshes.cube(), "Cube")
    cube.data.name = "Mesh of it"
    other = bpy.data.meshes.new("Cube")
    exported(tmp_path / "made.obj", cube)
    assert (cube.name, cube.data.name, other.name) == ("Cube", "Mesh of it", "Cube")
    lines = (tmp_path / "made.obj").read_text().splitlines()
    assert [line for line in lines if line.startswith("o ")] == ["o Cube"]
