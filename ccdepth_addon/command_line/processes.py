# SPDX-License-Identifier: GPL-3.0-or-later
"""Several processes of Blender, each of which does one file after the other.

A process is given a file as a line on its standard input, a path as JSON, and tells what became of it in a line of its
standard output, after a mark that nothing else prints.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from threading import Lock, local

import bpy

from .arguments import Parser, output_of
from .blender_calls import CommandError
from .report import FileEntry, entry_of_line, stamp

COMMAND_OPTIONS = ("-c", "--command")


@dataclass(frozen=True)
class Done:
    """What was done with a file, and what was printed meanwhile."""

    entry: FileEntry
    output: str
    errors: str


def own_process(command: str) -> list[str]:
    """What runs our command in another process of this Blender, with the options it was started with itself. Raises
    CommandError when this is no program."""
    if not bpy.app.binary_path:
        raise CommandError("--jobs needs Blender's own program")
    options = sys.argv[1:]
    end = next((index for index, option in enumerate(options) if option in COMMAND_OPTIONS), 0)
    return [bpy.app.binary_path, *(options[:end] or ["-b"]), "--command", command]


def process_files(process: Sequence[str], options: Namespace, parser: Parser) -> Iterator[tuple[int, FileEntry]]:
    """Do the files in other processes, several at a time: yields the number of each and what was done with it, in the
    order in which they end. What is printed about a file is printed when it is done."""
    mark = token_hex()
    command = [*process, *parser.arguments_for_others(options), f"--worker={mark}"]
    with (
        _broken_pipes_as_errors(),
        TemporaryDirectory() as folder,
        closing(_Workers(command, mark, Path(folder), options)) as workers,
        ThreadPoolExecutor(options.jobs) as pool,
    ):
        try:
            running = {pool.submit(workers.done, source): number for number, source in enumerate(options.files)}
            for ended in as_completed(running):
                done = ended.result()
                print(done.output, end="", flush=True)
                print(done.errors, end="", flush=True, file=sys.stderr)
                number = running[ended]
                yield number, _as_given(done.entry, options.files[number], options)
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _broken_pipes_as_errors() -> Iterator[None]:
    """Writing to a process that has ended is an error; without this it would end Blender 4.3 as well."""
    if not hasattr(signal, "SIGPIPE"):
        yield
        return
    before = signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    try:
        yield
    finally:
        # None stands for what was not set from Python.
        signal.signal(signal.SIGPIPE, signal.SIG_DFL if before is None else before)


def given_files() -> Iterator[Path]:
    """The files that a process is given by the one that started it."""
    for line in sys.stdin:
        yield Path(json.loads(line))


class _Workers:
    """A process for each thread that asks for something to be done. folder: for what they write to the standard
    error."""

    def __init__(self, command: Sequence[str], mark: str, folder: Path, options: Namespace) -> None:
        self._command, self._mark, self._folder, self._options = command, mark, folder, options
        self._all: list[_Worker] = []
        self._lock = Lock()
        self._of_thread = local()

    def close(self) -> None:
        """Let all processes end."""
        for worker in self._all:
            worker.end()

    def done(self, source: Path) -> Done:
        """What is done with a file by the process of this thread.

        When that process ends meanwhile, and had done other files before, which may be to blame, the file is tried once
        more by a new one, unless it has been written already and may not be replaced.
        """
        worker = self._worker()
        was_new = worker.is_new
        done = worker.done(source)
        if done is None and not was_new and self._may_be_repeated(source):
            worker = self._worker()
            done = worker.done(source)
        return done or worker.failure(source)

    def _worker(self) -> _Worker:
        worker: _Worker | None = getattr(self._of_thread, "worker", None)
        if worker is None or worker.has_ended:
            with self._lock:
                worker = _Worker(self._command, self._mark, self._folder / f"{len(self._all)}.txt")
                self._all.append(worker)
            self._of_thread.worker = worker
        return worker

    def _may_be_repeated(self, source: Path) -> bool:
        output = output_of(source, self._options)
        return self._options.overwrite or output is None or not output.exists()


class _Worker:
    """A process that does one file after the other. errors: what it writes its standard error to."""

    def __init__(self, command: Sequence[str], mark: str, errors: Path) -> None:
        self.is_new = True
        self.has_ended = False
        self._mark = mark
        self._output = ""
        self._errors = errors
        self._errors_told = 0
        with errors.open("wb") as standard_error:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=standard_error,
                encoding="utf-8",
                errors="replace",
            )

    def done(self, source: Path) -> Done | None:
        """What is done with a file; None when the process ends meanwhile."""
        self.is_new = False
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(str(source)) + "\n")
            self._process.stdin.flush()
        for line in self._process.stdout:
            # What Blender itself prints need not end with a line.
            text, mark, answer = line.partition(self._mark)
            self._output += text
            if mark:
                return Done(entry_of_line(answer), self._take_output(), self._take_errors())
        self.end()
        return None

    def failure(self, source: Path) -> Done:
        """What to say of a file, now that its process has ended."""
        output, errors = self._take_output(), self._take_errors()
        error = f"Blender ended with status {self._process.returncode}: {_last(errors)}"
        return Done(FileEntry(stamp(source, None), error=error), output, errors)

    def end(self) -> None:
        """Let the process end once its file is done."""
        self.has_ended = True
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.wait()

    def _take_output(self) -> str:
        output, self._output = self._output, ""
        return output

    def _take_errors(self) -> str:
        """What the process has written to its standard error since the last time."""
        with self._errors.open("rb") as file:
            file.seek(self._errors_told)
            told = file.read()
        self._errors_told += len(told)
        return told.decode(errors="replace")


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
    return next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")
