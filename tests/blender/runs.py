# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of the command line, within this process and in others, and files for them."""

import sys
from collections.abc import Sequence
from pathlib import Path

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene

Capture = pytest.CaptureFixture[str]

# A quick run for cubes.
LINE = ["--absolute", "--tolerance", "50mm", "--method", "certified"]

# For what does not depend on the tolerance.
COARSE = ["--absolute", "--tolerance", "500mm", "--method", "certified"]

CHECKOUT = Path(__file__).resolve().parents[2]


def run(*arguments: object, process: Sequence[str] | None = None) -> int:
    """The exit status of the command with these arguments. process: what does the files of ``--jobs``."""
    words = [str(argument) for argument in arguments]
    return addon.module("command_line.command").run(words, program="ccdepth", process=process)


def outputs(capfd: Capture, *arguments: object, status: int = 0) -> tuple[str, str]:
    """What it prints on the standard output and says on the standard error, where it ends with this status."""
    capfd.readouterr()
    assert run(*arguments) == status
    return capfd.readouterr()


def printed(capfd: Capture, *arguments: object, status: int = 0) -> str:
    return outputs(capfd, *arguments, status=status)[0]


def said(capfd: Capture, *arguments: object, status: int = 1) -> str:
    return outputs(capfd, *arguments, status=status)[1]


def program() -> list[str]:
    """The command line, in a process of its own."""
    if bpy.app.binary_path:
        return [bpy.app.binary_path, "-b", "--command", "ccdepth"]
    return [sys.executable, str(CHECKOUT / "scripts" / "heat_map.py")]


def writable(suffix: str) -> bool:
    """Whether this Blender can write such files."""
    calls, files = addon.module("exchange.blender_calls"), addon.module("exchange.mesh_files")
    return suffix == ".blend" or calls.available(files.WRITERS[suffix]) is not None


def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let pictures be rendered quickly."""
    monkeypatch.setattr(addon.module("command_line.picture"), "SAMPLES", 1)


def skip_unwritten(suffix: str) -> None:
    if not writable(suffix):
        pytest.skip(f"this Blender cannot write {suffix} files")


def save(path: Path, **options: bool) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, **options)
    return path


def save_cubes(path: Path, *names: str) -> Path:
    """Cubes of 2 m, 4 m and so on, ten metres from one to the next."""
    scene.clear()
    for index, name in enumerate(names):
        cube = scene.add_object(meshes.cube(), name)
        cube.location.x = 10.0 * index
        cube.scale = (1.0 + index,) * 3
    return save(path)


def mesh_objects(path: Path) -> dict[str, bpy.types.Object]:
    """The mesh objects of a .blend file, which is open afterwards, by name."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return {each.name: each for each in bpy.data.objects if each.type == "MESH"}


def depths_in(path: Path) -> dict[str, list[int]]:
    """The depths on the meshes of a .blend file, which is open afterwards, by object."""
    found = mesh_objects(path)
    return {name: addon.depths(each).tolist() for name, each in found.items() if "ccdepth" in each.data.attributes}
