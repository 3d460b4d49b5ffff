# SPDX-License-Identifier: GPL-3.0-or-later
"""Several Blenders, each doing one file: the same command line with ``--one NUMBER REPORT`` does only the file of that
number, and writes its entry to a report."""

from __future__ import annotations

import subprocess
from argparse import Namespace
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic, sleep

from ..exchange.blender_calls import end_of
from ..exchange.whole_files import remove_left
from .arguments import output_of
from .report import FileEntry, stamp
from .report_reading import ReportError, read_report

# Seconds between looks at the processes, and the seconds for a process to end by itself.
SECONDS_BETWEEN_LOOKS, GRACE = 0.05, 10.0


@dataclass
class _Run:
    """The run of a file. log: its output, the standard error included."""

    number: int
    source: Path
    output: Path | None
    report: Path
    log: Path
    process: subprocess.Popen[bytes]
    begin: float


def process_files(
    process: Sequence[str], options: Namespace, arguments: Sequence[str]
) -> Generator[tuple[int, FileEntry]]:
    """Do each file in another process, several at a time: yields the number and the entry of each, in the order of
    their ends. The output about a file is printed when the file is done. arguments: the command line."""
    waiting, running = list(reversed(range(len(options.files)))), list[_Run]()
    with TemporaryDirectory() as folder:
        try:
            while waiting or running:
                while waiting and len(running) < options.jobs:
                    running.append(_begun(process, options, arguments, waiting.pop(), Path(folder)))
                sleep(SECONDS_BETWEEN_LOOKS)
                for each in [each for each in running if _has_ended(each, options.file_timeout)]:
                    running.remove(each)
                    print(each.log.read_text(encoding="utf-8", errors="replace"), end="", flush=True)
                    yield each.number, _entry(each, options.file_timeout)
        finally:
            for each in running:
                each.process.terminate()
            for each in running:
                with suppress(subprocess.TimeoutExpired):
                    each.process.wait(GRACE)
                each.process.kill()


def _begun(process: Sequence[str], options: Namespace, arguments: Sequence[str], number: int, folder: Path) -> _Run:
    source, report, log = options.files[number], folder / f"{number}.json", folder / f"{number}.txt"
    command = [*process, "--one", str(number), str(report), *arguments]
    with log.open("wb") as file:
        started = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT)
    return _Run(number, source, output_of(source, options), report, log, started, monotonic())


def _has_ended(run: _Run, limit: float | None) -> bool:
    """Whether the process has ended; after the time limit it is killed."""
    if limit and monotonic() - run.begin >= limit:
        run.process.kill()
        run.process.wait()
    return run.process.poll() is not None


def _entry(run: _Run, limit: float | None) -> FileEntry:
    """The entry of a file, with its paths as given; of a process that has written none, the failure."""
    try:
        [entry] = read_report(run.report).files
    except ReportError:
        if run.output is not None:
            remove_left(run.output)
        return FileEntry(stamp(run.source, None), error=_failure(run, limit))
    source = entry.source and replace(entry.source, path=run.source)
    if run.output is None or entry.output is None:
        return replace(entry, source=source)
    companions = (replace(each, path=run.output.with_suffix(each.path.suffix)) for each in entry.companions)
    return replace(entry, source=source, output=replace(entry.output, path=run.output), companions=tuple(companions))


def _failure(run: _Run, limit: float | None) -> str:
    if limit and monotonic() - run.begin >= limit:
        return f"it was not done within {limit:g} seconds"
    return end_of(run.process, run.log)
