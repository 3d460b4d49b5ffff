# SPDX-License-Identifier: GPL-3.0-or-later
"""The depths of faces over several poses of a mesh: positions of its vertices, as on the frames of an animation.

The depth of a face is the first level, from the deepest of its depths in single poses on, at which it is proved to be
within the tolerance in all of them; its bound is the largest one proved there. The first pose is searched level by
level. Every other one is then tested at the depths so far, and searched only where they are not enough; what a pose
makes deeper is tested again in those before it.

The distance of a facet from its patch is linear in the control points. Every few poses there is a key pose, of which
all faces are evaluated. A pose between two of them is a mean of these and a small rest, so its distances are at most
the mean of theirs and the norm's bound of the rest: faces for which that is within the tolerance are not evaluated, and
have that bound. The faces left of many poses are evaluated together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Method, Vertices
from ..progress import Progress, no_report, part_of
from .distance_poses import confirm, depths_over_poses
from .face_depths import face_depths
from .joined_faces import JoinedFaces, are_enough, bounds_at, in_groups, poses_together, searched
from .key_poses import KeyPose, Way, key_places
from .poses import Pose, PreparedMesh, ScaledPose, faces_near
from .tolerance import FaceDepths

# Times ``poses_together``: poses between key poses that are held until their faces are evaluated.
POSES_HELD = 8

# The share of the time that the first pose takes, in units of what every other one takes.
FIRST_POSE = 3.0

# Relative; more than a product of two numbers is off by in double precision.
ROUNDING = 2.0**-51


@dataclass(frozen=True)
class PoseDepths:
    """The depths of all faces over all poses, (F,) each; distances are in the unit of the positions.

    depths: int32. bounds: float64, the largest distance proved at that depth in any pose. exact: bool, whether every
    lesser depth is disproved in a pose. lasting: bool, whether the face is proved to be within the tolerance in all
    poses at every later level, too. peaks: float64, for faces whose patch has a norm, the largest value of its bounds
    (``PatchBounds``) in units of the tolerance, where it is known; inf for others. allowance: the largest one for
    rounding, in the same units.
    """

    depths: NDArray[np.int32]
    bounds: FloatArray
    exact: BoolArray
    lasting: BoolArray
    peaks: FloatArray
    allowance: float


def pose_depths(poses: Sequence[Pose], method: str, vertices: str, progress: Progress = no_report) -> PoseDepths:
    """The depth of every face over all poses of a mesh, which have been checked (``check_pose``).

    method, vertices: as of ``face_depths``. progress: is told the fraction done, which only rises, and may raise to
    stop.
    """
    if Method(method) is Method.DISTANCE and len(poses) > 1:
        return _by_distance(depths_over_poses(poses, vertices, progress))
    share = FIRST_POSE / (FIRST_POSE + len(poses) - 1)
    mesh, tolerance = poses[0].make(), poses[0].tolerance
    first = face_depths(mesh, tolerance, method, vertices, part_of(progress, 0.0, share), is_checked=True)
    unknown = np.full(mesh.face_count, np.inf)
    found = PoseDepths(first.depths, first.bounds, first.exact, first.lasting, unknown, 0.0)
    if len(poses) == 1:
        return found
    prepared = PreparedMesh.of(mesh, Method(method), Vertices(vertices))
    if prepared.method is Method.CERTIFIED:
        # What is certified of a pose says nothing of others; which norms fall depends on the faces alone.
        found.lasting[:] = False
    search = _PoseSearch.of(prepared, poses, found, progress, share)
    search.test_all()
    search.test_raised()
    return search.found


def raised_depths(
    poses: Sequence[Pose],
    method: str,
    vertices: str,
    found: PoseDepths,
    floors: NDArray[np.int32],
    progress: Progress = no_report,
) -> PoseDepths:
    """What ``pose_depths`` found with the same arguments, for no lesser depths than the floors (F,) int32."""
    lower = floors > found.depths
    if not np.any(lower):
        return found
    if Method(method) is Method.DISTANCE:
        deeper = FaceDepths.undecided(np.arange(len(floors)))
        deeper.depths[:], deeper.bounds[:] = np.maximum(floors, found.depths), found.bounds
        deeper.exact[:], deeper.lasting[:] = False, found.lasting
        confirm(poses, vertices, deeper, [lower & ~found.lasting] * len(poses))
        return _by_distance(deeper)
    prepared = PreparedMesh.of(poses[0].make(), Method(method), Vertices(vertices))
    search = _PoseSearch.of(prepared, poses, found, progress, 0.0)
    search.depths[lower], search.bounds[lower], search.exact[lower] = floors[lower], 0.0, False
    search.raised[lower] = 0
    search.peaks, search.allowance = found.peaks, found.allowance
    search.test_raised()
    return search.found


def _by_distance(found: FaceDepths) -> PoseDepths:
    unknown = np.full(len(found.depths), np.inf)
    return PoseDepths(found.depths, found.bounds, found.exact, found.lasting, unknown, 0.0)


@dataclass
class _PoseSearch:
    """The depths over the poses so far, (F,) each.

    raised: the round in which the depth of each face was raised last. tested: for each pose the round before which it
    was tested at all depths there were. key: the last key pose tested.
    """

    prepared: PreparedMesh
    poses: Sequence[Pose]
    progress: Progress
    done: float
    depths: NDArray[np.int32]
    bounds: FloatArray
    exact: BoolArray
    lasting: BoolArray
    peaks: FloatArray
    raised: IndexArray
    tested: IndexArray
    key: KeyPose
    allowance: float

    @staticmethod
    def of(
        prepared: PreparedMesh, poses: Sequence[Pose], found: PoseDepths, progress: Progress, done: float
    ) -> _PoseSearch:
        """Begin with depths that were found of the first pose, or of all of them."""
        depths, bounds, exact = found.depths.copy(), found.bounds.copy(), found.exact.copy()
        scaled = ScaledPose.of(poses[0])
        norms = prepared.norm_values(scaled.mesh)
        key = KeyPose(scaled, bounds / poses[0].tolerance * (1.0 + ROUNDING), norms)
        raised = np.full(len(depths), -1, dtype=np.intp)
        tested = np.zeros(len(poses), dtype=np.intp)
        begun = depths, bounds, exact, found.lasting, norms
        return _PoseSearch(prepared, poses, progress, done, *begun, raised, tested, key, scaled.allowance)

    @property
    def found(self) -> PoseDepths:
        return PoseDepths(self.depths, self.bounds, self.exact, self.lasting, self.peaks, self.allowance)

    def test_all(self) -> None:
        """Test all poses but the first, one stretch after the other."""
        share = (1.0 - self.done) / len(self.poses)
        keys = key_places(len(self.poses) - 1)
        before = 0
        # Two rounds each: the key poses until all depths hold in them, then the poses between.
        for number, some in enumerate(in_groups(keys, poses_together(len(self.depths))), start=1):
            self._test_stretch(before, some, 2 * number, share)
            self.tested[before : some[-1] + 1] = 2 * number
            before = some[-1]

    def test_raised(self) -> None:
        """Test the faces whose depths were raised in all poses that were tested before, until all depths hold."""
        number = int(self.tested.max()) + 1
        while True:
            due = [np.flatnonzero(self.raised >= last) for last in self.tested]
            again = [pose for pose, faces in enumerate(due) if len(faces)]
            if not again:
                return
            largest = max(len(due[pose]) for pose in again)
            for batch in in_groups(again, poses_together(largest)):
                self._test(batch, [due[pose] for pose in batch], number)
            self.tested[again] = number
            number += 1

    def _test_stretch(self, first: int, places: Sequence[int], number: int, share: float) -> None:
        """Test all faces of the poses after the first one, up to the last of these key poses. number: of the round for
        poses between key poses. share: of the progress, for each."""
        keys = self._test_keys(places, number - 1)
        self.done += share * len(places)
        at_keys = self.depths.copy()
        at_once = POSES_HELD * poses_together(len(self.depths))
        scaled: list[ScaledPose] = []
        left: list[IndexArray] = []
        for before, after, start, end in zip(keys[:-1], keys[1:], [first, *places[:-1]], places, strict=True):
            way = Way.between(before, after)
            for pose in range(start + 1, end):
                self._tick()
                between = ScaledPose.of(self.poses[pose])
                faces = self._not_proved_between(way, between)
                self.done += share
                if len(faces):
                    scaled.append(between)
                    left.append(faces)
                if len(scaled) == at_once or are_enough(left):
                    self._evaluate_between(scaled, left, number, keys, at_keys)
                    scaled, left = [], []
        if scaled:
            self._evaluate_between(scaled, left, number, keys, at_keys)
        self.key = keys[-1]

    def _evaluate_between(
        self,
        scaled: Sequence[ScaledPose],
        left: Sequence[IndexArray],
        number: int,
        keys: Sequence[KeyPose],
        at_keys: NDArray[np.int32],
    ) -> None:
        """Evaluate faces of poses between key poses, and drop what was proved of these at depths (F,) that are raised
        since."""
        self._evaluate(JoinedFaces.of(self.prepared, scaled, left), number)
        for key in keys:
            key.near[self.depths > at_keys] = np.inf

    def _not_proved_between(self, way: Way, scaled: ScaledPose) -> IndexArray:
        """The faces of a pose that comparison with two key poses does not prove to be within the tolerance at their
        depth; the bounds of others are recorded."""
        near, norms = way.bounds_between(self.prepared, scaled, self.depths)
        self.peaks = np.maximum(self.peaks, norms)
        self.allowance = max(self.allowance, 4 * scaled.allowance)
        is_near = near <= 1.0
        self._note(scaled, is_near, near)
        return np.flatnonzero(~is_near)

    def _test_keys(self, poses: Sequence[int], number: int) -> list[KeyPose]:
        """The key pose before, where nothing is proved in it, and these as key poses: all faces are evaluated, but for
        those that did not move."""
        keys, left = [self.key], [np.flatnonzero(np.isinf(self.key.near))]
        for pose in poses:
            self._tick()
            scaled = ScaledPose.of(self.poses[pose])
            moved = faces_near(self.prepared.mesh, scaled.mesh.positions - keys[-1].scaled.mesh.positions)
            left.append(np.flatnonzero(moved))
            norms = self.prepared.norm_values(scaled.mesh)
            self.peaks = np.maximum(self.peaks, norms)
            self.allowance = max(self.allowance, scaled.allowance)
            keys.append(KeyPose(scaled, np.full(len(norms), np.inf), norms))
        raised = self._find_near(keys, left, number)
        for one, other, faces in zip(keys[:-1], keys[1:], left[1:], strict=True):
            other.near[:] = np.where(np.isin(np.arange(len(raised)), faces), other.near, one.near)
        while np.any(raised):
            left = [np.flatnonzero(raised & np.isinf(key.near)) for key in keys]
            raised = self._find_near(keys, left, number)
        for key in keys[1:]:
            # Those that did not move, too: the tolerance need not be the same length.
            self._note(key.scaled, key.near <= 1.0, key.near)
        return keys

    def _find_near(self, keys: Sequence[KeyPose], wanted: Sequence[IndexArray], number: int) -> BoolArray:
        """Bound the wanted faces of key poses at the depths so far; (F,) bool, those that are not within the tolerance
        there. They have deeper ones then, and bounds in those poses alone that need them."""
        before = self.depths.copy()
        if not any(map(len, wanted)):
            return np.zeros(len(before), dtype=bool)
        joined = JoinedFaces.of(self.prepared, [key.scaled for key in keys], wanted)
        found = self._evaluate(joined, number)
        raised = self.depths > before
        for place, (key, faces) in enumerate(zip(keys, wanted, strict=True)):
            key.near[raised] = np.inf
            key.near[faces] = found[joined.poses == place]
        return raised

    def _note(self, scaled: ScaledPose, chosen: BoolArray, near: FloatArray) -> None:
        """Record that the chosen faces (F,) are so near (F,), in units of the tolerance, at their depth in a pose."""
        lengths = np.minimum(near * (scaled.tolerance * (1.0 + ROUNDING)), scaled.tolerance)
        np.maximum(self.bounds, lengths, out=self.bounds, where=chosen)

    def _test(self, batch: Sequence[int], wanted: Sequence[IndexArray], number: int) -> None:
        """Test some faces of some poses: of each the wanted ones, rising."""
        scaled, left = [], []
        for pose, faces in zip(batch, wanted, strict=True):
            self._tick()
            scaled.append(ScaledPose.of(self.poses[pose]))
            left.append(self._not_proved_by_norms(scaled[-1], faces))
        if any(map(len, left)):
            self._evaluate(JoinedFaces.of(self.prepared, scaled, left), number)

    def _not_proved_by_norms(self, scaled: ScaledPose, faces: IndexArray) -> IndexArray:
        """Those of the faces whose norm does not prove them to be within the tolerance at their depth; the bounds of
        others are recorded."""
        near = self.prepared.norm_bounds(scaled.mesh, faces, self.depths) + scaled.allowance
        is_near = near <= 1.0
        self._note(scaled, is_near, near)
        return faces[~is_near[faces]]

    def _evaluate(self, joined: JoinedFaces, number: int) -> FloatArray:
        """(P,): the bounds of the joined faces at the depths so far, in units of the tolerance.

        The depths of those that are not within it are raised: theirs are the bounds at the new ones, inf where unknown.
        """
        depths = self.depths[joined.bases]
        bounds = bounds_at(joined, depths, self._tick)
        holds = np.isfinite(bounds)
        self._record(joined, np.flatnonzero(holds), bounds[holds])
        failing = np.flatnonzero(~holds)
        if len(failing):
            known, found = self._raise(joined, failing, number)
            bounds[self.depths[joined.bases] > depths] = np.inf
            bounds[known] = found
        return bounds

    def _record(self, joined: JoinedFaces, chosen: IndexArray, bounds: FloatArray) -> None:
        """Record bounds in units of the tolerance at the depths so far."""
        tolerances = joined.tolerances[chosen]
        lengths = np.minimum(bounds * tolerances * (1.0 + ROUNDING), tolerances)
        np.maximum.at(self.bounds, joined.bases[chosen], lengths)

    def _raise(self, joined: JoinedFaces, failing: IndexArray, number: int) -> tuple[IndexArray, FloatArray]:
        """Find the depths of faces that are not within the tolerance at the depths so far. Returns those of the joined
        faces that need these, and their bounds."""
        before = self.depths[joined.bases[failing]]
        depths, bounds, exact = searched(joined.at(failing), self._tick)
        # A face can be farther off at a level than at the one before.
        low = np.flatnonzero(depths <= before)
        depths[low], exact[low] = before[low], False
        while len(low):
            depths[low] += 1
            bounds[low] = bounds_at(joined.at(failing[low]), depths[low], self._tick)
            low = low[~np.isfinite(bounds[low])]
        np.maximum.at(self.depths, joined.bases[failing], depths)
        raised = joined.bases[failing]
        self.bounds[raised], self.exact[raised], self.raised[raised] = 0.0, False, number
        deepest = depths == self.depths[raised]
        self._record(joined, failing[deepest], bounds[deepest])
        self.exact[raised[deepest & exact]] = True
        return failing[deepest], bounds[deepest]

    def _tick(self) -> None:
        self.progress(min(self.done, 1.0))
