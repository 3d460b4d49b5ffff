# SPDX-License-Identifier: GPL-3.0-or-later
"""The time of many files with one Blender and with two at a time (``--jobs``): prints a table.

python benchmarks/jobs.py BLENDER [FILES] [RUNS]    BLENDER: a program with the extension installed

Each file is a hilly grid of 30,000 quads, made adaptive and written as .stl, without being measured. Every row is the
fastest of the runs, which take turns, with the time of the slowest. The machine has to be idle: on a busy one, Linux
gives a session its share regardless of its number of processes (autogroups), and two are no faster.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.hills import hills

SIDE = 172
LINE = ("--subdivide", "--tolerance", "0.002", "--absolute", "--format", "stl", "--overwrite")
WAYS = {"one Blender": (), "--jobs 1": ("--jobs", "1"), "--jobs 2": ("--jobs", "2")}


def write_files(folder: Path, count: int) -> list[Path]:
    """Grids of different heights as .obj files."""
    positions, quads = hills(SIDE, 100)
    paths = [folder / f"hills {number:02}.obj" for number in range(count)]
    for number, path in enumerate(paths):
        with path.open("w") as file:
            np.savetxt(file, positions * (1.0, 1.0, 1.0 + 0.02 * number), fmt="v %.6f %.6f %.6f")
            np.savetxt(file, quads + 1, fmt="f %d %d %d %d")
    return paths


def times(blender: Path, line: list[str]) -> tuple[float, float]:
    """Seconds by the clock, and of processors' work."""
    begun, worked = perf_counter(), _processor_seconds()
    subprocess.run([str(blender), "-b", "--command", "ccdepth", *line], check=True, capture_output=True)
    return perf_counter() - begun, _processor_seconds() - worked


def _processor_seconds() -> float:
    used = getrusage(RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(blender: Path, count: int, runs: int) -> None:
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        sources = [str(path) for path in write_files(folder, count)]
        found: dict[str, list[tuple[float, float]]] = {name: [] for name in WAYS}
        for _ in range(runs):
            for name, options in WAYS.items():
                line = [*LINE, "--output-folder", str(folder / "made"), *options, "--", *sources]
                found[name].append(times(blender, line))
    print(f"{'':<12}{'seconds':>9}{'slowest':>9}{'processor':>11}{'files/h':>9}")
    for name, measured in found.items():
        (seconds, worked), slowest = min(measured), max(measured)[0]
        print(f"{name:<12}{seconds:>9.1f}{slowest:>9.1f}{worked:>11.1f}{3600 * count / seconds:>9,.0f}")


if __name__ == "__main__":
    numbers = [int(each) for each in sys.argv[2:]]
    main(Path(sys.argv[1]), *(numbers + [12, 3][len(numbers) :]))
