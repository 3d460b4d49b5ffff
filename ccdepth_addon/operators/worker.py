# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in a thread, as steps for ``Stepwise``: the window stays free while the core computes.

Only work without Blender may run in a thread. Its progress function raises ``Cancelled`` once the caller has given up.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from typing import Generic, TypeVar

from ..core import Progress, no_report

Answer = TypeVar("Answer")

# Seconds between looks at the thread.
SECONDS_TO_WAIT = 0.02


class Cancelled(Exception):
    """The caller has given up."""


class _Thread(threading.Thread, Generic[Answer]):
    """The work, its progress, and its end."""

    def __init__(self, work: Callable[[Progress], Answer]) -> None:
        super().__init__(name="CC Depth")
        self.progress = 0.0
        self.answer: Answer
        self.fault: BaseException | None = None
        self.is_wanted = True
        self._work = work

    def run(self) -> None:
        try:
            self.answer = self._work(self._report)
        except BaseException as fault:
            self.fault = fault
        finally:
            _threads.discard(self)

    def _report(self, progress: float) -> None:
        if not self.is_wanted:
            raise Cancelled
        self.progress = progress


_threads: set[_Thread] = set()


def in_thread(work: Callable[[Progress], Answer]) -> Generator[float, None, Answer]:
    """Run the work in a thread: yields its progress, and returns its answer or raises what it raises. Closing the
    generator cancels the work."""
    thread = _Thread(work)
    _threads.add(thread)
    thread.start()
    try:
        while thread.is_alive():
            yield thread.progress
            thread.join(SECONDS_TO_WAIT)
    finally:
        thread.is_wanted = False
    if thread.fault is not None:
        raise thread.fault
    return thread.answer


def at_once(work: Callable[[Progress], Answer]) -> Generator[float, None, Answer]:
    """Run the work without a thread, in one step."""
    yield 0.0
    return work(no_report)


def stop_all() -> None:
    """Cancel all work, and wait for its end."""
    for thread in list(_threads):
        thread.is_wanted = False
        thread.join()
