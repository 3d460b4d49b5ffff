# SPDX-License-Identifier: GPL-3.0-or-later
"""Work on several threads: in order, with signs of life, and dropped when nobody asks for it any more."""

from __future__ import annotations

import time
from itertools import count

import pytest

from ccdepth_addon.core.arrays.threads import SECONDS_BETWEEN_SIGNS_OF_LIFE, in_parallel


def test_results_come_in_order() -> None:
    def slower_first(number: int) -> int:
        time.sleep(0.01 * (3 - number % 4))
        return number

    found = in_parallel(slower_first, range(50))
    assert [result for result in found if result is not None] == [*range(50)]


@pytest.mark.parametrize("pieces", [1, 2, 9])
def test_signs_of_life_while_a_piece_takes_long(pieces: int) -> None:
    """However few pieces there are."""

    def slow(number: int) -> int:
        time.sleep(6 * SECONDS_BETWEEN_SIGNS_OF_LIFE)
        return number

    results, silences, last = [], [], time.perf_counter()
    for result in in_parallel(slow, range(pieces)):
        now = time.perf_counter()
        silences.append(now - last)
        results.append(result)
        last = now
    assert [result for result in results if result is not None] == [*range(pieces)]
    assert results.count(None) >= 3
    # Twice as long, for a machine that is busy.
    assert sorted(silences)[len(silences) // 2] < 2 * SECONDS_BETWEEN_SIGNS_OF_LIFE


def test_nothing_to_do() -> None:
    assert [*in_parallel(str, ())] == []


def test_what_has_not_begun_is_dropped() -> None:
    begun = []

    def begin(number: int) -> int:
        begun.append(number)
        return number

    results = in_parallel(begin, count())
    assert next(result for result in results if result is not None) == 0
    results.close()
    time.sleep(SECONDS_BETWEEN_SIGNS_OF_LIFE)
    after = len(begun)
    time.sleep(4 * SECONDS_BETWEEN_SIGNS_OF_LIFE)
    assert len(begun) == after


def test_errors_reach_the_caller() -> None:
    def failing(number: int) -> int:
        raise ValueError(number)

    with pytest.raises(ValueError, match="7"):
        list(in_parallel(failing, [7]))
