# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes of Blender, each with one file after the other."""

from __future__ import annotations

import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy

from .arguments import Parser, output_of
from .blender_calls import CommandError
from .report import FileEntry, ReportError, read_report, stamp

COMMAND_OPTIONS = ("-c", "--command")


def own_process(command: str) -> list[str]:
    """What runs our command in another process of this Blender, with the options it was started with itself. Raises
    CommandError when this is no program."""
    if not bpy.app.binary_path:
        raise CommandError("--jobs needs Blender's own program")
    options = sys.argv[1:]
    end = next((index for index, option in enumerate(options) if option in COMMAND_OPTIONS), 0)
    return [bpy.app.binary_path, *(options[:end] or ["-b"]), "--command", command]


def process_files(process: Sequence[str], options: Namespace, parser: Parser) -> Iterator[tuple[int, FileEntry]]:
    """Do each file in a process of its own, several at a time: yields the number of each and what was done with it, in
    the order in which they end. What they print is printed when they have ended."""
    # A report makes each process measure what it has written.
    report = "--json" if options.json or options.csv else "--entry"
    command = [*process, *parser.arguments_for_one(options), report]
    with TemporaryDirectory() as folder, ThreadPoolExecutor(options.jobs) as pool:
        try:
            running = {
                pool.submit(_processed, command, source, Path(folder) / f"{number}.json"): number
                for number, source in enumerate(options.files)
            }
            for ended in as_completed(running):
                process_ended, entry = ended.result()
                print(process_ended.stdout, end="", flush=True)
                print(process_ended.stderr, end="", flush=True, file=sys.stderr)
                number = running[ended]
                yield number, _as_given(entry, options.files[number], options)
        finally:
            pool.shutdown(cancel_futures=True)


def _processed(
    command: Sequence[str], source: Path, report: Path
) -> tuple[subprocess.CompletedProcess[str], FileEntry]:
    """The process for a file when it has ended, and its entry in the report."""
    ended = subprocess.run(
        [*command, str(report), "--", str(source)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    try:
        [entry] = read_report(report).files
    except (OSError, ReportError):
        error = f"Blender ended with status {ended.returncode}: {_last(ended.stderr)}"
        entry = FileEntry(stamp(source, None), error=error)
    return ended, entry


def _as_given(entry: FileEntry, source: Path, options: Namespace) -> FileEntry:
    """The entry with the names of files as they were given."""
    output = output_of(source, options)
    return replace(
        entry,
        source=entry.source and replace(entry.source, path=source),
        output=replace(entry.output, path=output) if entry.output and output else None,
    )


def _last(text: str) -> str:
    lines = text.split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it has said nothing")
