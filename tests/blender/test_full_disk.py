# SPDX-License-Identifier: GPL-3.0-or-later
"""A file that cannot be written as a whole is not written at all: exit status 1, and what was there is still there.

The limit of a process on the size of its files stands in for a full disk: writing fails in the same way.
"""

import os
import re
import resource
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
import pytest

from tests.blender import addon
from tests.blender.runs import Capture, few_samples, program, run, said, save, save_cubes
from tests.blender.test_command_line import example_command

whole_files = addon.module("exchange.whole_files")


# Less than any file has that is written.
ROOM = 1024

LINE = ["--relative", "--tolerance", "0.01", "--method", "second-order", "--overwrite"]


@contextmanager
def little_room() -> Iterator[None]:
    """No file of this process can be longer than ROOM."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.fixture(autouse=True)
def quick_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    few_samples(monkeypatch)


WRITES = ("--output blend", "--picture png", "--subdivide --output stl", "--subdivide --output glb", "--json json")


@pytest.mark.every_blender
@pytest.mark.parametrize(("line", "existing"), [*((line, b"something precious") for line in WRITES), (WRITES[0], b"")])
def test_a_file_that_does_not_fit(tmp_path: Path, line: str, existing: bytes, capsys: Capture) -> None:
    """What is printed meanwhile is kept in memory: pytest's own files would be as short."""
    *options, suffix = line.split()
    path = tmp_path / f"out.{suffix}"
    if existing:
        path.write_bytes(existing)
    with little_room():
        assert run(*LINE, *options, path) == 1
    printed = capsys.readouterr()
    assert "Written" not in printed.out
    # Python says itself of a file of its own that it is too large.
    assert re.search(rf"ccdepth: .*{path.name}: .*(is the disk full|too large)", printed.err), printed.err
    assert [each.name for each in tmp_path.iterdir()] == ([path.name] if existing else [])
    assert not existing or path.read_bytes() == existing


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("command", ["ccdepth", "batch_depth.py"])
def test_output_that_cannot_be_printed(tmp_path: Path, command: str) -> None:
    """In other processes, of the command and of an example."""
    line = [*program(), *LINE]
    if command != "ccdepth":
        if bpy.app.binary_path:
            pytest.skip("with the bpy module only")
        bpy.ops.mesh.primitive_cube_add()
        line = example_command(command, save(tmp_path / "cube.blend"), 0.01)
    with open("/dev/full", "w") as full:
        ended = subprocess.run(line, timeout=120, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ("Traceback" in ended.stderr) == (command != "ccdepth")
    assert command == "ccdepth" or "No space left" in ended.stderr


@pytest.mark.parametrize("name", ["link.stl", "link.obj", "link.blend", "link.json"])
@pytest.mark.parametrize("is_there", [True, False])
def test_a_link_is_replaced_and_decides_the_format(tmp_path: Path, name: str, is_there: bool, capfd: Capture) -> None:
    link, target = tmp_path / name, tmp_path / "target.txt"
    if is_there:
        target.write_text("precious")
    link.symlink_to(target)
    line = ["--json"] if link.suffix == ".json" else ["--subdivide", "--output"]
    cube = save_cubes(tmp_path / "cube.blend", "Cube")
    assert "it exists already" in said(capfd, cube, *LINE[:-1], *line, link)
    assert run(cube, *LINE, *line, link) == 0
    assert not link.is_symlink()
    assert link.is_file()
    assert (target.read_text() == "precious") if is_there else not target.exists()


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_a_full_disk_is_told_whatever_was_made_of_it(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    """A file that was cut off cannot be read back, or holds less; here all but its first line is lost."""
    mesh_files, one_file = addon.module("exchange.mesh_files"), addon.module("command_line.one_file")

    def cut_off(*arguments: object) -> None:
        mesh_files.write_meshes(*arguments)
        path = arguments[1]
        assert isinstance(path, Path)
        os.truncate(path, 40)

    monkeypatch.setattr(one_file, "write_meshes", cut_off)
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: type("", (), {"free": 0}))
    assert run(*LINE, "--subdivide", "--output", tmp_path / f"out{suffix}") == 1
    [error] = [line for line in capfd.readouterr().err.splitlines() if line.startswith("ccdepth: ")]
    assert f"out{suffix}: it could not be written: " in error
    assert error.endswith(("the disk is full", "is the disk full?"))
    assert not list(tmp_path.iterdir())


@pytest.mark.every_blender
@pytest.mark.parametrize("is_compressed", [False, True])
def test_a_blend_file_that_is_cut_off_is_recognised(tmp_path: Path, is_compressed: bool) -> None:
    """Cut off anywhere before its last block, which has no content."""
    bpy.ops.mesh.primitive_monkey_add()
    name, path = bpy.context.object.name, tmp_path / "cut.blend"
    content = save(path, compress=is_compressed).read_bytes()
    check = addon.module("exchange.mesh_files").check_blend
    check(path, [name])
    assert not bpy.data.libraries
    with pytest.raises(Exception, match="it cannot be read back; is the disk full"):
        check(path, [name, "Nobody"])
    length = len(content)
    for size in {0, 5, 12, 20, 40, min(64 * 1024, length // 3), length // 2, 9 * length // 10}:
        path.write_bytes(content[:size])
        with pytest.raises(Exception, match="it cannot be read back; is the disk full"):
            check(path, [name])


def test_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "made.obj"
    path.write_text("before")
    path.chmod(0o640)
    with whole_files.written_whole(path) as beside:
        beside.write_text("after")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("after", 0o640)


def test_a_file_that_comes_meanwhile_stays(tmp_path: Path) -> None:
    path = tmp_path / "made.obj"

    def write() -> None:
        with whole_files.written_whole(path, overwrite=False) as beside:
            beside.write_text("second")
            path.write_text("first")

    with pytest.raises(whole_files.UnwrittenError, match="it exists already"):
        write()
    assert [each.name for each in tmp_path.iterdir()] == ["made.obj"]
    assert path.read_text() == "first"
