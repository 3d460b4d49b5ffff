# SPDX-License-Identifier: GPL-3.0-or-later
"""Long runs as steps: a generator yields the next step as a text, or work without Blender, and receives the work's
answer. A job runs all steps at once, or for a while at a time with the work in a thread, so that the window stays free.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import Any, Generic, TypeVar

from ..core import Progress

Answer = TypeVar("Answer")

# Seconds between looks at a thread.
SECONDS_TO_WAIT = 0.02


class Cancelled(Exception):
    """The error that the progress function raises in abandoned work."""


@dataclass(frozen=True)
class Work:
    """Work without Blender. text: of its progress. total: the progress at its end, if known."""

    function: Callable[[Progress], Any]
    text: Callable[[float], str]
    total: float | None = None


Steps = Generator[str | Work, Any, Answer]


class Job(Generic[Answer]):
    """The steps, their progress, and the answer at their end."""

    def __init__(self, steps: Steps[Answer], *, in_threads: bool = False) -> None:
        self.answer: Answer | None = None
        self.is_done = False
        self._steps, self._in_threads = steps, in_threads
        self._step: str | Work | None = None
        self._thread: _Thread | None = None

    @property
    def text(self) -> str | None:
        """The next step in words, or the progress of the work."""
        return self._step.text(self._progress) if isinstance(self._step, Work) else self._step

    @property
    def is_working(self) -> bool:
        """Whether work without Blender is going on; temporary data in the file are then outside all scenes."""
        return isinstance(self._step, Work)

    @property
    def fraction(self) -> float | None:
        """The fraction of the work done, if known."""
        total = self._step.total if isinstance(self._step, Work) else None
        return min(self._progress / total, 1.0) if total else None

    @property
    def _progress(self) -> float:
        return 0.0 if self._thread is None else self._thread.progress

    def run(self, seconds: float = inf) -> bool:
        """Go on for a number of seconds; True when done. Raises errors of the steps and their work."""
        until = perf_counter() + seconds
        while not self.is_done and perf_counter() < until:
            if not isinstance(self._step, Work):
                self._go_on(self._steps.send, None)
            elif self._thread is None:
                self._thread = _Thread(self._step.function)
                (self._thread.start if self._in_threads else self._thread.run)()
            elif self._thread.is_alive():
                self._thread.join(SECONDS_TO_WAIT)
            else:
                thread, self._thread = self._thread, None
                # The steps may clean up after a fault.
                if thread.fault is not None:
                    self._go_on(self._steps.throw, thread.fault)
                else:
                    self._go_on(self._steps.send, thread.answer)
        return self.is_done

    def _go_on(self, resume: Callable[[Any], str | Work], given: Any) -> None:
        try:
            self._step = resume(given)
        except StopIteration as finished:
            self.answer, self.is_done = finished.value, True

    def give_up(self) -> None:
        """End the unfinished work, and free what it holds."""
        if self._thread is not None:
            self._thread.is_wanted = False
        self._steps.close()


class _Thread(threading.Thread):
    """Work, its progress, and its end; begun in a thread, or done at once."""

    def __init__(self, function: Callable[[Progress], Any]) -> None:
        super().__init__(name="CC Depth")
        self.progress = 0.0
        self.answer: Any = None
        self.fault: BaseException | None = None
        self.is_wanted = True
        self._function = function

    def run(self) -> None:
        _threads.add(self)
        try:
            self.answer = self._function(self._report)
        except BaseException as fault:
            self.fault = fault
        finally:
            _threads.discard(self)

    def _report(self, progress: float) -> None:
        if not self.is_wanted:
            raise Cancelled
        self.progress = progress


_threads: set[_Thread] = set()


def stop_all() -> None:
    """Cancel all work, and wait for its end."""
    for thread in list(_threads):
        thread.is_wanted = False
        thread.join()
