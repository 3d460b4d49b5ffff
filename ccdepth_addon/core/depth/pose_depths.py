# SPDX-License-Identifier: GPL-3.0-or-later
"""The depths of faces over several poses of a mesh: positions of its vertices, as on the frames of an animation.

The depth of a face is the first level, from the deepest of its depths in single poses on, at which it is proved to be
within the tolerance in all of them; its bound is the largest one proved there. The first pose is searched level by
level. Every other one is then tested at the depths so far, and searched only where they are not enough; what a pose
makes deeper is tested again in those before it.

The distance of a facet from its patch is linear in the control points. Every few poses there is a key pose, of which
all faces are evaluated. A pose between two of them is a mean of these and a small rest, so its distances are at most
the mean of theirs and the norm's bound of the rest: faces for which that is within the tolerance are not evaluated, and
have that bound. The faces left of many poses are evaluated together, as one mesh in units of the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from ..bounds.norm_bounds import PATCH_METHODS, Method, PatchBounds, Vertices
from ..bounds.rounding import largest_coordinate, rounding_allowance
from ..mesh.copies import side_by_side
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces, submesh
from ..progress import Progress, no_report, part_of
from ..surface.patches import PatchKind, PatchKinds, classify_patches
from .certified_depth import certified_bounds_at
from .face_depths import all_within, depths_in_chunks, face_depths, level_bounds_in_chunks, uniform_level
from .modifier_quality import unmet_corners
from .norm_depth import patch_bounds
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Faces of all poses evaluated together.
FACES_TOGETHER = 1 << 16

# Every so many poses one is a key pose.
POSES_BY_A_KEY = 8

# The share of the time that the first pose takes, in units of what every other one takes.
FIRST_POSE = 3.0

# The bounds by norms are at most so many times the longest vector of a net: a second difference has four of them, of a
# first difference at most twice the norm is taken, and no factor is more than 1.
LARGEST_NORM = 4.0

# What may be added to all distances, in units of the tolerance, to save the computing of norms.
NEGLIGIBLE = 1 / 64

# Relative; distances that are nearer to each other than this are alike: those of what is turned, in single precision.
ALIKE = 1e-6

# Relative; more than a product of two numbers is off by in double precision.
ROUNDING = 2.0**-51


@dataclass(frozen=True)
class Pose:
    """One pose of a mesh.

    make: gives the mesh in it, anew each time, so that many need not be held at once. All poses of a mesh have the same
    faces, edges and explicit sharpness (``PolygonMesh.changed``). tolerance: in the unit of the positions.
    """

    make: Callable[[], PolygonMesh]
    tolerance: float


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


@dataclass(frozen=True)
class WorstPose:
    """Of the poses with a face of the deepest depth, the one in which such a face is the farthest off.

    pose: its index. depth: that depth. share: the distance proved there, as a part of the tolerance.
    """

    pose: int
    depth: int
    share: float


def pose_depths(poses: Sequence[Pose], method: str, vertices: str, progress: Progress = no_report) -> PoseDepths:
    """The depth of every face over all poses of a mesh, which have been checked (``check_pose``).

    method, vertices: as of ``face_depths``. progress: is told the fraction done, which only rises, and may raise to
    stop.
    """
    share = FIRST_POSE / (FIRST_POSE + len(poses) - 1)
    mesh, tolerance = poses[0].make(), poses[0].tolerance
    first = face_depths(mesh, tolerance, method, vertices, part_of(progress, 0.0, share), is_checked=True)
    unknown = np.full(mesh.face_count, np.inf)
    found = PoseDepths(first.depths, first.bounds, first.exact, first.lasting, unknown, 0.0)
    if len(poses) == 1:
        return found
    prepared = _Prepared.of(mesh, Method(method), Vertices(vertices))
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
    prepared = _Prepared.of(poses[0].make(), Method(method), Vertices(vertices))
    search = _PoseSearch.of(prepared, poses, found, progress, 0.0)
    search.depths[lower], search.bounds[lower], search.exact[lower] = floors[lower], 0.0, False
    search.raised[lower] = 0
    search.peaks, search.allowance = found.peaks, found.allowance
    search.test_raised()
    return search.found


@dataclass(frozen=True)
class _Prepared:
    """What the poses of a mesh have in common, and how they are bounded."""

    mesh: PolygonMesh
    kinds: PatchKinds
    method: Method
    vertices: Vertices

    @staticmethod
    def of(mesh: PolygonMesh, method: Method, vertices: Vertices) -> _Prepared:
        return _Prepared(mesh, classify_patches(mesh), method, vertices)

    def norms(self, mesh: PolygonMesh, faces: IndexArray) -> Iterator[tuple[IndexArray, PatchBounds]]:
        """The bounds by norms of those of the faces that are patches, in a pose."""
        method = PATCH_METHODS[Method.SHARP if self.method is Method.CERTIFIED else self.method]
        return patch_bounds(mesh, self.kinds, method, self.vertices, faces)

    def norm_values(
        self, mesh: PolygonMesh, faces: IndexArray | None = None, known: FloatArray | None = None
    ) -> FloatArray:
        """(F,): the values of the bounds by norms of some faces, by default of all, and the known values (F,) of
        others; inf where there is none."""
        values = np.full(mesh.face_count, np.inf) if known is None else known.copy()
        for some, norms in self.norms(mesh, np.arange(mesh.face_count) if faces is None else faces):
            values[some] = norms.value
        return values

    def norm_bounds(self, mesh: PolygonMesh, faces: IndexArray, levels: NDArray[np.int32]) -> FloatArray:
        """(F,): the bounds by norms of some faces, each at its own level (F,); inf where there is none."""
        bounds = np.full(mesh.face_count, np.inf)
        for some, norms in self.norms(mesh, faces):
            bounds[some] = _at_each(norms, levels[some])
        return bounds


def _at_each(norms: PatchBounds, levels: NDArray[np.int32]) -> FloatArray:
    """(P,): the bound of each patch at its own level (P,)."""
    table = np.array([norms.factor(level) for level in range(int(levels.max(initial=0)) + 1)])
    bounds: FloatArray = norms.value * table[levels]
    return bounds


@dataclass(frozen=True)
class _Scaled:
    """A pose in units of its tolerance."""

    mesh: PolygonMesh
    tolerance: float
    allowance: float

    @staticmethod
    def of(pose: Pose) -> _Scaled:
        mesh = pose.make()
        mesh = mesh.changed(positions=mesh.positions / pose.tolerance)
        return _Scaled(mesh, pose.tolerance, _test_of(mesh).allowance)


def _test_of(mesh: PolygonMesh) -> ToleranceTest:
    """The test of a mesh in units of the tolerance. Each scaled coordinate is off by at most uR (``rounding``), each
    point by √3 uR, and the difference of two averages of points by twice that."""
    return ToleranceTest(1.0, rounding_allowance(mesh) + 4 * 2.0**-53 * largest_coordinate(mesh))


@dataclass(frozen=True)
class _Joined:
    """Faces of several poses as one mesh in units of the tolerance.

    faces: (P,) intp, the faces to evaluate. poses, bases: (P,) intp, the pose (its place among those joined) and the
    face of each. tolerances: (P,).
    """

    mesh: PolygonMesh
    faces: IndexArray
    poses: IndexArray
    bases: IndexArray
    tolerances: FloatArray

    @staticmethod
    def of(prepared: PolygonMesh, scaled: Sequence[_Scaled], wanted: Sequence[IndexArray]) -> _Joined:
        """wanted: of each pose the faces to evaluate, rising."""
        union = np.unique(np.concatenate(wanted))
        if len(union) == prepared.face_count:
            part, vertices = prepared, np.arange(prepared.vertex_count)
        else:
            part, kept = submesh(prepared, union)
            vertices = np.zeros(part.vertex_count, dtype=np.intp)
            vertices[part.corner_vertices] = prepared.corner_vertices[corners_of_faces(prepared, kept)]
        positions = np.concatenate([each.mesh.positions[vertices] for each in scaled])
        mesh = side_by_side(part, len(scaled)).changed(positions=positions)
        sizes = [len(faces) for faces in wanted]
        poses = np.repeat(np.arange(len(scaled)), sizes)
        bases = np.concatenate(wanted)
        faces = np.searchsorted(union, bases) + poses * part.face_count
        return _Joined(mesh, faces, poses, bases, np.repeat([each.tolerance for each in scaled], sizes))


def _searched(
    prepared: _Prepared, joined: _Joined, chosen: IndexArray, tick: Callable[[], None]
) -> tuple[NDArray[np.int32], FloatArray, BoolArray]:
    """(chosen,) each: depths, bounds in units of the tolerance, and exactness of some of the joined faces."""
    faces, test = joined.faces[chosen], _test_of(joined.mesh)
    places = np.zeros(joined.mesh.face_count, dtype=np.intp)
    places[faces] = np.arange(len(faces))
    found = FaceDepths.undecided(faces)
    for part in depths_in_chunks(joined.mesh, test, prepared.method, prepared.vertices, faces, tick):
        at = places[part.faces]
        found.depths[at], found.bounds[at], found.exact[at] = part.depths, part.bounds, part.exact
        tick()
    return found.depths, found.bounds, found.exact


def _bounds_at(
    prepared: _Prepared, joined: _Joined, chosen: IndexArray, levels: NDArray[np.int32], tick: Callable[[], None]
) -> FloatArray:
    """(chosen,): the bounds, in units of the tolerance, of some of the joined faces at their own levels (chosen,); inf
    where they are not proved to be within it."""
    faces, test = joined.faces[chosen], _test_of(joined.mesh)
    found = np.full(joined.mesh.face_count, np.inf)
    every = np.zeros(joined.mesh.face_count, dtype=np.int32)
    every[faces] = levels
    blocks: list[Iterator[LevelBounds]]
    if prepared.method is Method.CERTIFIED:
        blocks = [certified_bounds_at(joined.mesh, test, prepared.vertices, faces, every, tick)]
    else:
        blocks = [
            level_bounds_in_chunks(
                joined.mesh, faces[levels == level], test, prepared.method, prepared.vertices, level, tick
            )
            for level in np.unique(levels).tolist()
        ]
    for some in blocks:
        for block in some:
            found[block.faces] = block.bounds
            tick()
    return found[faces]


@dataclass(frozen=True)
class _KeyPose:
    """A pose that others are compared with, (F,) each, in units of the tolerance.

    near: the distances proved at the depths so far; inf where there is none. norms: the values of the bounds by norms.
    """

    scaled: _Scaled
    near: FloatArray
    norms: FloatArray


@dataclass
class _PoseSearch:
    """The depths over the poses so far, (F,) each.

    raised: the round in which the depth of each face was raised last. tested: the one in which each pose was tested
    last. key: the last key pose tested.
    """

    prepared: _Prepared
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
    key: _KeyPose
    allowance: float

    @staticmethod
    def of(
        prepared: _Prepared, poses: Sequence[Pose], found: PoseDepths, progress: Progress, done: float
    ) -> _PoseSearch:
        """Begin with depths that were found of the first pose, or of all of them."""
        depths, bounds, exact = found.depths.copy(), found.bounds.copy(), found.exact.copy()
        scaled = _Scaled.of(poses[0])
        norms = prepared.norm_values(scaled.mesh)
        key = _KeyPose(scaled, bounds / poses[0].tolerance * (1.0 + ROUNDING), norms)
        raised = np.full(len(depths), -1, dtype=np.intp)
        tested = np.zeros(len(poses), dtype=np.intp)
        begun = depths, bounds, exact, found.lasting, norms
        return _PoseSearch(prepared, poses, progress, done, *begun, raised, tested, key, scaled.allowance)

    @property
    def found(self) -> PoseDepths:
        return PoseDepths(self.depths, self.bounds, self.exact, self.lasting, self.peaks, self.allowance)

    def test_all(self) -> None:
        """Test all poses but the first, one stretch after the other."""
        at_once = POSES_BY_A_KEY * max(1, FACES_TOGETHER // len(self.depths))
        share = (1.0 - self.done) / len(self.poses)
        for number, stretch in enumerate(_groups(range(1, len(self.poses)), at_once), start=1):
            self._test_stretch(stretch, number, share)
            self.tested[stretch] = number

    def test_raised(self) -> None:
        """Test the faces whose depths were raised in all poses that were tested before, until all depths hold."""
        number = int(self.tested.max()) + 1
        while True:
            due = [np.flatnonzero(self.raised >= last) for last in self.tested]
            again = [pose for pose, faces in enumerate(due) if len(faces)]
            if not again:
                return
            largest = max(len(due[pose]) for pose in again)
            for batch in _groups(again, max(1, FACES_TOGETHER // largest)):
                self._test(batch, [due[pose] for pose in batch], number)
            self.tested[again] = number
            number += 1

    def _test_stretch(self, stretch: Sequence[int], number: int, share: float) -> None:
        """Test all faces of some poses that follow each other. share: of the progress, for each."""
        groups = list(_groups(stretch, POSES_BY_A_KEY))
        keys = self._test_keys([group[-1] for group in groups], number)
        self.done += share * len(groups)
        at_keys = self.depths.copy()
        for before, group, after in zip(keys[:-1], groups, keys[1:], strict=True):
            between = [_Scaled.of(self.poses[pose]) for pose in group[:-1]]
            left = []
            for scaled in between:
                self._tick()
                left.append(self._not_proved_between(before, scaled, after))
                self.done += share
            if any(map(len, left)):
                self._evaluate(_Joined.of(self.prepared.mesh, between, left), number)
                for key in keys:
                    self._forget_raised(key, at_keys)
        self.key = keys[-1]

    def _test_keys(self, poses: Sequence[int], number: int) -> list[_KeyPose]:
        """The key pose before, and these as key poses: all faces are evaluated, but for those that did not move."""
        keys, left = [self.key], []
        for pose in poses:
            self._tick()
            scaled = _Scaled.of(self.poses[pose])
            moved = _faces_near(self.prepared.mesh, scaled.mesh.positions - keys[-1].scaled.mesh.positions)
            left.append(np.flatnonzero(moved))
            norms = self.prepared.norm_values(scaled.mesh, left[-1], keys[-1].norms)
            self.peaks = np.maximum(self.peaks, norms)
            self.allowance = max(self.allowance, scaled.allowance)
            keys.append(_KeyPose(scaled, np.full(len(norms), np.inf), norms))
        before = self.depths.copy()
        self._find_near(keys[1:], left, number)
        for one, other, faces in zip(keys[:-1], keys[1:], left, strict=True):
            other.near[:] = np.where(np.isin(np.arange(len(before)), faces), other.near, one.near)
        while True:
            raised = np.flatnonzero(self.depths > before)
            if not len(raised):
                for key in keys[1:]:
                    # Those that did not move, too: the tolerance need not be the same length.
                    self._note(key.scaled, np.flatnonzero(key.near <= 1.0), key.near)
                return keys
            before = self.depths.copy()
            self._find_near(keys, [raised] * len(keys), number)

    def _find_near(self, keys: Sequence[_KeyPose], wanted: Sequence[IndexArray], number: int) -> None:
        """Evaluate the wanted faces of key poses."""
        if not any(map(len, wanted)):
            return
        joined = _Joined.of(self.prepared.mesh, [key.scaled for key in keys], wanted)
        found = self._evaluate(joined, number)
        for place, (key, faces) in enumerate(zip(keys, wanted, strict=True)):
            key.near[faces] = found[joined.poses == place]

    def _forget_raised(self, key: _KeyPose, before: NDArray[np.int32]) -> None:
        """Drop what was proved of a key pose at depths (F,) that were raised meanwhile."""
        key.near[self.depths > before] = np.inf

    def _not_proved_between(self, before: _KeyPose, scaled: _Scaled, after: _KeyPose) -> IndexArray:
        """The faces of a pose that comparison with two key poses does not prove to be within the tolerance at their
        depth; the bounds of others are recorded."""
        first, last = before.scaled.mesh.positions, after.scaled.mesh.positions
        share = _nearest_mean(first, scaled.mesh.positions, last)
        rest = scaled.mesh.positions - ((1 - share) * first + share * last)
        # Sums of finite and of infinite bounds, times a share that may be 0.
        with np.errstate(invalid="ignore"):
            near = (1 - share) * before.near + share * after.near
            norms = (1 - share) * before.norms + share * after.norms
        near = np.where(np.isfinite(before.near) & np.isfinite(after.near), near, np.inf)
        norms = np.where(np.isfinite(before.norms), norms, np.inf)
        moved = _faces_near(self.prepared.mesh, rest)
        near[moved & (self.prepared.kinds.kinds == PatchKind.IRREGULAR)] = np.inf
        longest = LARGEST_NORM * float(np.sqrt(squared_norms(rest).max(initial=0.0)))
        if longest <= NEGLIGIBLE:
            near[moved] += longest
            norms[moved] += longest
        else:
            for faces, rests in self.prepared.norms(scaled.mesh.changed(positions=rest), np.flatnonzero(moved)):
                near[faces] += _at_each(rests, self.depths[faces])
                norms[faces] += rests.value
        # Of the rest, a sum of three rounded ones.
        near += 4 * max(before.scaled.allowance, scaled.allowance, after.scaled.allowance)
        self.peaks = np.maximum(self.peaks, norms)
        self.allowance = max(self.allowance, 4 * scaled.allowance)
        self._note(scaled, np.flatnonzero(near <= 1.0), near)
        return np.flatnonzero(~(near <= 1.0))

    def _note(self, scaled: _Scaled, faces: IndexArray, near: FloatArray) -> None:
        """Record that some faces are so near (F,), in units of the tolerance, at their depth in a pose."""
        lengths = np.minimum(near[faces] * (scaled.tolerance * (1.0 + ROUNDING)), scaled.tolerance)
        self.bounds[faces] = np.maximum(self.bounds[faces], lengths)

    def _test(self, batch: Sequence[int], wanted: Sequence[IndexArray], number: int) -> None:
        """Test some faces of some poses: of each the wanted ones, rising."""
        scaled, left = [], []
        for pose, faces in zip(batch, wanted, strict=True):
            self._tick()
            scaled.append(_Scaled.of(self.poses[pose]))
            left.append(self._not_proved_by_norms(scaled[-1], faces))
        if any(map(len, left)):
            self._evaluate(_Joined.of(self.prepared.mesh, scaled, left), number)

    def _not_proved_by_norms(self, scaled: _Scaled, faces: IndexArray) -> IndexArray:
        """Those of the faces whose norm does not prove them to be within the tolerance at their depth; the bounds of
        others are recorded."""
        near = self.prepared.norm_bounds(scaled.mesh, faces, self.depths) + scaled.allowance
        is_near = near[faces] <= 1.0
        self._note(scaled, faces[is_near], near)
        return faces[~is_near]

    def _evaluate(self, joined: _Joined, number: int) -> FloatArray:
        """(P,): the bounds of the joined faces at the depths so far, in units of the tolerance, inf for those that are
        not within it: their depths are raised."""
        depths = self.depths[joined.bases]
        bounds = _bounds_at(self.prepared, joined, np.arange(len(depths)), depths, self._tick)
        holds = np.isfinite(bounds)
        self._record(joined, np.flatnonzero(holds), bounds[holds])
        failing = np.flatnonzero(~holds)
        if len(failing):
            self._raise(joined, failing, number)
        return bounds

    def _record(self, joined: _Joined, chosen: IndexArray, bounds: FloatArray) -> None:
        """Record bounds in units of the tolerance at the depths so far."""
        tolerances = joined.tolerances[chosen]
        lengths = np.minimum(bounds * tolerances * (1.0 + ROUNDING), tolerances)
        np.maximum.at(self.bounds, joined.bases[chosen], lengths)

    def _raise(self, joined: _Joined, failing: IndexArray, number: int) -> None:
        """Find the depths of faces that are not within the tolerance at the depths so far."""
        before = self.depths[joined.bases[failing]]
        depths, bounds, exact = _searched(self.prepared, joined, failing, self._tick)
        # A face can be farther off at a level than at the one before.
        low = np.flatnonzero(depths <= before)
        depths[low], exact[low] = before[low], False
        while len(low):
            depths[low] += 1
            bounds[low] = _bounds_at(self.prepared, joined, failing[low], depths[low], self._tick)
            low = low[~np.isfinite(bounds[low])]
        np.maximum.at(self.depths, joined.bases[failing], depths)
        raised = joined.bases[failing]
        self.bounds[raised], self.exact[raised], self.raised[raised] = 0.0, False, number
        deepest = depths == self.depths[raised]
        self._record(joined, failing[deepest], bounds[deepest])
        self.exact[raised[deepest & exact]] = True

    def _tick(self) -> None:
        self.progress(min(self.done, 1.0))


def _faces_near(mesh: PolygonMesh, change: FloatArray) -> BoolArray:
    """(F,) bool: the faces whose patch depends on a vertex with a change (V, 3): those of faces that share a vertex."""
    vertices = np.any(change != 0.0, axis=1)
    for _ in range(2):
        faces = np.zeros(mesh.face_count, dtype=bool)
        faces[mesh.corner_faces[vertices[mesh.corner_vertices]]] = True
        vertices[mesh.corner_vertices[faces[mesh.corner_faces]]] = True
    return faces


def _nearest_mean(first: FloatArray, positions: FloatArray, last: FloatArray) -> float:
    """The share of the last ones, from 0 to 1, in the mean of two sets of positions that is nearest to a third."""
    way = (last - first).reshape(-1)
    length = float(way @ way)
    return min(max(float((positions - first).reshape(-1) @ way) / length, 0.0), 1.0) if length else 0.0


def _groups(items: Sequence[int], size: int) -> Iterator[list[int]]:
    return (list(items[start : start + size]) for start in range(0, len(items), size))


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
    prepared = _Prepared.of(mesh, Method(method), Vertices(vertices))
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
        wanted = np.flatnonzero((found.depths != level) & ~settled)
        for some, norms in prepared.norms(mesh, wanted):
            settled[some] |= replace(norms, value=found.peaks[some]).at(level) + found.allowance <= 1.0
        wanted = wanted[~settled[wanted]]
        if _all_poses_within(prepared, poses, wanted, np.flatnonzero(with_margin), level, share):
            return level
        level += 1


def _all_poses_within(
    prepared: _Prepared,
    poses: Sequence[Pose],
    faces: IndexArray,
    with_margin: IndexArray,
    level: int,
    progress: Progress,
) -> bool:
    """Whether all of the faces are within the tolerance in all poses at one level, and others within it less their
    margin; ends with the first that is not."""
    levels = np.full(prepared.mesh.face_count, level, dtype=np.int32)
    at_once = max(1, FACES_TOGETHER // max(len(faces), 1))
    for batch in _groups(range(len(poses)), at_once):
        done = batch[0] / len(poses)
        progress(done)
        scaled, left = [], []
        for pose in batch:
            if len(with_margin) and not _within_less_margin(prepared, poses[pose], with_margin, level):
                return False
            if len(faces):
                scaled.append(_Scaled.of(poses[pose]))
                mesh = scaled[-1].mesh
                near = prepared.norm_bounds(mesh, faces, levels)[faces] + scaled[-1].allowance <= 1.0
                left.append(faces[~near])
        if not any(map(len, left)):
            continue
        joined = _Joined.of(prepared.mesh, scaled, left)
        kinds = prepared.method, prepared.vertices
        blocks = level_bounds_in_chunks(
            joined.mesh, joined.faces, _test_of(joined.mesh), *kinds, level, partial(progress, done)
        )
        if not all(block.all_within for block in blocks):
            return False
    return True


def _within_less_margin(prepared: _Prepared, pose: Pose, faces: IndexArray, level: int) -> bool:
    """Whether faces with corners that Blender does not show quite on the surface are within the tolerance less its
    margin for them."""
    mesh = pose.make()
    reduced = pose.tolerance - unmet_corners(mesh).margin(pose.tolerance)
    return all_within(mesh, [(faces, reduced)], prepared.method, prepared.vertices, level, no_report)


def worst_pose(
    poses: Sequence[Pose], method: str, vertices: str, found: PoseDepths, progress: Progress = no_report
) -> WorstPose:
    """The worst pose; of several alike the first. Arguments: as of ``common_level``."""
    deepest = int(found.depths.max(initial=0))
    faces = np.flatnonzero(found.depths == deepest)
    if len(poses) == 1:
        return WorstPose(0, deepest, float(found.bounds[faces].max(initial=0.0)) / poses[0].tolerance)
    prepared = _Prepared.of(poses[0].make(), Method(method), Vertices(vertices))
    worst = _farthest(prepared, poses, faces, deepest, progress, is_own_depth=True)
    # Where no pose alone needs that level: a face can be farther off at a level than at the one before.
    return worst or _farthest(prepared, poses, faces, deepest, progress, is_own_depth=False) or WorstPose(0, deepest, 0)


def _farthest(
    prepared: _Prepared,
    poses: Sequence[Pose],
    faces: IndexArray,
    level: int,
    progress: Progress,
    *,
    is_own_depth: bool,
) -> WorstPose | None:
    """The pose in which one of the faces is the farthest off at a level; is_own_depth: of those in which that is its
    depth."""
    levels = np.full(prepared.mesh.face_count, level, dtype=np.int32)
    worst: WorstPose | None = None
    for batch in _groups(range(len(poses)), max(1, FACES_TOGETHER // len(faces))):
        done = batch[0] / len(poses)
        scaled = [_Scaled.of(poses[pose]) for pose in batch]
        left = []
        for each in scaled:
            allowance = each.allowance
            wanted = prepared.norm_bounds(each.mesh, faces, levels)[faces] + allowance > (worst.share if worst else 0.0)
            if is_own_depth and level > 0:
                wanted &= prepared.norm_bounds(each.mesh, faces, levels - 1)[faces] + allowance > 1.0
            left.append(faces[wanted])
        if not any(map(len, left)):
            continue
        joined = _Joined.of(prepared.mesh, scaled, left)
        every = np.arange(len(joined.faces))
        shares = _shares(prepared, joined, every, level, partial(progress, done), is_own_depth=is_own_depth)
        # The first one that is as far off as any, but for rounding.
        place = int(np.argmax(shares >= shares.max() * (1 - ALIKE)))
        if np.isfinite(shares[place]) and (worst is None or shares[place] > worst.share * (1 + ALIKE)):
            worst = WorstPose(batch[int(joined.poses[place])], level, float(shares[place]))
    return worst


def _shares(
    prepared: _Prepared,
    joined: _Joined,
    chosen: IndexArray,
    level: int,
    tick: Callable[[], None],
    *,
    is_own_depth: bool,
) -> FloatArray:
    """(chosen,): the distance of each of the joined faces at a level, in units of the tolerance; -inf where that is not
    its depth, and has to be."""
    if not is_own_depth:
        return _bounds_at(prepared, joined, chosen, np.full(len(chosen), level, dtype=np.int32), tick)
    depths, bounds, _ = _searched(prepared, joined, chosen, tick)
    return np.where(depths == level, bounds, -np.inf)
