# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters of the short suite, and those that only ``--thorough`` adds."""

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest


def each(values: Iterable[Any], short: Iterable[Any]) -> list[Any]:
    """Parameters for `pytest.mark.parametrize`: all of `values`; those not in `short` are marked ``thorough``.

    ValueError where `short` holds a value that `values` does not hold.
    """
    every, kept = list(values), list(short)
    if missing := [value for value in kept if value not in every]:
        raise ValueError(f"not among the values: {missing}")
    return [value if value in kept else pytest.param(value, marks=pytest.mark.thorough) for value in every]


def combinations(*factors: Iterable[Any]) -> list[Any]:
    """Parameters for several arguments at once: all products of the factors.

    In the short suite each factor goes through its values while the others turn at their own pace, as many cases as the
    longest factor has values; the other products are marked ``thorough``.
    """
    lists = [list(factor) for factor in factors]
    longest = max(map(len, lists))
    short = [tuple(values[i % len(values)] for values in lists) for i in range(longest)]
    return cases(product(*lists), short)


def cases(
    values: Iterable[tuple[Any, ...]], short: Iterable[tuple[Any, ...]], everywhere: Iterable[tuple[Any, ...]] = ()
) -> list[Any]:
    """Parameters for several arguments at once: all of `values`; those not in `short` are marked ``thorough``, those in
    `everywhere` ``every_blender``."""
    kept, depending, found = list(short), list(everywhere), []
    for value in values:
        marks = [pytest.mark.thorough] * (value not in kept) + [pytest.mark.every_blender] * (value in depending)
        found.append(pytest.param(*value, marks=marks))
    return found
