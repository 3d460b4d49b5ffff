# SPDX-License-Identifier: GPL-3.0-or-later
"""A number of faces → the best tolerance with which adaptive meshes have no more of them."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from ..core import Progress, no_report
from .adaptive_task import (
    AdaptiveSettings,
    AdaptiveTask,
    coarsest_tolerance,
    counts_with,
    finest_tolerance,
    with_digits,
)
from .surfaces import ComputeError

# It is good enough with this part of the faces, or within this factor of a tolerance that makes too many.
ENOUGH_FACES, NEAR_ENOUGH = 0.97, 1.02

# Each step begins where faces are about as many as the tolerance is finer, and goes no farther than this.
LARGEST_STEP = 16.0

# With so few faces a mesh tells how many a finer one has.
FEWEST_TO_EXTRAPOLATE = 200

MOST_COUNTS = 24


@dataclass(frozen=True)
class Fit:
    """A tolerance, as it is typed, and how many faces each result has with it."""

    tolerance: float
    counts: list[int]


def best_tolerance(
    tasks: list[AdaptiveTask], settings: AdaptiveSettings, most_faces: int, progress: Progress = no_report
) -> Fit:
    """The best tolerance, to three digits, with which the results together have at most so many faces.

    It is tried out, so it fits: finer and finer ones are counted, until one has too many faces, and then those between.
    Counting takes as long as there are faces, and ends where there are too many. progress: is told the number of faces,
    and may raise to stop. Raises ComputeError when no tolerance fits.
    """

    def fit(tolerance: float) -> Fit | None:
        tolerance = with_digits(tolerance, 3)
        counts = counts_with(tasks, settings, tolerance, most_faces, progress)
        return None if counts is None else Fit(tolerance, counts)

    finest = finest_tolerance(tasks, settings)
    best = fit(coarsest_tolerance(tasks, settings))
    if best is None:
        raise ComputeError(f"Even undivided there would be more than {most_faces:,} faces")
    too_fine = 0.0
    guess = max(settings.tolerance, finest)
    for _ in range(MOST_COUNTS):
        found = fit(guess)
        if found is None:
            too_fine = guess
        else:
            best = found
        faces = sum(best.counts)
        if faces >= ENOUGH_FACES * most_faces or best.tolerance <= NEAR_ENOUGH * max(too_fine, finest):
            break
        guess = max(_next_guess(best, too_fine, most_faces), finest)
    return best


def _next_guess(best: Fit, too_fine: float, most_faces: int) -> float:
    """Where to go on between a tolerance that fits and one, or 0, that is too fine."""
    faces = sum(best.counts)
    # Where most is flat, there are as many more faces as the tolerance is finer.
    finer = min(most_faces / max(faces, 1), LARGEST_STEP) if faces >= FEWEST_TO_EXTRAPOLATE else LARGEST_STEP
    guess = best.tolerance / finer
    if guess <= too_fine * NEAR_ENOUGH:
        guess = sqrt(best.tolerance * too_fine)
    return guess
