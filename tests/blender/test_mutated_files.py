# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of each format that are broken at random, done by the command line in processes of their own.

What comes of a file is its own failure, a crash or a hanging of Blender's importer included. Nothing of ours ends in a
traceback, and what is said to be met is proved once more.
"""

from __future__ import annotations

import json
import random
import re
import resource
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests import meshes
from tests.blender import addon, scene
from tests.blender.runs import program, save

pytestmark = pytest.mark.thorough

blender_calls = addon.module("command_line.blender_calls")

# Of each format, in parts that are short enough for a slice.
COUNT, PARTS = 200, 5

# The operators that write the files, and their options.
WRITERS: dict[str, tuple[str, dict[str, Any]]] = {
    ".blend": ("", {}),
    ".obj": ("wm.obj_export", {}),
    ".ply": ("wm.ply_export", {"ascii_format": True}),
    ".stl": ("wm.stl_export", {}),
    ".glb": ("export_scene.gltf", {"export_format": "GLB"}),
    ".gltf": ("export_scene.gltf", {"export_format": "GLTF_SEPARATE"}),
    ".usda": ("wm.usd_export", {}),
    ".usdc": ("wm.usd_export", {}),
    ".usdz": ("wm.usd_export", {}),
    ".fbx": ("export_scene.fbx", {}),
    ".abc": ("wm.alembic_export", {"as_background_job": False}),
}

# In bytes: a number that was changed may ask for any amount.
MOST_MEMORY = 8 << 30

SECONDS = 60


def write(path: Path) -> None:
    """Two meshes with UV maps and colours."""
    scene.clear()
    for data in (meshes.cube(), meshes.landscape(2, 1)):
        holder = scene.add_object(data)
        holder.data.uv_layers.new()
        holder.data.color_attributes.new("Color", "BYTE_COLOR", "POINT")
    operator, options = WRITERS[path.suffix]
    if path.suffix == ".blend":
        save(path, compress=False)
    elif (call := blender_calls.available(operator)) is None:
        pytest.skip(f"this Blender cannot write {path.suffix} files")
    else:
        call(filepath=str(path), **options)


def flipped(content: bytearray, chance: random.Random) -> None:
    for _ in range(chance.choice((1, 1, 4, 64))):
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)


def cut(content: bytearray, chance: random.Random) -> None:
    del content[chance.randrange(len(content)) :]


def without_a_part(content: bytearray, chance: random.Random) -> None:
    start = chance.randrange(len(content))
    del content[start : start + chance.choice((1, 4, 64, 1024))]


def with_a_part_twice(content: bytearray, chance: random.Random) -> None:
    start = chance.randrange(len(content))
    content[start:start] = content[start : start + chance.choice((1, 4, 64, 1024))]


def with_another_number(content: bytearray, chance: random.Random) -> None:
    """As text where there are numbers as text, else four bytes."""
    found = list(re.finditer(rb"(?<![\w.])-?\d+(\.\d+)?", content))
    if content[:1000].isascii() and found:
        number = chance.choice(found)
        others = (b"-1", b"0", b"nan", b"inf", b"1e38", b"-1e-45", b"99999999999", b"4294967295", b"x\xff", b"")
        content[number.start() : number.end()] = chance.choice(others)
    else:
        start = 4 * chance.randrange(len(content) // 4)
        numbers = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\xff\x7f")
        content[start : start + 4] = chance.choice(numbers)


# The last one is likelier.
MUTATIONS = (flipped, cut, without_a_part, with_a_part_twice, with_another_number, with_another_number)


def little_memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("suffix", WRITERS)
def test_files_that_are_broken_at_random(tmp_path: Path, suffix: str, part: int) -> None:
    original = tmp_path / f"original{suffix}"
    write(original)
    chance = random.Random(f"{suffix} {part}")
    sources = []
    for number in range(COUNT // PARTS):
        content = bytearray(original.read_bytes())
        chance.choice(MUTATIONS)(content, chance)
        path = tmp_path / f"{number:03}{suffix}"
        path.write_bytes(content)
        sources.append(path.name)
    report, line = "report.json", ["--subdivide", "--tolerance", "10%", "--max-faces", "2000"]
    line += ["--output-folder", "made", "--format", "stl", "--jobs", "2", "--file-timeout", str(SECONDS)]
    command = [*program(), *line, "--json", report, "--", *sources]
    ended = run_in(tmp_path, command)
    assert ended.returncode in (0, 1), ended.stdout[-2000:]
    assert not re.findall(r'File ".*ccdepth.*', ended.stdout)
    entries = json.loads((tmp_path / report).read_text(encoding="utf-8"))["files"]
    assert [each["input"]["path"] for each in entries] == sources
    for entry in entries:
        assert not re.match(r"\w+(Error|Exception|Exit)\b|ccdepth\..* went wrong", entry["error"] or ""), entry
    made = {f"{Path(entry['input']['path']).stem}.stl" for entry in entries if entry["output"]}
    assert {each.name for each in (tmp_path / "made").iterdir()} == made
    print(f"{suffix}: {len(made)} of {len(sources)} files could be done")
    # Those that are said to be well are so by themselves.
    good = [entry for entry in entries if entry["met"]]
    assert all(each["met"] for entry in good for each in entry["objects"])
    content = json.loads((tmp_path / report).read_text(encoding="utf-8"))
    # Each by a new process: a broken .blend file harms what Blender reads after it.
    for entry in good:
        (tmp_path / "good.json").write_text(json.dumps(content | {"files": [entry], "met": True}), encoding="utf-8")
        checked = run_in(tmp_path, [*program(), "--verify", "good.json"])
        assert checked.returncode == 0, checked.stdout[-2000:]


def run_in(folder: Path, command: list[str]) -> subprocess.CompletedProcess[str]:
    ways = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
    return subprocess.run(command, cwd=folder, timeout=3600, preexec_fn=little_memory, check=False, **ways)
