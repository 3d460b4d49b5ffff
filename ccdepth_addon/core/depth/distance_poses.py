# SPDX-License-Identifier: GPL-3.0-or-later
"""Depths by distance over several poses of a mesh. A distance is not linear in the control points, so nothing follows
for a pose from others: each is computed by itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Method, Vertices
from ..bounds.rounding import rounding_allowance
from ..progress import Progress, part_of
from .face_depths import all_within, depths_in_chunks, face_depths, level_bounds_in_chunks
from .modifier_quality import unmet_corners
from .poses import Pose
from .tolerance import FaceDepths, ToleranceTest


def depths_over_poses(poses: Sequence[Pose], vertices: str, progress: Progress) -> FaceDepths:
    """The depths of all faces in all poses, which have been checked."""
    share = 1 / len(poses)
    every: list[FaceDepths] = []
    for place, pose in enumerate(poses):
        part = part_of(progress, place * share, share)
        own = face_depths(pose.make(), pose.tolerance, Method.DISTANCE, vertices, part, is_checked=True)
        faces = np.arange(len(own.depths))
        every.append(FaceDepths(faces, own.depths, own.bounds, own.distances, own.exact, own.lasting))
    depths = np.maximum.reduce([each.depths for each in every])
    # What is proved of a pose at a lesser depth, and lasts, needs no other proof.
    needs = [(each.depths < depths) & ~each.lasting for each in every]
    bounds = np.maximum.reduce([each.bounds for each in every])
    lasting = np.logical_and.reduce([each.lasting for each in every])
    found = FaceDepths(every[0].faces, depths, bounds, np.zeros_like(bounds), np.zeros(len(depths), bool), lasting)
    confirm(poses, vertices, found, needs)
    return found


def confirm(poses: Sequence[Pose], vertices: str, found: FaceDepths, needs: Sequence[BoolArray]) -> None:
    """Prove depths in poses, and raise those that do not hold. needs: of each pose (F,) bool, the faces to look at."""
    needs = [each.copy() for each in needs]
    while any(map(np.any, needs)):
        for pose, wanted in zip(poses, needs, strict=True):
            faces = np.flatnonzero(wanted)
            wanted[:] = False
            if not len(faces):
                continue
            bounds = bounds_at_depths(pose, vertices, faces, found.depths)
            holds = np.isfinite(bounds)
            np.maximum.at(found.bounds, faces[holds], bounds[holds])
            raised = faces[~holds]
            found.depths[raised] += 1
            for each in needs:
                each[raised] = True


def bounds_at_depths(pose: Pose, vertices: str, faces: IndexArray, depths: NDArray[np.int32]) -> FloatArray:
    """(n,): the bounds of some faces at their depths, (F,), in a pose; infinite where they are not within the
    tolerance."""
    mesh = pose.make()
    test = ToleranceTest(pose.tolerance, rounding_allowance(mesh))
    found = np.full(mesh.face_count, np.inf)
    for level in np.unique(depths[faces]).tolist():
        some = faces[depths[faces] == level]
        for block in level_bounds_in_chunks(mesh, some, test, Method.DISTANCE, Vertices(vertices), level, _nothing):
            found[block.faces] = block.bounds
    return found[faces]


def _nothing() -> None:
    """No progress."""


def all_poses_within(poses: Sequence[Pose], vertices: str, lasting: BoolArray, level: int, progress: Progress) -> bool:
    """Whether all faces are within the tolerance in all poses at a level, less the margin that is left at some corners
    (``uniform_level``). lasting: (F,) bool, faces that are so from an earlier level on."""
    for place, pose in enumerate(poses):
        mesh, margin = pose.make(), 0.0
        with_margin = np.zeros(mesh.face_count, dtype=bool)
        if Vertices(vertices) is Vertices.LIMIT:
            unmet = unmet_corners(mesh)
            with_margin[mesh.corner_faces[unmet.corners]] = True
            margin = unmet.margin(pose.tolerance)
        parts = [
            (np.flatnonzero(~lasting & ~with_margin), pose.tolerance),
            (np.flatnonzero(with_margin), pose.tolerance - margin),
        ]
        part = part_of(progress, place / len(poses), 1 / len(poses))
        if not all_within(mesh, parts, Method.DISTANCE, Vertices(vertices), level, part):
            return False
    return True


def shares_at_depth(pose: Pose, vertices: str, faces: IndexArray, depth: int, tick: Callable[[], None]) -> FloatArray:
    """(n,): the distances of some faces of that depth in a pose, in units of the tolerance; -inf for faces that have
    another there."""
    mesh = pose.make()
    test = ToleranceTest(pose.tolerance, rounding_allowance(mesh))
    found = np.full(mesh.face_count, -np.inf)
    for part in depths_in_chunks(mesh, test, Method.DISTANCE, Vertices(vertices), faces, tick):
        found[part.faces] = np.where(part.depths == depth, part.bounds / pose.tolerance, -np.inf)
    return found[faces]
