# SPDX-License-Identifier: GPL-3.0-or-later
"""Tasks → adaptive meshes as arrays, their numbers of faces, and the tolerance for a number of faces. Nothing here
needs Blender: it may run in a thread."""

from __future__ import annotations

from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, Decimal
from math import degrees, sqrt

from ..core import Progress, TooManyFacesError, count_faces, no_report, subdivide_adaptively
from .adaptive_task import AdaptiveAnswer, AdaptiveSettings, AdaptiveTask
from .surfaces import ComputeError

# A tolerance is good enough with this part of the faces, or within this factor of a tolerance that makes too many.
ENOUGH_FACES, NEAR_ENOUGH = 0.97, 1.02

# Each step takes the number of faces for inversely proportional to the tolerance, and divides the tolerance by this
# factor at most.
LARGEST_STEP = 16.0

# The number of faces from which a mesh predicts the number of a finer mesh.
FEWEST_TO_EXTRAPOLATE = 200

MOST_COUNTS = 24

# Larger angles are tried in steps by this factor, this many at most: 1° comes to 86°.
ANGLE_STEP, MOST_ANGLE_STEPS = 1.25, 20

# A tolerance, in diagonals, with which nothing is split unnecessarily.
WITHOUT_SPLITS = 100.0

# Digits of a tolerance that was found.
DIGITS = 3


@dataclass(frozen=True)
class FaceCount:
    """The number of faces of a result; or about that of all results together, if they are too many. by_distance: the
    number without angles, if there are angles; fitting: settings with larger angles that do not make too many."""

    faces: int
    are_too_many: bool = False
    by_distance: int | None = None
    fitting: AdaptiveSettings | None = None


@dataclass(frozen=True)
class Fit:
    """Settings with another tolerance, and the number of faces of each result with them."""

    settings: AdaptiveSettings
    counts: list[int]

    @property
    def tolerance(self) -> float:
        return self.settings.tolerance


class TooManyError(ComputeError):
    """The error of tasks whose results would have too many faces together."""

    def __init__(self, tasks: list[AdaptiveTask], count: FaceCount, settings: AdaptiveSettings) -> None:
        super().__init__(too_many_text(tasks, count, settings))
        self.tasks, self.count = tasks, count


def subdivide(
    tasks: list[AdaptiveTask], settings: AdaptiveSettings, progress: Progress = no_report
) -> list[AdaptiveAnswer]:
    """Make every mesh, as arrays.

    progress: receives the approximate number of faces so far, and may raise to stop. Raises ComputeError for too many
    faces.
    """
    answers: list[AdaptiveAnswer] = []
    made = 0
    for task in tasks:
        control = task.control
        request = task.request(settings, task.surface.tolerance, settings.max_faces - made)
        try:
            adaptive = subdivide_adaptively(control.in_world, request, control.mesh.positions, _after(made, progress))
            faces = len(adaptive.mesh.base_faces)
        except TooManyFacesError as fault:
            faces = fault.faces
        # The core counts leaves on its way; their faces may turn out to be more than are allowed.
        if faces > request.most_faces:
            raise TooManyError(tasks, _too_many(tasks, made + faces, settings, progress), settings)
        answers.append(AdaptiveAnswer(task, adaptive))
        made += faces
    return answers


def count_results(
    tasks: list[AdaptiveTask], settings: AdaptiveSettings, progress: Progress = no_report
) -> list[FaceCount]:
    """The number of faces of every mesh. progress: as of ``subdivide``."""
    counts = _counts(tasks, settings, progress)
    if sum(counts) > settings.max_faces:
        return [_too_many(tasks, sum(counts), settings, progress)] * len(tasks)
    if not _have_angles(tasks, settings):
        return [FaceCount(faces) for faces in counts]
    by_distance = _counts(tasks, settings.with_angles_times(0.0), progress)
    return [FaceCount(faces, by_distance=fewer) for faces, fewer in zip(counts, by_distance, strict=True)]


def _have_angles(tasks: list[AdaptiveTask], settings: AdaptiveSettings) -> bool:
    return any(task.has_angles(settings) for task in tasks)


def _counts(tasks: list[AdaptiveTask], settings: AdaptiveSettings, progress: Progress) -> list[int]:
    """The number of faces of every mesh with the tolerance of its task, or about that of a mesh with too many."""
    counts: list[int] = []
    for task in tasks:
        request = task.request(settings, task.surface.tolerance, settings.max_faces)
        try:
            counts.append(count_faces(task.control.in_world, request, _after(sum(counts), progress)))
        except TooManyFacesError as fault:
            counts.append(fault.faces)
    return counts


def _too_many(tasks: list[AdaptiveTask], faces: int, settings: AdaptiveSettings, progress: Progress) -> FaceCount:
    """About how many faces too many results have; with angles, the number without angles, and the least multiples of
    the angles that fit, if any do, by counting."""
    if not _have_angles(tasks, settings) or _never_fit(tasks, settings.max_faces):
        return FaceCount(faces, True)
    by_distance = sum(_counts(tasks, settings.with_angles_times(0.0), progress))
    fitting, least, most = None, 0, 0 if by_distance > settings.max_faces else MOST_ANGLE_STEPS
    while least < most:
        step = (least + most) // 2
        tried = settings.with_angles_times(ANGLE_STEP ** (step + 1))
        if sum(_counts(tasks, tried, progress)) <= settings.max_faces:
            fitting, most = tried, step
        else:
            least = step + 1
    return FaceCount(faces, True, by_distance, fitting)


def _after(faces: int, progress: Progress) -> Progress:
    """The progress of a mesh made after a number of faces."""
    return lambda so_far: progress(faces + so_far)


def _unit(task: AdaptiveTask, settings: AdaptiveSettings) -> float:
    """The length in the scene of a typed tolerance of 1, for a task."""
    return task.surface.tolerance / settings.tolerance


def best_tolerance(
    tasks: list[AdaptiveTask], settings: AdaptiveSettings, most_faces: int, progress: Progress = no_report
) -> Fit | None:
    """The best tolerance, to three digits, with which the results together have at most a number of faces; None without
    any.

    The tolerance is tried out, so it fits: finer and finer tolerances are counted, from the settings' tolerance on,
    until one has too many faces, and then tolerances between, each with the angles that go with it. The time of
    counting grows with the number of faces, and counting ends with too many faces. progress: receives the number of
    faces, and may raise to stop.
    """

    def fit(tolerance: float) -> Fit | None:
        rounded = with_digits(tolerance, DIGITS)
        tried = settings.with_tolerance(rounded) if scales_angles else replace(settings, tolerance=rounded)
        counts = _counts_with(tasks, settings, tried, most_faces, progress)
        return None if counts is None else Fit(tried, counts)

    scales_angles = _have_angles(tasks, settings)
    if _never_fit(tasks, most_faces):
        return None
    finest = max(task.least_tolerance / _unit(task, settings) for task in tasks)
    best = fit(max(task.control.diagonal() / _unit(task, settings) for task in tasks) * WITHOUT_SPLITS)
    if best is None:
        return None
    guess, too_fine = max(settings.tolerance, finest), 0.0
    for _ in range(MOST_COUNTS):
        found = fit(guess)
        best, too_fine = (best, guess) if found is None else (found, too_fine)
        if sum(best.counts) >= ENOUGH_FACES * most_faces or best.tolerance <= NEAR_ENOUGH * max(too_fine, finest):
            break
        guess = max(_next_guess(best, too_fine, most_faces), finest)
    return best


def _never_fit(tasks: list[AdaptiveTask], most_faces: int) -> bool:
    """Whether any tolerance makes too many faces: each face of a control mesh makes at least one."""
    return sum(task.control.face_count for task in tasks) > most_faces


def _next_guess(best: Fit, too_fine: float, most_faces: int) -> float:
    """The next tolerance to try between a fitting one and a too fine one, or 0."""
    faces = sum(best.counts)
    # On mostly flat meshes the number of faces is inversely proportional to the tolerance.
    finer = min(most_faces / max(faces, 1), LARGEST_STEP) if faces >= FEWEST_TO_EXTRAPOLATE else LARGEST_STEP
    guess = best.tolerance / finer
    if guess <= too_fine * NEAR_ENOUGH:
        guess = sqrt(best.tolerance * too_fine)
    return guess


def _counts_with(
    tasks: list[AdaptiveTask], settings: AdaptiveSettings, tried: AdaptiveSettings, most_faces: int, progress: Progress
) -> list[int] | None:
    """The number of faces of each result with other settings; None for too many faces."""
    counts: list[int] = []
    for task in tasks:
        request = task.request(tried, tried.tolerance * _unit(task, settings), most_faces - sum(counts))
        try:
            counts.append(count_faces(task.control.in_world, request, _after(sum(counts), progress)))
        except TooManyFacesError:
            return None
        if sum(counts) > most_faces:
            return None
    return counts


def with_digits(number: float, digits: int) -> float:
    """The least decimal with a number of digits that is not smaller."""
    exact = Decimal(str(number))
    return float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - digits + 1), rounding=ROUND_CEILING))


def too_many_text(tasks: list[AdaptiveTask], count: FaceCount, settings: AdaptiveSettings) -> str:
    """The report that the results have too many faces together."""
    whose = f"{tasks[0].object_names[0]}: the result" if len(tasks) == 1 else f"The {len(tasks)} results together"
    text = f"{whose} would have about {count.faces:,} faces, and {settings.max_faces:,} are allowed"
    if _never_fit(tasks, settings.max_faces):
        return f"{text}; no tolerance would fit"
    if count.fitting is not None:
        return f"{text}; {_angles_text(count.fitting)} would fit, and Find Tolerance finds a tolerance that fits"
    if settings.longest_edge:
        return f"{text}; a greater Longest Edge makes fewer"
    if count.by_distance is not None:
        text = f"{text}, while the distance alone needs about {count.by_distance:,}"
    return f"{text}; Find Tolerance finds one that fits"


def _angles_text(settings: AdaptiveSettings) -> str:
    angles = {"a shading angle": settings.shading_angle, "a facet angle": settings.facet_angle}
    return " with ".join(f"{name} of {degrees(angle):.3g}°" for name, angle in angles.items() if angle)
