# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in small steps, with its progress."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from time import perf_counter
from typing import Generic, TypeVar

import numpy as np

Progress = TypeVar("Progress")
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Stage:
    """Progress before or after the main part of the work, which has a text of its own."""

    text: str


class Stepwise(Generic[Progress, Answer]):
    """A generator that is run for a while at a time: the progress it yielded last, and the answer it returned."""

    def __init__(self, steps: Generator[Progress, None, Answer]) -> None:
        self.progress: Progress | None = None
        self.answer: Answer | None = None
        self._steps = steps

    def work(self, seconds: float = np.inf) -> bool:
        """Run for so many seconds; True when it is done and has an answer."""
        until = perf_counter() + seconds
        while self.answer is None and perf_counter() < until:
            try:
                self.progress = next(self._steps)
            except StopIteration as finished:
                self.answer = finished.value
        return self.answer is not None

    def give_up(self) -> None:
        """End the unfinished work, and free what it holds."""
        self._steps.close()
