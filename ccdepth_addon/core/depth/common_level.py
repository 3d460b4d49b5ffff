# SPDX-License-Identifier: GPL-3.0-or-later
"""The level at which all faces of a mesh are within the tolerance in every one of several poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..arrays.types import IndexArray
from ..bounds.norm_bounds import Method, Vertices
from ..progress import Progress, no_report, part_of
from .distance_poses import all_poses_within
from .face_depths import all_within, uniform_level
from .joined_faces import JoinedFaces, bounds_at_level, in_groups, poses_together
from .modifier_quality import unmet_corners
from .pose_depths import PoseDepths
from .poses import Pose, PreparedMesh, ScaledPose


def common_level(
    poses: Sequence[Pose],
    method: str,
    vertices: str,
    found: PoseDepths,
    least: int = 0,
    progress: Progress = no_report,
) -> int:
    """The first level, from the deepest depth on, at which all faces are proved to be within the tolerance in every
    pose.

    Arguments: as of ``pose_depths``; found: its result. least: no level before this one is wanted. With limit vertices,
    level 1 is the first, and a margin is left at some corners, as of ``uniform_level``.
    """
    mesh = poses[0].make()
    if len(poses) == 1:
        return uniform_level(
            mesh, poses[0].tolerance, method, vertices, found.depths, least, progress, lasting=found.lasting
        )
    prepared = PreparedMesh.of(mesh, Method(method), Vertices(vertices))
    with_margin = np.zeros(mesh.face_count, dtype=bool)
    if prepared.vertices is Vertices.LIMIT:
        with_margin[mesh.corner_faces[unmet_corners(mesh).corners]] = True
        least = max(least, 1)
    level = max(least, int(found.depths.max(initial=0)))
    settled = found.lasting | with_margin
    begun = 0.0
    while True:
        # How many levels there will be is not known: each has half of what is left.
        share = part_of(progress, begun, (1 - begun) / 2)
        begun += (1 - begun) / 2
        if prepared.method is Method.DISTANCE:
            if all_poses_within(poses, vertices, found.lasting, level, share):
                return level
            level += 1
            continue
        wanted = np.flatnonzero((found.depths != level) & ~settled)
        for some, norms in prepared.norms(mesh, wanted):
            settled[some] |= replace(norms, value=found.peaks[some]).at(level) + found.allowance <= 1.0
        wanted = wanted[~settled[wanted]]
        if _all_poses_within(prepared, poses, wanted, np.flatnonzero(with_margin), level, share):
            return level
        level += 1


def _all_poses_within(
    prepared: PreparedMesh,
    poses: Sequence[Pose],
    faces: IndexArray,
    with_margin: IndexArray,
    level: int,
    progress: Progress,
) -> bool:
    """Whether all of the faces are within the tolerance in all poses at one level, and others within it less their
    margin; ends with the first that is not."""
    levels = np.full(prepared.mesh.face_count, level, dtype=np.int32)
    at_once = poses_together(len(faces))
    for batch in in_groups(range(len(poses)), at_once):
        done = batch[0] / len(poses)
        progress(done)
        scaled, left = [], []
        for pose in batch:
            if len(with_margin) and not _within_less_margin(prepared, poses[pose], with_margin, level):
                return False
            if len(faces):
                scaled.append(ScaledPose.of(poses[pose]))
                mesh = scaled[-1].mesh
                near = prepared.norm_bounds(mesh, faces, levels)[faces] + scaled[-1].allowance <= 1.0
                left.append(faces[~near])
        if not any(map(len, left)):
            continue
        blocks = bounds_at_level(JoinedFaces.of(prepared, scaled, left), level, partial(progress, done))
        if not all(block.all_within for block in blocks):
            return False
    return True


def _within_less_margin(prepared: PreparedMesh, pose: Pose, faces: IndexArray, level: int) -> bool:
    """Whether faces with corners that Blender does not show quite on the surface are within the tolerance less its
    margin for them."""
    mesh = pose.make()
    reduced = pose.tolerance - unmet_corners(mesh).margin(pose.tolerance)
    return all_within(mesh, [(faces, reduced)], prepared.method, prepared.vertices, level, no_report)
