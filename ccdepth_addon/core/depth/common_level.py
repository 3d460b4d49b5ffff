# SPDX-License-Identifier: GPL-3.0-or-later
"""The level at which all faces of several meshes are within the tolerance, in every one of their poses."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle

from ..progress import Progress, no_report, part_of
from .face_depths import uniform_level
from .pose_depths import Pose
from .tolerance import FaceDepths


def common_level(
    meshes: Sequence[tuple[Sequence[Pose], str, str, FaceDepths]],
    progress: Progress = no_report,
    *,
    effort: str = "NORMAL",
) -> int:
    """The first level, from the deepest depth on, at which all faces are proved to be within the tolerance in every
    pose of every mesh.

    meshes: for each mesh the arguments of ``pose_depths``, and its result. With limit vertices, level 1 is the first,
    with a margin at some corners, as in ``uniform_level``. progress, effort: as in ``pose_depths``.
    """
    poses = [(pose, method, vertices, found) for own, method, vertices, found in meshes for pose in own]
    level, agreed, begun = 0, 0, 0.0
    for pose, method, vertices, found in cycle(poses):
        # One part is left over, for meshes that do not agree.
        share = (1 - begun) / (len(poses) - agreed + 1)
        part = part_of(progress, begun, share)
        asked = pose.make(), pose.tolerance, method, vertices
        needed = uniform_level(*asked, found, level, part, effort=effort, variation=pose.variation)
        begun += share
        agreed = agreed + 1 if needed == level else 1
        level = needed
        if agreed == len(poses):
            break
    return level
