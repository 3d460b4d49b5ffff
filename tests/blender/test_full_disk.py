# SPDX-License-Identifier: GPL-3.0-or-later
"""A file that cannot be written as a whole is not written at all: exit status 1, and what was there is still there.

The limit of a process on the size of its files stands in for a full disk: writing fails in the same way.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import bpy
import pytest

from tests.blender import addon

CHECKOUT = Path(__file__).resolve().parents[2]
whole_files = addon.module("command_line.whole_files")
command = addon.module("command_line.command")

# Less than any .blend file and any picture have.
ROOM = 16 * 1024

LINE = ["--relative", "--tolerance", "0.01", "--method", "second-order", "--overwrite"]


def program() -> list[str]:
    """The command line, in a process of its own."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", "--command", "ccdepth"]
    return [sys.executable, str(CHECKOUT / "scripts" / "heat_map.py")]


def run(*arguments: object, room: int | None = None, **options: object) -> subprocess.CompletedProcess[str]:
    def limit() -> None:
        if room is not None:
            # Python ignores this signal, and Blender does not.
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    command = [*program(), *map(str, arguments)]
    options.setdefault("stdout", subprocess.PIPE)
    return subprocess.run(
        command, timeout=300, preexec_fn=limit, text=True, stderr=subprocess.PIPE, check=False, **options
    )


@pytest.mark.parametrize(
    ("option", "name"),
    [
        ("--output", "out.blend"),
        ("--picture", "out.png"),
        ("--subdivide --output", "out.stl"),
        ("--subdivide --output", "out.glb"),
    ],
)
@pytest.mark.parametrize("existing", [b"", b"something precious"])
def test_a_file_that_does_not_fit(tmp_path: Path, option: str, name: str, existing: bytes) -> None:
    path = tmp_path / name
    if existing:
        path.write_bytes(existing)
    ended = run(*LINE, *option.split(), path, room=ROOM)
    assert ended.returncode == 1, ended.stdout + ended.stderr
    assert "Written" not in ended.stdout
    # Python says itself of a file of its own that it is too large.
    assert re.search(rf"{name}: .*(is the disk full|too large)", ended.stderr), ended.stderr
    assert [each.name for each in tmp_path.iterdir()] == ([name] if existing else [])
    assert not existing or path.read_bytes() == existing


def test_files_that_fit(tmp_path: Path) -> None:
    blend, png = tmp_path / "out.blend", tmp_path / "out.png"
    blend.write_bytes(b"an earlier version")
    png.write_bytes(b"an earlier version")
    ended = run(*LINE, "--output", blend, "--picture", png)
    assert ended.returncode == 0, ended.stderr
    assert f"Written: {blend}" in ended.stdout
    assert f"Written: {png}" in ended.stdout
    # Blender keeps as many earlier versions as the preferences say: one.
    assert sorted(each.name for each in tmp_path.iterdir()) == ["out.blend", "out.blend1", "out.png"]
    assert (tmp_path / "out.blend1").read_bytes() == b"an earlier version"
    bpy.ops.wm.open_mainfile(filepath=str(blend))
    assert "ccdepth" in bpy.data.objects["Suzanne"].data.attributes
    assert bpy.data.images.load(str(png)).size[0] > 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_output_that_cannot_be_printed() -> None:
    with open("/dev/full", "w") as full:
        ended = run(*LINE, stdout=full)
    assert ended.returncode == 1
    assert "Traceback" not in ended.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_the_table_of_the_example_that_cannot_be_printed(tmp_path: Path) -> None:
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "cube.blend"), copy=True)
    script = tmp_path / "run.py"
    script.write_text(
        f"import sys; sys.path.insert(0, {str(CHECKOUT)!r})\n"
        "import bpy, ccdepth_addon\n"
        "ccdepth_addon.register()\n"
        f"bpy.ops.wm.open_mainfile(filepath={str(tmp_path / 'cube.blend')!r})\n"
        "sys.argv = ['blender', '--', '0.01']\n"
        "import os, runpy, traceback\n"
        "try:\n"
        f"    runpy.run_path({str(CHECKOUT / 'examples' / 'batch_depth.py')!r})\n"
        "except BaseException:\n"
        "    traceback.print_exc()\n"
        "    os._exit(1)\n"
        "os._exit(0)\n"
    )
    if bpy.app.binary_path:
        pytest.skip("with the bpy module only")
    with open("/dev/full", "w") as full:
        ended = subprocess.run([sys.executable, script], timeout=120, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 1
    assert "No space left" in ended.stderr


def save(path: Path, *, compress: bool) -> bytes:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=compress)
    return path.read_bytes()


def is_taken(path: Path, content: bytes) -> bool:
    """Whether the content takes the place of the file; otherwise the file must stay."""
    path.write_bytes(b"before")
    try:
        with whole_files.written_whole(path) as beside:
            beside.write_bytes(content)
    except whole_files.UnwrittenError:
        assert path.read_bytes() == b"before"
        return False
    assert path.read_bytes() == content
    return True


@pytest.mark.parametrize("compress", [False, True])
def test_a_blend_file_that_is_cut_is_recognised(tmp_path: Path, compress: bool) -> None:
    content = save(tmp_path / "saved.blend", compress=compress)
    path = tmp_path / "out.blend"
    assert is_taken(path, content)
    for size in (0, 5, 12, 20, 64 * 1024, len(content) // 2, len(content) - 30, len(content) - 1):
        assert not is_taken(path, content[:size]), size
    # A hole where a part could not be written, with the end in its place again. Blocks have even sizes: the hole's is
    # odd, as a hole that holds whole blocks and nothing else is not seen.
    assert not is_taken(path, content[: len(content) // 3] + content[len(content) // 3 + 4097 :])
    assert sorted(each.name for each in tmp_path.iterdir()) == ["out.blend", "saved.blend"]


def test_a_picture_that_is_cut_is_recognised(tmp_path: Path) -> None:
    image = bpy.data.images.new("Image", 64, 64)
    image.filepath_raw, image.file_format = str(tmp_path / "saved.png"), "PNG"
    image.save()
    content = (tmp_path / "saved.png").read_bytes()
    path = tmp_path / "out.png"
    assert is_taken(path, content)
    for size in (0, 5, 40, len(content) // 2, len(content) - 1):
        assert not is_taken(path, content[:size]), size
    damaged = bytearray(content)
    damaged[len(content) // 2] ^= 1
    assert not is_taken(path, bytes(damaged))


def test_a_link_stays_a_link_and_permissions_stay(tmp_path: Path) -> None:
    content = save(tmp_path / "saved.blend", compress=True)
    target, link = tmp_path / "target.blend", tmp_path / "link.blend"
    target.write_bytes(b"before")
    target.chmod(0o640)
    link.symlink_to(target)
    with whole_files.written_whole(link) as beside:
        beside.write_bytes(content)
    assert link.is_symlink()
    assert target.read_bytes() == content
    assert target.stat().st_mode & 0o777 == 0o640


def test_an_error_on_the_way_leaves_everything(tmp_path: Path) -> None:
    path = tmp_path / "out.blend"
    path.write_bytes(b"before")

    def half_written() -> None:
        with whole_files.written_whole(path) as beside:
            beside.write_bytes(b"half")
            raise LookupError

    with pytest.raises(LookupError):
        half_written()
    assert [each.name for each in tmp_path.iterdir()] == ["out.blend"]
    assert path.read_bytes() == b"before"


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".glb"])
def test_a_full_disk_is_told_whatever_was_made_of_it(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
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
    assert command.run([*LINE, "--subdivide", "--output", str(tmp_path / f"out{suffix}")], program="ccdepth") == 1
    [error] = [line for line in capfd.readouterr().err.splitlines() if line.startswith("ccdepth: ")]
    assert f"out{suffix}: it could not be written: " in error
    assert error.endswith(("the disk is full", "is the disk full?"))
    assert not list(tmp_path.iterdir())


def test_earlier_versions_move_on(tmp_path: Path) -> None:
    content = save(tmp_path / "saved.blend", compress=True)
    path = tmp_path / "out.blend"
    for number in range(4):
        path.write_bytes(f"version {number}".encode())
        with whole_files.written_whole(path, backups=2) as beside:
            beside.write_bytes(content)
    assert (tmp_path / "out.blend1").read_bytes() == b"version 3"
    assert (tmp_path / "out.blend2").read_bytes() == b"version 2"
    assert not (tmp_path / "out.blend3").exists()


def write_while_another_does(path: Path) -> None:
    with whole_files.written_whole(path, overwrite=False) as beside:
        beside.write_text("second")
        path.write_text("first")


@pytest.mark.parametrize("hindered", ["", "os.link", "whole_files.refuse_existing"])
def test_a_file_that_comes_meanwhile_stays(tmp_path: Path, hindered: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As when two runs write to one place: where the file system has no links, and where the file comes after it was
    looked for."""

    def refuse(*_paths: Path) -> None:
        raise PermissionError

    if hindered == "os.link":
        monkeypatch.setattr(os, "link", refuse)
    elif hindered:
        monkeypatch.setattr(whole_files, "refuse_existing", lambda *_arguments: None)
    path = tmp_path / "made.obj"
    with pytest.raises(whole_files.UnwrittenError, match="it exists already"):
        write_while_another_does(path)
    assert [each.name for each in tmp_path.iterdir()] == ["made.obj"]
    assert path.read_text() == "first"
    path.unlink()
    with whole_files.written_whole(path, overwrite=False) as beside:
        beside.write_text("second")
    assert [each.name for each in tmp_path.iterdir()] == ["made.obj"]
    assert path.read_text() == "second"
