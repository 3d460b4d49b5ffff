# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports of progress: long work tells its caller the fraction done, and the caller may raise to stop the work."""

from __future__ import annotations

from collections.abc import Callable

# A function of the fraction done; an exception of the function ends the work.
Progress = Callable[[float], None]


def no_report(done: float) -> None:
    """Report nothing, for callers that need no progress."""


def part_of(progress: Progress, begin: float, share: float) -> Progress:
    """The progress of a part of the work that begins at a fraction of the whole and has a share of the whole."""
    return lambda fraction: progress(begin + share * fraction)
