# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth by distance between the sets themselves, independent of parameters. docs/distance.md.

Level by level, a face is settled where the certified bound, with the distance of triangles from facets, is within the
tolerance, or feet on the surface are (``foot_bounds``). Of the others that samples do not disprove, the leaves are
mapped onto their triangles (``leaf_maps``), and measured as far as the effort allows (``leaf_deviations``). In the end
leaves of the deepest faces are measured at the levels passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..bounds.rounding import largest_coordinates
from ..deviation.leaf_deviations import DrawnLeaves
from ..deviation.measure import measuring_allowance
from ..distance.face_feet import FaceFeet, FoundByFeet
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from .certified_depth import DrawnLevels, certified_level_bounds
from .disproved_levels import DisprovedLevels
from .level_leaves import DEEPEST_REGULAR, RINGS, LevelLeaves, mask, rings_around
from .like_parts import LikeParts, like_parts
from .lone_polygons import lone_polygon_bounds
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# The number of leaves expected in a group of faces, with the leaves around them; and the number beyond which a group is
# examined in parts.
LEAVES_AT_ONCE, MOST_LEAVES = 1 << 15, 1 << 16

# Feet that depths are proved with are nearer than the limit by this part.
FEET_MARGIN = 2.0**-30

# The number of leaves measured together.
MEASURED_AT_ONCE = 1 << 12

# The levels up to which faces are expected to have all of their leaves; later, larger parts have bounds, mostly.
MOST_DIVIDED = 3

# The number of leaves of faces with bounds by feet beyond the limit that are mapped at a level, and of these faces that
# are measured.
MOST_MAPPED, MOST_REGULAR = 1 << 14, 1 << 9

# The number of leaves measured with the effort NORMAL, apart from those of the deepest faces; and the number of the
# deepest faces first measured together, doubled each time.
MOST_MEASURED, FIRST_MEASURED = 1 << 16, 1 << 6

# The factor by which distances shrink at most from level to level, mostly: levels up to which samples would stay beyond
# the limit are not tried.
FASTEST = 5.0

# The level of faces of which no level is open.
NO_LEVEL = np.iinfo(np.intp).max

# The largest distance between vertices of like parts, in parts of the tolerance.
LARGEST_OFF = 2.0**-9

# The number of faces cut out of the mesh together.
MOST_FACES_AT_ONCE = 1 << 11


class Effort(StrEnum):
    """How much is measured for lesser depths: nothing, a number of leaves, or all that may be within the tolerance."""

    QUICK = "QUICK"
    NORMAL = "NORMAL"
    FULL = "FULL"


def distance_depths(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    effort: Effort,
    tick: Callable[[], None],
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop.

    At level 0 vertices are control points, as no modifier moves anything.
    """
    parts, in_parts = _one_of_each(mesh, test)
    disproved: list[DisprovedLevels] = []

    for found in _depths_in_parts(parts.mesh, in_parts, vertices, np.unique(parts.faces[faces]), effort, tick):
        for level in np.unique(found.depths[found.depths > 0]).tolist():
            own = np.flatnonzero(found.depths == level)
            disproved[:] = disproved or [DisprovedLevels.of(parts.mesh, vertices, in_parts, tick)]
            found.exact[own] = disproved[0].all_before(level, found.faces[own], tick)
        some, places = parts.like(faces, found.faces)
        yield replace(found.at(places), faces=some)


def _one_of_each(mesh: PolygonMesh, test: ToleranceTest) -> tuple[LikeParts, ToleranceTest]:
    """One of each part of a mesh, and the test for its distances: those of a like part differ by ``off`` at the mesh
    and at the surface. docs/distance.md, Like parts."""
    if not test.is_common:
        # Copies of a face may have other tolerances, and so may what is near them.
        return LikeParts(mesh, np.arange(mesh.face_count), 0.0), test
    parts = like_parts(mesh, LARGEST_OFF * test.tolerance, test.tolerance)
    return parts, replace(test, allowance=test.allowance + 2 * parts.off)


def _depths_in_parts(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    effort: Effort,
    tick: Callable[[], None],
) -> Iterator[FaceDepths]:
    """The depths of some faces, as of ``distance_depths``, but for ``exact``."""
    some = _SomeFaces.of(mesh, faces, test, vertices, tick)
    whole = FaceDepths.undecided(faces)
    opened = np.full(len(faces), NO_LEVEL)

    def found(places: IndexArray) -> FaceDepths:
        chosen = whole.at(places)
        # Until here, bounds are without the allowance.
        return replace(chosen, bounds=chosen.bounds + test.allowance)

    searches = [DrawnLevels(mesh, test, vertices.of_level(level), level) for level in (0, 1)]
    left = np.arange(len(faces))
    level, measured = 0, 0
    while len(left):
        certified = searches[level > 0 and vertices is Vertices.LIMIT].bounds(faces[left], tick)
        bounds, is_open, spent = some.at(level, left, certified - test.allowance, effort, measured)
        measured += spent
        opened[left[is_open]] = np.minimum(opened[left[is_open]], level)
        is_settled = np.isfinite(bounds.bounds)
        settled = left[is_settled]
        whole.depths[settled], whole.bounds[settled] = level, bounds.bounds[is_settled]
        whole.lasting[settled] = np.broadcast_to(bounds.lasting, is_settled.shape)[is_settled]
        whole.alone[settled] = np.broadcast_to(bounds.alone, is_settled.shape)[is_settled]
        yield found(settled[opened[settled] == NO_LEVEL])
        left = left[~is_settled]
        level += 1
    if effort is not Effort.QUICK:
        some.lower_deepest(whole, opened)
    whole.might_need_less[:] = opened < whole.depths
    yield found(np.flatnonzero(opened < NO_LEVEL))


def distance_bounds_at(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    levels: NDArray[np.int32],
    effort: Effort,
    tick: Callable[[], None],
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces, each at its own level, in the sense of ``distance_depths``, in chunks.

    levels: (F,) int32. effort, tick: as of ``distance_depths``, but anything above QUICK measures all leaves.
    """
    for level in np.unique(levels[faces]).tolist():
        some = _SomeFaces.of(mesh, faces[levels[faces] == level], test, vertices, tick)
        every = np.arange(len(some.faces))
        found, is_open, _ = some.at(level, every, some.certified_at(level, every), effort)
        # Faces are as many as they are: what was passed over is examined.
        are_measured = effort is not Effort.QUICK
        found.bounds[is_open] = some.by_leaves(level, every[is_open], are_measured=are_measured).bounds
        yield LevelBounds(some.faces, found.bounds + test.allowance, found.lasting, found.alone | is_open)


def distance_level_bounds(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    level: int,
    tick: Callable[[], None],
    is_proved: BoolArray | None = None,
    effort: Effort = Effort.NORMAL,
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, both ways, in chunks. tick, is_proved, effort: as of
    ``level_bounds_in_chunks``."""
    parts, in_parts = _one_of_each(mesh, test)
    is_proved = is_proved if is_proved is None else parts.in_all(is_proved)
    own = np.unique(parts.faces[faces])
    for found in _level_bounds_in_parts(parts.mesh, in_parts, vertices, own, level, tick, is_proved, effort):
        some, places = parts.like(faces, found.faces)
        yield LevelBounds(some, found.bounds[places])


def _level_bounds_in_parts(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    level: int,
    tick: Callable[[], None],
    is_proved: BoolArray | None,
    effort: Effort,
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, as of ``distance_level_bounds``."""
    if not len(faces):
        return
    some, every = _SomeFaces.of(mesh, faces, test, vertices, tick), np.arange(len(faces))
    certified = np.minimum(some.certified_at(level, every), some.lone)
    is_left = np.isinf(certified)
    yield LevelBounds(faces[~is_left], certified[~is_left] + test.allowance)
    for found in some.feet_at(level, np.flatnonzero(is_left)):
        short = found.faces[found.are_short]
        is_left[short] = False
        yield LevelBounds(faces[short], found.bounds[found.are_short] + test.allowance)
    is_polygon = is_left & (mesh.face_sizes[faces] != 4) & (level == 0)
    yield LevelBounds(faces[is_polygon], certified[is_polygon])
    left = np.flatnonzero(is_left & ~is_polygon)
    are_measured = effort is not Effort.QUICK
    for group in index_chunks(left, MOST_FACES_AT_ONCE):
        found_here = some.by_leaves(level, group, are_measured=are_measured, are_joined=True, is_proved=is_proved)
        yield LevelBounds(faces[group], found_here.bounds + test.allowance)


@dataclass(frozen=True)
class _ByLeaves:
    """The findings for the leaves of some faces (m,). bounds: (m,), infinite without a proof within the limit. is_lost:
    (m,) bool, whether samples or estimates are beyond the limit, or nothing could be proved. farthest: (m,), the
    largest distance sampled beyond the limit, 0 without one. measured: the number of leaves measured."""

    bounds: FloatArray
    is_lost: BoolArray
    farthest: FloatArray
    measured: int

    @staticmethod
    def joined(parts: list[_ByLeaves]) -> _ByLeaves:
        """The findings of several groups, one after the other."""
        bounds = np.concatenate([np.zeros(0), *(part.bounds for part in parts)])
        is_lost = np.concatenate([np.zeros(0, dtype=bool), *(part.is_lost for part in parts)])
        farthest = np.concatenate([np.zeros(0), *(part.farthest for part in parts)])
        return _ByLeaves(bounds, is_lost, farthest, sum(part.measured for part in parts))


@dataclass
class _SomeFaces:
    """Some faces (n,) of a mesh, ascending. lone: (n,), their bounds at any level as of ``lone_polygon_bounds``,
    infinite beyond the limit. next_levels: (n,) intp, the next level at which leaves are examined.
    footed: (k,) intp, the places of faces with bounds by feet, and feet: the bounds, of a mesh with these as its first
    faces."""

    mesh: PolygonMesh
    faces: IndexArray
    vertices: Vertices
    test: ToleranceTest
    rounded: float
    lone: FloatArray
    next_levels: IndexArray
    tick: Callable[[], None]
    footed: IndexArray | None = None
    feet: FaceFeet | None = None

    @staticmethod
    def of(
        mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, tick: Callable[[], None]
    ) -> _SomeFaces:
        rounded = measuring_allowance(mesh, float(largest_coordinates(mesh).max()))
        lone = lone_polygon_bounds(mesh, faces)
        lone[~test.within(lone)] = np.inf
        return _SomeFaces(mesh, faces, vertices, test, rounded, lone, np.zeros(len(faces), dtype=np.intp), tick)

    def feet_at(self, level: int, places: IndexArray) -> Iterator[FoundByFeet]:
        """The bounds by feet of faces at some places (m,), with places for faces. Later places are among the first
        ones."""
        if not len(places):
            return
        if self.feet is None or self.footed is None:
            around, count, faces = self.mesh, self.mesh.face_count, self.faces[places]
            if len(places) < count:
                # The faces that touch the given ones need bounds as well, and so the faces around them.
                near = submesh(self.mesh, faces)[1]
                around, count = submesh(self.mesh, near)[0].changed(axes=self.mesh.axes), len(near)
            self.footed = places
            self.feet = FaceFeet.of(around, self.vertices, np.zeros(count, dtype=bool), self.tick)
        own = np.searchsorted(self.footed, places)
        for found in self.feet.bounds(own, level, self.vertices.of_level(level), self.limit, self.tick):
            yield replace(found, faces=self.footed[found.faces])

    def are_likely(self, level: int, places: IndexArray, have_bounds: BoolArray) -> BoolArray:
        """(m,) bool, for faces at some of the places with feet: whether leaves may be within the limit at a level. The
        distances of regular faces are estimated where faces have bounds (m,) bool, and not tried at deep levels."""
        if self.feet is None or self.footed is None:
            return np.zeros(0, dtype=bool)
        own = np.searchsorted(self.footed, places)
        found: BoolArray = (self.feet.places[own] < 0) | (level <= DEEPEST_REGULAR)
        estimated = np.flatnonzero(found & have_bounds)
        found[estimated] = self.feet.likely(own[estimated], level, self.vertices.of_level(level)) <= self.limit
        return found

    @property
    def limit(self) -> float:
        """The largest useful distance, without the allowance."""
        return self.test.tolerance - self.test.allowance

    def at(
        self, level: int, places: IndexArray, certified: FloatArray, effort: Effort, measured: int = 0
    ) -> tuple[LevelBounds, BoolArray, int]:
        """The bounds of the faces at some places (m,) at a level, without the allowance, infinite without a proof
        within the limit; (m,) bool, whether a face without a proof is open: nothing tells that it is beyond the limit;
        and the number of leaves measured.

        certified: (m,), the certified bounds. measured: the number of leaves measured so far.
        """
        every = len(self.faces)
        bounds, lasting, is_open, has_bound = np.full(every, np.inf), *np.zeros((3, every), dtype=bool)
        bounds[places] = certified = np.minimum(certified, self.lone[places])
        alone = np.isfinite(bounds)
        for found in self.feet_at(level, places[np.isinf(certified)]):
            is_within = found.bounds <= self.limit
            bounds[found.faces] = np.where(is_within, found.bounds, np.inf)
            lasting[found.faces], is_open[found.faces] = found.lasting, found.is_open & ~is_within
            has_bound[found.faces] = np.isfinite(found.bounds)
        if level == 0:
            is_open &= self.mesh.face_sizes[self.faces] == 4
        is_open &= self.next_levels <= level
        some = np.flatnonzero(is_open)
        some = some[self.are_likely(level, some, has_bound[some])]
        is_open[:] = False
        is_open[some] = True
        regular, others = some[has_bound[some]], some[~has_bound[some]]
        before, most, most_regular = measured, every, every
        if effort is not Effort.FULL:
            regular = regular[: MOST_MAPPED >> 2 * level]
            most = max(MOST_MEASURED - measured, 0) if effort is Effort.NORMAL else 0
            most_regular = max(min(MOST_REGULAR, most - len(others)), 0)
        first = (np.sort(np.concatenate([others[:most], regular[:most_regular]])), True)
        rest = (np.sort(np.concatenate([others[most:], regular[most_regular:]])), False)
        for group, are_measured in (first, rest):
            by_leaves = self.by_leaves(level, group, are_measured=are_measured)
            bounds[group], alone[group] = by_leaves.bounds, True
            is_open[group] = np.isinf(by_leaves.bounds) & ~by_leaves.is_lost & (not are_measured)
            measured += by_leaves.measured
            if level:
                ahead = np.log(np.maximum(by_leaves.farthest / self.limit, 1.0)) / np.log(FASTEST)
                self.next_levels[group] = level + np.maximum(ahead.astype(np.intp), 1)
        found_at = LevelBounds(self.faces[places], bounds[places], lasting[places], alone[places])
        return found_at, is_open[places], measured - before

    def certified_at(self, level: int, places: IndexArray) -> FloatArray:
        """(m,): the certified bounds of the faces at some places (m,) at a level, as drawn, without the allowance;
        infinite beyond the limit."""
        found = np.full(self.mesh.face_count, np.inf)
        faces, shown = self.faces[places], self.vertices.of_level(level)
        for block in certified_level_bounds(
            self.mesh, faces, self.test, shown, level, self.tick, nearly=False, as_drawn=True
        ):
            found[block.faces] = block.bounds - self.test.allowance
        return found[faces]

    def lower_deepest(self, whole: FaceDepths, opened: IndexArray) -> None:
        """Lower the deepest depths by measuring leaves at open levels, until one of them can't be lowered: they decide
        the level for all. opened: (n,) intp, the first open level of each face, ``NO_LEVEL`` without one, and at the
        end for faces that are done."""
        least, count = int(self.vertices is Vertices.LIMIT), FIRST_MEASURED
        while (deepest := int(whole.depths.max(initial=0))) > least:
            deep = np.flatnonzero(whole.depths == deepest)
            if np.any(opened[deep] >= deepest):
                return
            # Faces that were nearly proved to need this depth, first.
            some = np.sort(deep[np.argsort(-opened[deep], kind="stable")][:count])
            for level in range(int(opened[some].min()), deepest):
                own = some[(opened[some] <= level) & (whole.depths[some] > level)]
                found = self.by_leaves(level, own)
                is_lower = np.isfinite(found.bounds)
                lower = own[is_lower]
                whole.depths[lower], whole.bounds[lower] = level, found.bounds[is_lower]
                whole.lasting[lower], whole.alone[lower] = False, True
            opened[some] = whole.depths[some]
            count *= 2

    def by_leaves(
        self,
        level: int,
        places: IndexArray,
        *,
        are_measured: bool = True,
        are_joined: bool = False,
        is_proved: BoolArray | None = None,
    ) -> _ByLeaves:
        """The findings for the leaves of the faces at some places (m,) at a level. are_measured: whether leaves without
        a map are. are_joined: whether bounds hold both ways with any neighbours. is_proved: (F,) bool, whether each
        face has been proved at this level by its leaves."""
        # Leaves with feet for a depth have feet as well where bounds are joined, whatever the rounding.
        limit = self.limit * (1 if are_joined else 1 - FEET_MARGIN)
        at_once = min(MOST_FACES_AT_ONCE, LEAVES_AT_ONCE >> 2 * min(level, MOST_DIVIDED))

        def find(some: IndexArray) -> _ByLeaves:
            leaves = LevelLeaves.of(self.mesh, some, level, self.vertices.of_level(level), limit, MOST_LEAVES)
            if leaves is None:
                return _ByLeaves.joined([find(part) for part in np.array_split(some, min(len(some), 4))])
            proved = np.zeros(len(some), dtype=bool) if is_proved is None else is_proved[some]
            return _distances(
                leaves, self.limit, self.rounded, proved, are_joined=are_joined, are_measured=are_measured
            )

        return _ByLeaves.joined(list(map_in_threads(find, index_chunks(self.faces[places], at_once), self.tick)))


def _distances(
    found: LevelLeaves, limit: float, rounded: float, is_proved: BoolArray, *, are_joined: bool, are_measured: bool
) -> _ByLeaves:
    """The findings for each face's leaves, both ways: bounds at equal parameters, or if these are beyond the limit by a
    map, or else by the deviation. is_proved: (B,) bool, whether the limit is a bound of each leaf of a face without
    feet already. are_joined: whether the surface over neighbouring leaves counts as well, as feet may not cover it
    there. rounded: the rounding allowance of a deviation."""
    leaves, mesh = found.leaves, found.leaves.refinement.mesh
    off, is_lost = np.zeros(len(found.bases)), np.zeros(len(found.bases), dtype=bool)
    own_leaves, places = leaves.keep(found.is_own), np.flatnonzero(found.is_own)
    off[found.is_own] = own_leaves.at_equal_parameters(rounded)
    is_open, measured, farthest = off > limit, 0, np.zeros(len(found.bounds) + 1)
    if is_open.any():
        beside = rings_around(mesh, is_open, 1) & ~found.is_own & are_joined
        off[beside] = leaves.keep(beside).at_equal_parameters(rounded)
        beside &= off > limit
        off[is_open] = limit
        own = is_open & ~np.append(is_proved, False)[found.bases]
        # A face with one leaf beyond the limit is beyond it; each leaf around the faces counts by itself.
        groups = np.where(found.is_own, found.bases, len(found.bounds) + np.arange(len(off)))
        beyond, distances = own_leaves.surface_beyond(np.flatnonzero(own[places]), leaves, limit)
        np.maximum.at(farthest, found.bases[places[beyond]], distances)
        is_lost = own & (farthest[found.bases] > limit)
        is_left = (own | beside) & ~is_lost
        for some in index_chunks(np.flatnonzero(is_left), MEASURED_AT_ONCE):
            bounds = leaves.keep(mask(len(off), some)).mapped(limit, rounded)
            is_mapped = bounds <= limit
            off[some[is_mapped]], is_left[some] = bounds[is_mapped], ~is_mapped
        if are_measured:
            is_lost, measured = _measure(leaves, own, is_left, is_lost, groups, off, limit, rounded)
        off[is_lost | (is_left & (not are_measured))] = np.inf
        off[is_open] = np.maximum(off, _largest_around(mesh, np.where(beside, off, 0.0)))[is_open]
    bounds = found.bounds.copy()
    np.maximum.at(bounds, found.bases[found.is_own], off[found.is_own])
    bounds[bounds > limit] = np.inf
    lost = np.isinf(found.bounds)
    lost[found.bases[is_lost & found.is_own]] = True
    return _ByLeaves(bounds, lost, farthest[:-1], measured)


def _measure(
    leaves: DrawnLeaves,
    own: BoolArray,
    is_left: BoolArray,
    is_lost: BoolArray,
    groups: IndexArray,
    off: FloatArray,
    limit: float,
    rounded: float,
) -> tuple[BoolArray, int]:
    """Measure the leaves (K,) that are left, and write their deviations to ``off``; returns the leaves that are lost,
    and the number of leaves measured. Arguments: as in ``_distances``."""
    mesh = leaves.refinement.mesh
    for some in index_chunks(np.flatnonzero(is_left & own), MEASURED_AT_ONCE):
        near = rings_around(mesh, mask(len(off), some), 1)
        which = np.flatnonzero(near)
        beyond = leaves.keep(near).drawn_beyond(np.flatnonzero(np.isin(which, some)), limit)
        is_lost = is_lost | (own & np.isin(groups, groups[which[beyond]]))
    is_left = is_left & ~is_lost
    for some in index_chunks(np.flatnonzero(is_left), MEASURED_AT_ONCE):
        measured = mask(len(off), some)
        # Leaves measured together are around one another, and so are those that nothing more is asked of.
        around = rings_around(mesh, measured, 1) | (rings_around(mesh, measured, RINGS) & is_lost)
        own_groups = np.unique(groups[around], return_inverse=True)[1]
        deviations = leaves.keep(around).deviations(
            measured[around], (own & measured)[around], own_groups, limit, rounded
        )
        off[some] = deviations[measured[around]]
    return is_lost, int(np.count_nonzero(is_left))


def _largest_around(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(n,): the largest of values (n,) of the first n faces, quads, that share a vertex with each."""
    corners = mesh.corner_vertices[: 4 * len(values)].reshape(-1, 4)
    at_vertices = np.zeros(mesh.vertex_count)
    np.maximum.at(at_vertices, corners, values[:, None])
    return at_vertices[corners].max(axis=1)
