# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent tasks on several threads: numpy releases the interpreter's lock while it computes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

SECONDS_BETWEEN_PROGRESS = 0.05

# More threads than this wait for the interpreter's lock, and each holds the arrays of a task.
MOST_THREADS = 8


def map_in_threads(function: Callable[[Task], Result], tasks: Iterable[Task]) -> Generator[Result | None, None, None]:
    """``function`` of each task, in the order of the tasks, computed a few tasks ahead of the caller.

    While a result is being computed None is yielded every ``SECONDS_BETWEEN_PROGRESS``, so that the caller can report
    progress or cancel. Closing the generator cancels the tasks that have not begun.
    """
    waiting: deque[Future[Result]] = deque()
    try:
        for task in tasks:
            waiting.append(_threads().submit(function, task))
            if len(waiting) > 2 * _thread_count():
                yield from _result_of(waiting[0])
                waiting.popleft()
        while waiting:
            yield from _result_of(waiting[0])
            waiting.popleft()
    finally:
        for future in waiting:
            future.cancel()


def _thread_count() -> int:
    return min(MOST_THREADS, os.cpu_count() or 1)


@cache
def _threads() -> ThreadPoolExecutor:
    """Kept between calls: new threads would have to allocate their memory anew."""
    return ThreadPoolExecutor(_thread_count())


def _result_of(future: Future[Result]) -> Iterator[Result | None]:
    while not wait([future], timeout=SECONDS_BETWEEN_PROGRESS).done:
        yield None
    yield future.result()
