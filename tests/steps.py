# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that is done in steps, from its beginning to its end."""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

Result = TypeVar("Result")


def result_of(steps: Generator[object, None, Result]) -> Result:
    """What the work returns."""
    while True:
        try:
            next(steps)
        except StopIteration as stopped:
            return stopped.value
