# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays in chunks, and tasks on several threads."""

import time
from itertools import count, pairwise

import numpy as np
import pytest

from ccdepth_addon.core.arrays.chunks import chunks, index_chunks
from ccdepth_addon.core.arrays.threads import SECONDS_BETWEEN_TICKS, map_in_threads

# Chunks


@pytest.mark.parametrize(("total", "size"), [(0, 3), (1, 3), (3, 3), (7, 3), (9, 1)])
def test_chunks_cover_everything_once_and_in_order(total: int, size: int) -> None:
    indices = np.random.default_rng(total).permutation(total)
    for parts in ([indices[chunk] for chunk in chunks(total, size)], [*index_chunks(indices, size)]):
        assert [entry for part in parts for entry in part.tolist()] == indices.tolist()
        assert all(0 < len(part) <= size for part in parts)


def test_results_come_in_order() -> None:
    def slower_first(number: int) -> int:
        time.sleep(0.01 * (3 - number % 4))
        return number

    assert [*map_in_threads(slower_first, range(50), lambda: None)] == [*range(50)]
    assert [*map_in_threads(str, (), lambda: None)] == []


@pytest.mark.parametrize("tasks", [1, 2, 9])
def test_progress_while_a_task_runs(tasks: int) -> None:
    """However few tasks there are."""

    def slow(number: int) -> int:
        time.sleep(6 * SECONDS_BETWEEN_TICKS)
        return number

    ticks = [time.perf_counter()]
    assert [*map_in_threads(slow, range(tasks), lambda: ticks.append(time.perf_counter()))] == [*range(tasks)]
    assert len(ticks) > 3
    pauses = [after - before for before, after in pairwise(ticks)]
    # Twice as long, for a machine that is busy.
    assert sorted(pauses)[len(pauses) // 2] < 2 * SECONDS_BETWEEN_TICKS


def test_tasks_that_have_not_begun_are_cancelled() -> None:
    begun = []

    def begin(number: int) -> int:
        begun.append(number)
        # But for the first, all threads are at work when the others are cancelled.
        time.sleep(SECONDS_BETWEEN_TICKS * bool(number))
        return number

    results = map_in_threads(begin, count(), lambda: None)
    assert next(results) == 0
    results.close()
    time.sleep(SECONDS_BETWEEN_TICKS / 2)
    after = len(begun)
    time.sleep(4 * SECONDS_BETWEEN_TICKS)
    assert len(begun) == after


def test_errors_reach_the_caller() -> None:
    def failing(number: int) -> int:
        raise ValueError(number)

    with pytest.raises(ValueError, match="7"):
        list(map_in_threads(failing, [7], lambda: None))
