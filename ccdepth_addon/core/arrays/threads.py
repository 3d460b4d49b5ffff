# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent tasks on several threads: numpy releases the interpreter's lock while it computes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from threading import local
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

SECONDS_BETWEEN_TICKS = 0.05

# More threads than this wait for the interpreter's lock, and each holds the arrays of a task.
MOST_THREADS = 8


def map_in_threads(
    function: Callable[[Task], Result], tasks: Iterable[Task], tick: Callable[[], None]
) -> Iterator[Result]:
    """``function`` of each task, in the order of the tasks, computed a few tasks ahead of the caller.

    tick: called every ``SECONDS_BETWEEN_TICKS`` while a result is being computed; it may raise to stop. Stopping, or
    closing the generator, cancels the tasks that have not begun. Within a task, the tasks are done in its own thread,
    and ``tick`` is not called: waiting for other threads there could take forever.
    """
    if getattr(_own, "is_working", False):
        yield from map(function, tasks)
        return
    waiting: deque[Future[Result]] = deque()
    try:
        for task in tasks:
            waiting.append(_threads().submit(function, task))
            if len(waiting) > 2 * _thread_count():
                yield _result_of(waiting[0], tick)
                waiting.popleft()
        while waiting:
            yield _result_of(waiting[0], tick)
            waiting.popleft()
    finally:
        for future in waiting:
            future.cancel()


_own = local()


def _begin() -> None:
    _own.is_working = True


def _thread_count() -> int:
    return min(MOST_THREADS, os.cpu_count() or 1)


@cache
def _threads() -> ThreadPoolExecutor:
    """Kept between calls: new threads would have to allocate their memory anew."""
    return ThreadPoolExecutor(_thread_count(), initializer=_begin)


def _result_of(future: Future[Result], tick: Callable[[], None]) -> Result:
    while not wait([future], timeout=SECONDS_BETWEEN_TICKS).done:
        tick()
    return future.result()
