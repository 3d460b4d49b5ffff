# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays in chunks, tables, and tasks on several threads."""

import time
from dataclasses import dataclass
from itertools import count, pairwise

import numpy as np
import pytest

from ccdepth_addon.core.arrays.chunks import chunks, index_chunks
from ccdepth_addon.core.arrays.tables import Table
from ccdepth_addon.core.arrays.threads import SECONDS_BETWEEN_TICKS, map_in_threads
from ccdepth_addon.core.arrays.types import BoolArray, FloatArray, IndexArray

# Chunks


@pytest.mark.parametrize(("total", "size"), [(0, 3), (1, 3), (3, 3), (7, 3), (9, 1)])
def test_chunks_cover_everything_once_and_in_order(total: int, size: int) -> None:
    indices = np.random.default_rng(total).permutation(total)
    for parts in ([indices[chunk] for chunk in chunks(total, size)], [*index_chunks(indices, size)]):
        assert [entry for part in parts for entry in part.tolist()] == indices.tolist()
        assert all(0 < len(part) <= size for part in parts)


# Tables


@dataclass(frozen=True)
class Inner(Table, axis=-1):
    values: FloatArray


@dataclass(frozen=True)
class Outer(Table, vectors=-2):
    name: str
    numbers: IndexArray
    vectors: FloatArray
    pair: tuple[Inner, Inner]
    known: BoolArray | None = None


@pytest.mark.parametrize("are_bool", [False, True])
def test_a_table_is_the_join_of_its_parts(are_bool: bool) -> None:
    """Each column along its own axis; what is not a column stays."""
    values = np.arange(60.0)
    inner = Inner(values[:10].reshape(2, 5))
    whole = Outer("name", np.arange(5), values.reshape(4, 5, 3), (inner, Inner(-values[:5])))
    is_first = np.arange(5) < 2
    chosen = (is_first, ~is_first) if are_bool else (np.flatnonzero(is_first), np.flatnonzero(~is_first))
    first, second = (whole.at(each) for each in chosen)
    assert first.name == "name"
    assert first.known is None
    assert first.pair[0].values.tolist() == [[0, 1], [5, 6]]
    assert second.vectors.tolist() == whole.vectors[:, 2:].tolist()
    joined = first.joined([second])
    assert np.array_equal(joined.numbers, whole.numbers)
    assert np.array_equal(joined.vectors, whole.vectors)
    assert all(np.array_equal(one.values, other.values) for one, other in zip(joined.pair, whole.pair, strict=True))


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
