# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent blocks of work on all processors: numpy lets go of the interpreter while it computes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from typing import TypeVar

Work = TypeVar("Work")
Result = TypeVar("Result")

SECONDS_BETWEEN_SIGNS_OF_LIFE = 0.05

# More threads than this wait for the interpreter, and each holds a block's arrays.
MOST_THREADS = 8


def in_parallel(function: Callable[[Work], Result], work: Iterable[Work]) -> Generator[Result | None, None, None]:
    """``function`` of each piece of work, in order, worked out a few pieces ahead of the caller.

    While a result takes its time there is None instead, every now and then. When the caller stops asking, what has not
    begun is dropped.
    """
    waiting: deque[Future[Result]] = deque()
    try:
        for piece in work:
            waiting.append(_threads().submit(function, piece))
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
    """The threads, kept: new ones would have to get their memory from the system anew."""
    return ThreadPoolExecutor(_thread_count())


def _result_of(future: Future[Result]) -> Iterator[Result | None]:
    while not wait([future], timeout=SECONDS_BETWEEN_SIGNS_OF_LIFE).done:
        yield None
    yield future.result()
