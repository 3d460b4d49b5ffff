# SPDX-License-Identifier: GPL-3.0-or-later
"""Run a command that runs pytest, show one line of progress, and end hanging processes.

    python scripts/supervise_tests.py COMMAND [ARGUMENT…]

The command loads `tests.progress`, which reports the work of each process. The whole run has no limit, as a busy
machine needs longer. A process that has been at one test for ten minutes is ended, and so is a command that does not
exit a minute after its last test: Blender as a module can hang on its way out, and a test can hang in C, where no
thread can end it. The status is that of pytest, or 128 and the signal where a crash or this program ended it.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TextIO

TEST_SECONDS = 600.0
EXIT_SECONDS = 60.0
# The seconds between lines without a terminal, and on a terminal.
LINE_SECONDS, TERMINAL_SECONDS = 20.0, 0.5


@dataclass
class Run:
    """The known state of a run: its tests by process, and the time of the last report."""

    total: int = 0
    finished: int = 0
    failed: int = 0
    over: int | None = None
    last: str = "the start"
    heard: float = field(default_factory=time.monotonic)
    running: dict[str, tuple[int, float]] = field(default_factory=dict)

    def take(self, event: dict[str, Any]) -> None:
        """Note one event of `tests.progress`."""
        self.heard = time.monotonic()
        if "total" in event:
            self.total = event["total"]
        elif "start" in event:
            self.running[event["start"]] = (event["pid"], self.heard)
        elif "finish" in event:
            self.running.pop(event["finish"], None)
            self.last = event["finish"]
            self.finished += 1
            if event["failed"]:
                self.failed += 1
                say(f"FAILED {self.last}")
        elif "over" in event:
            self.over = event["over"]

    def line(self, seconds: float) -> str:
        """The line of progress."""
        oldest = min(self.running, key=lambda name: self.running[name][1], default="")
        return f"{self.finished:,} of {self.total:,} tests, {self.failed} failed, {seconds:.0f} s  {oldest}"


def say(text: str) -> None:
    """Write a line of its own."""
    print(f"\r\033[K{text}" if sys.stdout.isatty() else text, flush=True)


def show(text: str) -> None:
    """Write the line of progress, on a terminal over the one before."""
    if sys.stdout.isatty():
        width = os.get_terminal_size().columns
        print(f"\r\033[K{text[: width - 1]}", end="", flush=True)
    else:
        print(text, flush=True)


def end_hanging_tests(run: Run) -> None:
    """End processes that have been at one test for too long; pytest's other processes go on and report the test."""
    for name, (pid, since) in list(run.running.items()):
        if time.monotonic() - since > TEST_SECONDS:
            say(f"ENDED after {TEST_SECONDS / 60:.0f} minutes: {name}")
            del run.running[name]
            run.failed += 1
            run.heard = time.monotonic()
            end(pid)


def end(pid: int) -> None:
    """End a process that may be gone already."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def events_in(file: TextIO) -> Iterator[dict[str, Any]]:
    """The events written since the last call, none of them halved."""
    while (line := file.readline()).endswith("\n"):
        yield json.loads(line)
    file.seek(file.tell() - len(line.encode()))


def watch(process: subprocess.Popen[bytes], events: TextIO) -> Run:
    """Follow the run until the command has exited or hangs."""
    run, started, shown = Run(), time.monotonic(), 0.0
    interval = TERMINAL_SECONDS if sys.stdout.isatty() else LINE_SECONDS
    while process.poll() is None:
        for event in events_in(events):
            run.take(event)
        end_hanging_tests(run)
        silent = time.monotonic() - run.heard
        if not run.running and silent > (TEST_SECONDS if run.over is None else EXIT_SECONDS):
            say(f"ENDED: nothing was heard for {silent:.0f} s after {run.last}")
            break
        if run.total and run.over is None and time.monotonic() - shown > interval:
            shown = time.monotonic()
            show(run.line(shown - started))
        time.sleep(0.1)
    for event in events_in(events):
        run.take(event)
    return run


def supervise(command: list[str]) -> int:
    """Run the command; returns its status, or pytest's if the command did not exit."""
    with tempfile.NamedTemporaryFile("r", suffix=".jsonl", encoding="utf-8") as events:
        environment = {**os.environ, "CCDEPTH_PROGRESS": events.name}
        process = subprocess.Popen(command, env=environment, start_new_session=True)
        try:
            run = watch(process, events)
        except KeyboardInterrupt:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(EXIT_SECONDS)
            raise SystemExit(130) from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    status = process.wait()
    if run.over is not None:
        return run.over
    at = f"during {', '.join(run.running)}" if run.running else f"after {run.last}"
    say(f"pytest ended {at} with status {status}")
    return 128 - status if status < 0 else status or 1


if __name__ == "__main__":
    raise SystemExit(supervise(sys.argv[1:]))
