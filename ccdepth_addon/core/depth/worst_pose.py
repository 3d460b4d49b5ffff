# SPDX-License-Identifier: GPL-3.0-or-later
"""The worst of several poses of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..bounds.norm_bounds import Method, Vertices
from ..bounds.rounding import rounding_allowance
from ..progress import Progress, no_report
from .distance_depth import Effort
from .face_depths import bounds_at_depths
from .pose_depths import Pose, PoseDepths
from .tolerance import ToleranceTest

# The relative difference below which distances are alike, as for a turned mesh in single precision.
ALIKE = 1e-6


@dataclass(frozen=True)
class WorstPose:
    """The worst pose: among the poses with the deepest depth themselves, the pose with the largest proved distance
    of a face at that depth. pose: its index. depth: the deepest depth. share: the distance, in parts of the tolerance.
    """

    pose: int
    depth: int
    share: float


def worst_pose(
    poses: Sequence[Pose], method: str, vertices: str, found: PoseDepths, progress: Progress = no_report
) -> WorstPose:
    """The worst pose; among equals the first. Arguments: as in ``pose_depths``; found: the result of that function."""
    nowhere = WorstPose(0, int(found.depths.max(initial=0)), 0.0)
    if len(poses) == 1:
        bounds = found.bounds[found.depths == nowhere.depth]
        return replace(nowhere, share=float(bounds.max(initial=0.0)) / poses[0].tolerance)
    done = 0.0
    for is_own_depth in (True, False):
        worst = nowhere
        for place, pose in enumerate(poses):
            done = max(done, place / len(poses))
            tick = partial(progress, done)
            tick()
            share = _share(pose, Method(method), Vertices(vertices), found, worst, tick, is_own_depth=is_own_depth)
            if share > worst.share * (1 + ALIKE):
                worst = WorstPose(place, worst.depth, share)
        if worst.share > 0:
            break
        # No single pose needs that level: a face can be farther off at a level than at the level before.
    return worst


def _share(
    pose: Pose,
    method: Method,
    vertices: Vertices,
    found: PoseDepths,
    worst: WorstPose,
    tick: Callable[[], None],
    *,
    is_own_depth: bool,
) -> float:
    """The largest distance of a face at the deepest depth in a pose, as a part of the tolerance, 0 where none exceeds
    the worst so far. is_own_depth: whether only faces with that depth in this pose count."""
    faces = np.flatnonzero((found.depths == worst.depth) & (found.bounds > worst.share * pose.tolerance))
    if not len(faces):
        return 0.0
    mesh = pose.make()
    test = ToleranceTest(pose.tolerance, rounding_allowance(mesh))
    shares = np.zeros(mesh.face_count)
    for block in bounds_at_depths(mesh, faces, test, method, vertices, found.depths, Effort.NORMAL, tick):
        # A distance without a proof here was proved with fewer faces at once (``MOST_REGULAR``).
        shares[block.faces] = np.minimum(block.bounds / pose.tolerance, 1.0)
    farther = np.flatnonzero(shares > worst.share * (1 + ALIKE))
    farther = farther[np.argsort(-shares[farther], kind="stable")]
    if not is_own_depth:
        return float(shares.max())
    # The farthest face mostly needs that level in this pose, and ends the search.
    begin = 0
    while begin < len(farther):
        some = left = farther[begin : 2 * begin + 1]
        for level in range(worst.depth - 1, -1, -1):
            levels = np.full(mesh.face_count, level, dtype=np.int32)
            blocks = bounds_at_depths(mesh, left, test, method, vertices, levels, Effort.NORMAL, tick)
            left = np.concatenate([left[:0], *(block.faces[np.isinf(block.bounds)] for block in blocks)])
        if len(left):
            return float(shares[left].max())
        begin += len(some)
    return 0.0
