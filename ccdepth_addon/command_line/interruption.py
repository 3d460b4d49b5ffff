# SPDX-License-Identifier: GPL-3.0-or-later
"""Signals that end a run: what was begun is broken off, and nothing is left behind."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

# The signal that has come, if one has.
_received: int | None = None


@contextmanager
def interruptible() -> Iterator[None]:
    """Let KeyboardInterrupt be raised when SIGINT or SIGTERM comes, which would end Blender at once or not at all; the
    second one ends it. Writing to a process or a terminal that has gone is an error, and does not end Blender."""
    global _received
    _received = None
    handlers: dict[signal.Signals, Callable[[int, FrameType | None], None] | signal.Handlers] = {
        signal.SIGINT: _interrupt,
        signal.SIGTERM: _interrupt,
    }
    if hasattr(signal, "SIGPIPE"):
        handlers[signal.SIGPIPE] = signal.SIG_IGN
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None stands for what was not set from Python.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _interrupt(number: int, _frame: FrameType | None) -> None:
    global _received
    _received = number
    signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def refuse_if_interrupted() -> None:
    """Raise KeyboardInterrupt once more if it was raised within an operator: Blender makes a report of it."""
    if _received is not None:
        raise KeyboardInterrupt


def exit_status() -> int:
    """What a shell says of a program that was ended by the signal."""
    return 128 + (_received or signal.SIGINT)
