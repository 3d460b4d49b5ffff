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

whole_files = addon.module("command_line.whole_files")


@contextmanager
def written_whole(path: Path, **options: object) -> Iterator[Path]:
    """As the command line writes a file."""
    with whole_files.claimed(path), whole_files.written_whole(path, **options) as beside:
        yield beside


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
@pytest.mark.parametrize("line", WRITES)
@pytest.mark.parametrize("existing", [b"", b"something precious"])
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


def save_suzanne(path: Path, *, compress: bool = True) -> bytes:
    bpy.ops.mesh.primitive_monkey_add()
    return save(path, compress=compress).read_bytes()


def is_taken(path: Path, content: bytes) -> bool:
    """Whether the content takes the place of the file; otherwise the file must stay."""
    path.write_bytes(b"before")
    try:
        with written_whole(path) as beside:
            beside.write_bytes(content)
    except whole_files.UnwrittenError:
        assert path.read_bytes() == b"before"
        return False
    assert path.read_bytes() == content
    return True


@pytest.mark.every_blender
@pytest.mark.parametrize("kind", ["plain .blend", "compressed .blend", ".png"])
def test_a_file_that_is_cut_is_recognised(tmp_path: Path, kind: str) -> None:
    if kind == ".png":
        image = bpy.data.images.new("Image", 64, 64)
        image.filepath_raw, image.file_format = str(tmp_path / "saved.png"), "PNG"
        image.save()
        content = (tmp_path / "saved.png").read_bytes()
        half = len(content) // 2
        damaged = content[:half] + bytes([content[half] ^ 1]) + content[half + 1 :]
    else:
        content = save_suzanne(tmp_path / "saved.blend", compress=kind.startswith("compressed"))
        # A hole where a part could not be written, with the end in its place again. Blocks have even sizes: the hole's
        # is odd, as a hole that holds whole blocks and nothing else is not seen.
        damaged = content[: len(content) // 3] + content[len(content) // 3 + 4097 :]
    path = tmp_path / f"out.{kind.partition('.')[2]}"
    assert is_taken(path, content)
    length = len(content)
    for size in {0, 5, 12, 20, 40, min(64 * 1024, length - 1), length // 2, length - 30, length - 1}:
        assert not is_taken(path, content[:size]), size
    for changed in (damaged, content + b"\0"):
        assert not is_taken(path, changed)
    assert len(list(tmp_path.iterdir())) == 2


def no_links(*_arguments: object) -> None:
    raise PermissionError("this file system has no links")


@pytest.mark.parametrize("has_links", [True, False])
def test_permissions_and_old_versions_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool) -> None:
    if not has_links:
        monkeypatch.setattr(os, "link", no_links)
    content = save_suzanne(tmp_path / "saved.blend")
    path = tmp_path / "out.blend"
    for number in range(4):
        path.write_bytes(f"version {number}".encode())
        path.chmod(0o640)
        with written_whole(path, backups=2) as beside:
            beside.write_bytes(content)
        assert path.read_bytes() == content
        assert path.stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "out.blend1").read_bytes() == b"version 3"
    assert (tmp_path / "out.blend2").read_bytes() == b"version 2"
    assert not (tmp_path / "out.blend3").exists()


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
    mesh_files, one_file = addon.module("command_line.mesh_files"), addon.module("command_line.one_file")

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


@pytest.mark.parametrize("hindered", ["", "os.link", "whole_files.refuse_existing"])
def test_a_file_that_comes_meanwhile_stays(tmp_path: Path, hindered: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when two runs write to one place: the file system has no links, and the file comes after the look for it."""
    if hindered == "os.link":
        monkeypatch.setattr(os, "link", no_links)
    elif hindered:
        monkeypatch.setattr(whole_files, "refuse_existing", lambda *_arguments: None)
    path = tmp_path / "made.obj"

    def write(meanwhile: bool) -> str:
        with written_whole(path, overwrite=False) as beside:
            beside.write_text("second")
            if meanwhile:
                path.write_text("first")
        return path.read_text()

    with pytest.raises(whole_files.UnwrittenError, match="it exists already"):
        write(meanwhile=True)
    assert [each.name for each in tmp_path.iterdir()] == ["made.obj"]
    assert path.read_text() == "first"
    path.unlink()
    assert write(meanwhile=False) == "second"
    assert [each.name for each in tmp_path.iterdir()] == ["made.obj"]
