# SPDX-License-Identifier: GPL-3.0-or-later
"""Work that is done in steps, from its beginning to its end."""

from collections.abc import Generator, Iterator
from typing import Any, TypeVar

Result = TypeVar("Result")


def result_of(steps: Generator[Any, Any, Result]) -> Result:
    """What the work returns."""
    results: list[Result] = []
    for _ in taken(steps, results):
        pass
    return results[0]


def taken(steps: Generator[Any, Any, Result], results: list[Result] | None = None) -> Iterator[Any]:
    """Each step before it is taken; work without Blender is done at once. results: gets what is returned."""
    answer = None
    while True:
        try:
            step = steps.send(answer)
        except StopIteration as stopped:
            if results is not None:
                results.append(stopped.value)
            return
        yield step
        answer = step.function(lambda _progress: None) if hasattr(step, "function") else None
