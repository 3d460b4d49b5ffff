# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs of the command line within this process, and files for them."""

from __future__ import annotations

from pathlib import Path

import bpy
import pytest

from tests import meshes
from tests.blender import addon, scene


def run(*arguments: object) -> int:
    """The exit status of the command with these arguments."""
    return addon.module("command_line.command").run([str(argument) for argument in arguments], program="ccdepth")


def skip_unless_written(suffix: str) -> None:
    """Skip the test where this Blender cannot write such files."""
    calls, files = addon.module("command_line.blender_calls"), addon.module("command_line.mesh_files")
    if suffix != ".blend" and calls.available(files.WRITERS[suffix]) is None:
        pytest.skip(f"this Blender cannot write {suffix} files")


def save(path: Path) -> Path:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def save_cubes(path: Path, *names: str) -> Path:
    """Cubes of 2 m, 4 m and so on, ten metres from one to the next."""
    scene.clear()
    for index, name in enumerate(names):
        cube = scene.add_object(meshes.cube(), name)
        cube.location.x = 10.0 * index
        cube.scale = (1.0 + index,) * 3
    return save(path)
