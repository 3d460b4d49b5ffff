# SPDX-License-Identifier: GPL-3.0-or-later
"""The depths of faces over several poses of a mesh, such as the frames of an animation.

The depth of a face is the first level, from the deepest of its depths in single poses on, at which the face is proved
to be within the tolerance in all poses; its bound is the largest bound proved there. The first pose is searched level
by level. All other poses are then tested only at the depths found so far; a face that fails gets the next level, and is
tested there in all poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, IndexArray
from ..bounds.norm_bounds import Method, Vertices
from ..mesh.polygon_mesh import PolygonMesh
from ..progress import Progress, no_report, part_of
from ..tolerance.variation import Variation
from .distance_depth import Effort
from .face_depths import bounds_at_depths, face_depths, groups_of
from .tolerance import FaceDepths, LevelBounds

# The time that the first pose takes, in units of the time of any other pose.
FIRST_POSE = 2.0


@dataclass(frozen=True)
class Pose:
    """One pose of a mesh.

    make: returns the mesh in the pose, made anew at each call to save memory. All poses of a mesh have the same faces,
    edges and explicit sharpness (``PolygonMesh.changed``). tolerance: the largest distance allowed, in the unit of the
    positions; variation: how it varies.
    """

    make: Callable[[], PolygonMesh]
    tolerance: float
    variation: Variation | None = None

    def bounds_at(
        self,
        faces: IndexArray,
        depths: NDArray[np.int32],
        kinds: tuple[Method, Vertices, Effort],
        tick: Callable[[], None],
    ) -> Iterator[LevelBounds]:
        """The proved bounds of some faces, each at its own depth (F,), as of ``bounds_at_depths``."""
        mesh, (method, vertices, effort) = self.make(), kinds
        for own, test in groups_of(mesh, faces, self.tolerance, self.variation, method):
            yield from bounds_at_depths(mesh, own, test, method, vertices, depths, effort, tick)


def pose_depths(
    poses: Sequence[Pose], method: str, vertices: str, progress: Progress = no_report, *, effort: str = "NORMAL"
) -> FaceDepths:
    """The depth of every face over all poses of a mesh. bounds: the largest distances proved over all poses; distances,
    exact and might_need_less are of the first pose; lasting and alone hold in all poses.

    poses: all checked (``check_pose``). method, vertices, effort: as in ``face_depths``. progress: receives the rising
    fraction done, and may raise to stop.
    """
    share = FIRST_POSE / (FIRST_POSE + len(poses) - 1)
    mesh, pose, part = poses[0].make(), poses[0], part_of(progress, 0.0, share)
    asked = mesh, pose.tolerance, method, vertices, part
    found = face_depths(*asked, effort=effort, variation=pose.variation, is_checked=True)
    every = np.ones(mesh.face_count, dtype=bool)
    _prove(poses, method, vertices, effort, found, every, part_of(progress, share, 1 - share), first=1)
    return found


def raised_depths(
    poses: Sequence[Pose],
    method: str,
    vertices: str,
    found: FaceDepths,
    floors: NDArray[np.int32],
    progress: Progress = no_report,
    *,
    effort: str = "NORMAL",
) -> FaceDepths:
    """The depths found by ``pose_depths`` with the same arguments, raised to at least the floors (F,) int32, with
    bounds."""
    lower = np.flatnonzero(floors > found.depths)
    if not len(lower):
        return found
    deeper = deepcopy(found)
    _deepen(deeper, lower, floors[lower])
    _prove(poses, method, vertices, effort, deeper, floors > found.depths, progress)
    return deeper


def deepest_pose(
    poses: Sequence[Pose],
    method: str,
    vertices: str,
    found: FaceDepths,
    tick: Callable[[], None],
    *,
    effort: str = "NORMAL",
) -> int:
    """The first pose in which a face of the deepest depth has no proof at the level before; the first of all if there
    is none. Arguments: as in ``pose_depths``; found: its result; tick: may raise to stop."""
    deepest = found.depths.max(initial=0)
    faces = np.flatnonzero(found.depths == deepest)
    levels = found.depths - 1
    for place, pose in enumerate(poses if deepest else ()):
        blocks = pose.bounds_at(faces, levels, (Method(method), Vertices(vertices), Effort(effort)), tick)
        if any(np.isinf(block.bounds).any() for block in blocks):
            return place
    return 0


def _prove(
    poses: Sequence[Pose],
    method: str,
    vertices: str,
    effort: str,
    found: FaceDepths,
    is_open: BoolArray,
    progress: Progress,
    first: int = 0,
) -> None:
    """Prove the depths of open faces (F,) in all poses, and raise the depths without a proof. first: the first pose not
    yet proved."""
    kinds, done = (Method(method), Vertices(vertices), Effort(effort)), 0.0
    while np.any(is_open):
        raised = np.zeros(len(is_open), dtype=bool)
        for place, pose in enumerate(poses):
            faces = np.flatnonzero(is_open | raised)
            if place >= first and len(faces):
                raised[_raised(pose, kinds, found, faces, partial(progress, done))] = True
            done = max(done, (place + 1) / len(poses))
            progress(done)
        is_open, first = raised, 0


def _raised(
    pose: Pose,
    kinds: tuple[Method, Vertices, Effort],
    found: FaceDepths,
    faces: IndexArray,
    tick: Callable[[], None],
) -> IndexArray:
    """The faces without a proof at their depths in a pose, raised by one level; records the bounds of the others."""
    parts = [faces[:0]]
    for block in pose.bounds_at(faces, found.depths, kinds, tick):
        holds = np.isfinite(block.bounds)
        proved = block.faces[holds]
        found.bounds[proved] = np.maximum(found.bounds[proved], block.bounds[holds])
        found.lasting[block.faces] &= block.lasting
        found.alone[block.faces] &= block.alone
        parts.append(block.faces[~holds])
    failing = np.concatenate(parts)
    _deepen(found, failing, found.depths[failing] + 1)
    return failing


def _deepen(found: FaceDepths, faces: IndexArray, depths: NDArray[np.int32]) -> None:
    """Give some faces greater depths, still without proof."""
    found.depths[faces], found.bounds[faces], found.distances[faces] = depths, 0.0, 0.0
    found.exact[faces], found.lasting[faces], found.alone[faces] = False, True, True
    found.might_need_less[faces] = False
