# SPDX-License-Identifier: GPL-3.0-or-later
"""Several Blenders, each doing one file after the other.

Each is started with the same command line and ``--worker MARK``. Its standard input gives the numbers of files as
lines. It answers each with a line of its standard output, after the mark, which nothing else prints. Its standard input
ends with the process that started it, and the worker then ends as well.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from _thread import interrupt_main
from argparse import Namespace
from base64 import b64decode, b64encode
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from queue import SimpleQueue
from secrets import token_hex
from threading import TIMEOUT_MAX, Thread, Timer
from time import monotonic, sleep

import bpy

from .arguments import output_of
from .blender_calls import CommandError
from .report import FileEntry, stamp
from .scripted_drivers import ENDS
from .whole_files import remove_left

# The time for a process to end by itself, in seconds.
GRACE = 5.0


def own_process(command: str) -> list[str]:
    """The line that runs our command in another process of this Blender, with this Blender's own options. Raises
    CommandError if this Blender is no program."""
    if not bpy.app.binary_path:
        raise CommandError("--jobs needs Blender's own program")
    options = sys.argv[1:]
    end = next((index for index, option in enumerate(options) if option in ENDS), 0)
    return [bpy.app.binary_path, *(options[:end] or ["-b"]), "--command", command]


def process_files(
    process: Sequence[str], options: Namespace, arguments: Sequence[str]
) -> Generator[tuple[int, FileEntry]]:
    """Do the files in other processes, several at a time: yields the number and the entry of each, in the order of
    their ends. The output about a file is printed when the file is done. arguments: the command line."""
    mark = token_hex()
    command = [*process, f"--worker={mark}", *arguments]
    workers = [_Worker(command, mark, options) for _ in options.files[: options.jobs]]
    idle: SimpleQueue[_Worker] = SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def done(number: int) -> tuple[int, FileEntry, str]:
        worker = idle.get()
        try:
            return number, *worker.done(number)
        except Exception as fault:
            # Whatever it is, the other files are done.
            return number, worker.failed(number, str(fault)), ""
        finally:
            idle.put(worker)

    with ThreadPoolExecutor(len(workers)) as pool:
        try:
            for ended in as_completed([pool.submit(done, number) for number in range(len(options.files))]):
                number, entry, output = ended.result()
                print(output, end="", flush=True)
                yield number, entry
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in workers:
                worker.let_end()
            for worker in workers:
                worker.end()


def given_numbers() -> Iterator[int]:
    """The numbers of files from the process that started this one. Once that process has gone, work on a file is broken
    off."""
    numbers: SimpleQueue[int | None] = SimpleQueue()

    def read() -> None:
        for line in sys.stdin:
            numbers.put(int(line))
        numbers.put(None)
        interrupt_main(signal.SIGTERM)
        sleep(GRACE)
        os._exit(signal.SIGTERM)

    Thread(target=read, daemon=True).start()
    while (number := numbers.get()) is not None:
        yield number


def answer(mark: str, entry: FileEntry) -> str:
    """The line that answers with the entry of a file."""
    return f"{mark}{b64encode(pickle.dumps(entry)).decode()}"


class _Worker:
    """A process for files, replaced by another after a file that ends it."""

    def __init__(self, command: Sequence[str], mark: str, options: Namespace) -> None:
        self._command, self._mark, self._options = command, mark, options
        self._process: subprocess.Popen[str] | None = None
        self._may_start = True

    def done(self, number: int) -> tuple[FileEntry, str]:
        """The entry of a file, and the output printed meanwhile. If the process ends meanwhile after other files, which
        may be to blame, a new process tries the file once more."""
        is_new, begin, limit = self._process is None, monotonic(), self._options.file_timeout
        if self._process is None:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                encoding="utf-8",
                errors="replace",
            )
        process = self._process
        entry, output = self._answered(process, number)
        if entry is not None:
            return entry, output
        status, self._process = process.wait(), None
        if limit and monotonic() - begin >= limit:
            return self.failed(number, f"it was not done within {limit:g} seconds"), output
        if self._may_start and not is_new:
            return self.done(number)
        last = next((line.strip() for line in reversed(output.split("\n")) if line.strip()), "it printed nothing")
        return self.failed(number, f"Blender ended with status {status}: {last}"), output

    def _answered(self, process: subprocess.Popen[str], number: int) -> tuple[FileEntry | None, str]:
        """A process's entry of a file, None if the process ends before, and the output printed meanwhile."""
        assert process.stdin is not None
        assert process.stdout is not None
        output, timer = "", Timer(min(self._options.file_timeout or 0.0, TIMEOUT_MAX), process.kill)
        if self._options.file_timeout:
            timer.start()
        try:
            with suppress(BrokenPipeError):
                print(number, file=process.stdin, flush=True)
            for line in process.stdout:
                # Blender's own output need not end with a line break.
                text, mark, said = line.partition(self._mark)
                output += text
                if mark:
                    return pickle.loads(b64decode(said)), output
        finally:
            timer.cancel()
        return None, output

    def failed(self, number: int, error: str) -> FileEntry:
        source = self._options.files[number]
        output = output_of(source, self._options)
        if output is not None:
            # Whatever the process has left there goes.
            remove_left(output)
        return FileEntry(stamp(source, None), error=error)

    def let_end(self) -> None:
        """Tell the process that there is nothing more to do."""
        self._may_start = False
        if self._process is not None and self._process.stdin is not None:
            with suppress(BrokenPipeError):
                self._process.stdin.close()

    def end(self) -> None:
        """Wait for the end of the process, and end it if it does not end by itself."""
        process = self._process
        if process is not None:
            try:
                process.wait(2 * GRACE)
            except subprocess.TimeoutExpired:
                process.kill()
