# SPDX-License-Identifier: GPL-3.0-or-later
"""Files for a farm to do, and Blender as a farm starts it."""

import os
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
FARM = CHECKOUT / "farm"

# With the last corner moved outwards, so that no two files are the same.
CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 {corner}\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""

OPTIONS = "--subdivide --absolute --tolerance 0.05 --output-folder ../made --overwrite --format stl"


def write_files(folder: Path, count: int, broken: int | None = None) -> Path:
    """The list of so many cubes as .obj files; the one of this number cannot be read."""
    folder.mkdir()
    names = []
    for number in range(count):
        names.append(f"part {number:03}.obj")
        text = "this is no mesh\n" if number == broken else CUBE.format(corner=1 + number / count)
        (folder / names[-1]).write_text(text)
    files = folder / "files.txt"
    files.write_text("".join(f"{name}\n" for name in names))
    return files


def blender(folder: Path) -> Path:
    """A program that understands ``-b --command ccdepth``: CCDEPTH_FARM_BLENDER, or one that uses the bpy module."""
    if "CCDEPTH_FARM_BLENDER" in os.environ:
        return Path(os.environ["CCDEPTH_FARM_BLENDER"])
    program = folder / "blender"
    program.write_text(f'#!/bin/sh\nshift 3\nexec "{sys.executable}" "{CHECKOUT / "scripts" / "heat_map.py"}" "$@"\n')
    program.chmod(0o755)
    return program


def report_of_one_command(program: Path, files: Path, report: Path) -> bytes:
    """The report of the files of a list, done by one command."""
    names = files.read_text().splitlines()
    command = [str(program), "-b", "--command", "ccdepth", *OPTIONS.split(), "--json", str(report), "--", *names]
    subprocess.run(command, cwd=files.parent, timeout=300, check=False, capture_output=True)
    return report.read_bytes()
