# SPDX-License-Identifier: GPL-3.0-or-later
"""The way in which long work reports its progress to its caller, and is stopped."""

from __future__ import annotations

from collections.abc import Callable

# Called with how far the work is; what it raises ends the work.
Progress = Callable[[float], None]


def no_report(done: float) -> None:
    """Report nothing, for callers that need no progress."""


def part_of(progress: Progress, begin: float, share: float) -> Progress:
    """The progress of a part that begins at a fraction of the whole, and is this share of it."""
    return lambda fraction: progress(begin + share * fraction)
