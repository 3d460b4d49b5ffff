# SPDX-License-Identifier: GPL-3.0-or-later
"""The files an hour of the farm's template with one worker and with two, and a comparison of its report with that of
one command: prints a table.

python benchmarks/farm_throughput.py [FILES]    with the bpy wheel and openjd-cli; CCDEPTH_FARM_BLENDER names a Blender

A worker is a process of ``openjd run`` that does every second task; the report is gathered when all are done. Files are
cubes of 6 faces, so that nearly all time goes into starting Blender, reading, writing and measuring. Prints seconds by
the clock, and processor time.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory
from time import perf_counter

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from tests.farm.files import FARM, OPTIONS, blender, report_of_one_command, write_files

FILES_PER_TASK = 25


def command(files: Path, program: Path, count: int, reports: Path) -> list[str]:
    """``openjd run`` with the parameters of the template."""
    parameters = {
        "FileList": files,
        "Numbers": f"1-{count}",
        "FilesPerTask": FILES_PER_TASK,
        "Options": OPTIONS,
        "ReportFolder": reports,
        "Blender": program,
        "Python": sys.executable,
    }
    given = [argument for name, value in parameters.items() for argument in ("-p", f"{name}={value}")]
    return [sys.executable, "-m", "openjd", "run", str(FARM / "openjd" / "template.yaml"), *given]


def run_farm(base: list[str], count: int, workers: int) -> None:
    """Do all tasks with a number of workers, and then the report."""
    chunks = [(first, min(first + FILES_PER_TASK - 1, count)) for first in range(1, count + 1, FILES_PER_TASK)]
    tasks = [{"Files": f"{first}-{last}"} for first, last in chunks]
    running = [
        subprocess.Popen([*base, "--step", "Files", "--tasks", json.dumps(part)], stdout=subprocess.DEVNULL)
        for part in (tasks[worker::workers] for worker in range(workers))
        if part
    ]
    assert [each.wait() for each in running] == [0] * len(running)
    gather = [*base, "--step", "Report", "--no-run-dependencies"]
    subprocess.run(gather, stdout=subprocess.DEVNULL, check=True)


def main(count: int) -> None:
    with TemporaryDirectory() as scratch:
        folder = Path(scratch)
        files, program = write_files(folder / "files", count), blender(folder)
        (folder / "one").mkdir()
        print(f"{'':<14}{'seconds':>9}{'processor':>11}{'files/h':>9}  report")
        with _row("one command", count):
            expected = report_of_one_command(program, files, folder / "one" / "report.json")
        print("  -")
        for workers in (1, 2):
            reports = folder / f"{workers}"
            with _row(f"{workers} worker{'s' * (workers > 1)}", count):
                run_farm(command(files, program, count, reports), count, workers)
            same = (reports / "report.json").read_bytes() == expected
            print("  the same" if same else "  ANOTHER")


@contextmanager
def _row(name: str, count: int) -> Iterator[None]:
    """Print the time by the clock, and the processor time."""
    begun, worked = perf_counter(), _processor_seconds()
    yield
    seconds, worked = perf_counter() - begun, _processor_seconds() - worked
    print(f"{name:<14}{seconds:>9.1f}{worked:>11.1f}{3600 * count / seconds:>9,.0f}", end="", flush=True)


def _processor_seconds() -> float:
    """The processor time of all ended processes that were started from here."""
    used = getrusage(RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
