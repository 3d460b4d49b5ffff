# SPDX-License-Identifier: GPL-3.0-or-later
"""An adaptive answer → the finer answer to begin its reduction with, and the proved distances of the reduced mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core import (
    AdaptiveMesh,
    Progress,
    Reduction,
    TooManyFacesError,
    TriangleMesh,
    no_report,
    smallest_step,
    subdivide_adaptively,
)
from .adaptive_task import AdaptiveAnswer, AdaptiveSettings

# The divisors of the tolerance for the mesh to reduce; the first that does not make too many faces counts.
DIVISORS = (12.0, 6.0, 2.0)

# With an angle: vertices that are fixed to keep it stay as close as they are in the mesh to reduce.
DIVISORS_WITH_ANGLES = (2.0,)


def finer_answer(answer: AdaptiveAnswer, settings: AdaptiveSettings, progress: Progress = no_report) -> AdaptiveAnswer:
    """The mesh to reduce: within a part of the tolerance, or if that makes too many faces, the answer itself.

    May run in a thread. progress: receives the approximate number of faces so far, and may raise to stop.
    """
    task = answer.task
    control = task.control
    whole = task.request(replace(settings, mode="ADAPTIVE"), task.surface.tolerance, 0)
    most = whole.limit - whole.rounding
    for divisor in DIVISORS_WITH_ANGLES if task.has_angles(settings) else DIVISORS:
        # Below the smallest step nothing can be proved.
        limit = max(most / divisor, min(most, smallest_step(control.in_world) / task.surface.least_factor))
        # Long triangles would turn over when they are merged.
        request = replace(whole, limit=limit, rounding=0.0, most_faces=settings.max_faces, are_squares=True)
        try:
            finer = subdivide_adaptively(control.in_world, request, control.mesh.positions, progress)
        except TooManyFacesError:
            continue
        return AdaptiveAnswer(task, finer)
    return answer


def depths_of_faces(answer: AdaptiveAnswer, mesh: AdaptiveMesh) -> NDArray[np.int32]:
    """(F,) int32: the depth of each face of another mesh of the same control mesh: that of its base face."""
    depths = np.zeros(answer.task.control.face_count, dtype=np.int32)
    depths[answer.adaptive.mesh.base_faces] = answer.adaptive.depths
    return depths[mesh.mesh.base_faces]


def triangle_count(answer: AdaptiveAnswer) -> int:
    """The number of triangles of its faces."""
    mesh = answer.adaptive.mesh
    return len(mesh.corner_vertices) - 2 * len(mesh.base_faces)


def reduction_of(
    answer: AdaptiveAnswer, settings: AdaptiveSettings, start: TriangleMesh, progress: Progress
) -> Reduction:
    """The search for the fewest triangles within the tolerance of the answer. May run in a thread."""
    task = answer.task
    return Reduction(
        task.control.in_world,
        start,
        task.surface.tolerance - task.allowance / task.surface.least_factor,
        progress,
        variation=task.surface.variation(task.control),
        shading_angle=settings.shading_angle,
        facet_angle=settings.facet_angle,
    )
