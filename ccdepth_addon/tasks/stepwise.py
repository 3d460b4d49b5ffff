# SPDX-License-Identifier: GPL-3.0-or-later
"""Long work in as small steps as the caller likes."""

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
    """How far work is before what it is about begins, or after: such progress is told in words of its own."""

    text: str


class Stepwise(Generic[Progress, Answer]):
    """A generator at work: what it yielded last, and what it returned once it is done."""

    def __init__(self, steps: Generator[Progress, None, Answer]) -> None:
        self.progress: Progress | None = None
        self.answer: Answer | None = None
        self._steps = steps

    def work(self, seconds: float = np.inf) -> bool:
        """Go on for a while; True when it is done, and the answer is there."""
        until = perf_counter() + seconds
        while self.answer is None and perf_counter() < until:
            try:
                self.progress = next(self._steps)
            except StopIteration as finished:
                self.answer = finished.value
        return self.answer is not None

    def give_up(self) -> None:
        """Let go of everything the unfinished work holds."""
        self._steps.close()
