# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of several poses of a mesh is the worst."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..bounds.norm_bounds import Method, Vertices
from ..progress import Progress, no_report
from .distance_poses import shares_at_depth
from .joined_faces import JoinedFaces, bounds_at, in_groups, poses_together, searched
from .pose_depths import PoseDepths
from .poses import Pose, PreparedMesh, ScaledPose

# Relative; distances that are nearer to each other than this are alike: those of what is turned, in single precision.
ALIKE = 1e-6


@dataclass(frozen=True)
class WorstPose:
    """Of the poses with a face of the deepest depth, the one in which such a face is the farthest off.

    pose: its index. depth: that depth. share: the distance proved there, as a part of the tolerance.
    """

    pose: int
    depth: int
    share: float


def worst_pose(
    poses: Sequence[Pose], method: str, vertices: str, found: PoseDepths, progress: Progress = no_report
) -> WorstPose:
    """The worst pose; of several alike the first. Arguments: as of ``common_level``."""
    deepest = int(found.depths.max(initial=0))
    faces = np.flatnonzero(found.depths == deepest)
    if len(poses) == 1:
        return WorstPose(0, deepest, float(found.bounds[faces].max(initial=0.0)) / poses[0].tolerance)
    if Method(method) is Method.DISTANCE:
        return _farthest_by_distance(poses, vertices, faces, deepest, progress) or WorstPose(0, deepest, 0)
    prepared = PreparedMesh.of(poses[0].make(), Method(method), Vertices(vertices))
    worst = _farthest(prepared, poses, faces, deepest, progress, is_own_depth=True)
    # Where no pose alone needs that level: a face can be farther off at a level than at the one before.
    return worst or _farthest(prepared, poses, faces, deepest, progress, is_own_depth=False) or WorstPose(0, deepest, 0)


def _farthest_by_distance(
    poses: Sequence[Pose], vertices: str, faces: IndexArray, depth: int, progress: Progress
) -> WorstPose | None:
    """The pose in which one of the faces is the farthest off, of those in which that is its depth."""
    worst: WorstPose | None = None
    for place, pose in enumerate(poses):
        shares = shares_at_depth(pose, vertices, faces, depth, partial(progress, place / len(poses)))
        share = float(shares.max())
        if np.isfinite(share) and (worst is None or share > worst.share * (1 + ALIKE)):
            worst = WorstPose(place, depth, share)
    return worst


def _farthest(
    prepared: PreparedMesh,
    poses: Sequence[Pose],
    faces: IndexArray,
    level: int,
    progress: Progress,
    *,
    is_own_depth: bool,
) -> WorstPose | None:
    """The pose in which one of the faces is the farthest off at a level; is_own_depth: of those in which that is its
    depth."""
    worst: WorstPose | None = None
    for batch in in_groups(range(len(poses)), poses_together(len(faces))):
        done = batch[0] / len(poses)
        scaled = [ScaledPose.of(poses[pose]) for pose in batch]
        left = []
        for each in scaled:
            near, before = np.full((2, prepared.mesh.face_count), np.inf)
            for some, norms in prepared.norms(each.mesh, faces):
                near[some], before[some] = norms.at(level), norms.at(max(level - 1, 0))
            wanted = near[faces] + each.allowance > (worst.share if worst else 0.0)
            if is_own_depth and level > 0:
                wanted &= before[faces] + each.allowance > 1.0
            left.append(faces[wanted])
        if not any(map(len, left)):
            continue
        joined = JoinedFaces.of(prepared, scaled, left)
        shares = _shares(joined, level, partial(progress, done), is_own_depth=is_own_depth)
        # The first one that is as far off as any, but for rounding.
        place = int(np.argmax(shares >= shares.max() * (1 - ALIKE)))
        if np.isfinite(shares[place]) and (worst is None or shares[place] > worst.share * (1 + ALIKE)):
            worst = WorstPose(batch[int(joined.poses[place])], level, float(shares[place]))
    return worst


def _shares(joined: JoinedFaces, level: int, tick: Callable[[], None], *, is_own_depth: bool) -> FloatArray:
    """(P,): the distance of each of the joined faces at a level, in units of the tolerance; -inf where that is not its
    depth, and has to be."""
    if not is_own_depth:
        return bounds_at(joined, np.full(len(joined.bases), level, dtype=np.int32), tick)
    depths, bounds, _ = searched(joined, tick)
    return np.where(depths == level, bounds, -np.inf)
