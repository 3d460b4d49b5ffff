# SPDX-License-Identifier: GPL-3.0-or-later
"""Independent blocks of work on all processors: numpy lets go of the interpreter while it computes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
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
    threads = min(MOST_THREADS, os.cpu_count() or 1)
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(threads)
    try:
        for piece in work:
            waiting.append(pool.submit(function, piece))
            if len(waiting) > 2 * threads:
                yield from _result_of(waiting.popleft())
        while waiting:
            yield from _result_of(waiting.popleft())
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _result_of(future: Future[Result]) -> Iterator[Result | None]:
    while not wait([future], timeout=SECONDS_BETWEEN_SIGNS_OF_LIFE).done:
        yield None
    yield future.result()
