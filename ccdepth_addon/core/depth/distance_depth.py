# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth by distance between the sets themselves, independent of parameters. docs/distance.md.

Regular faces that touch none but regular and extraordinary ones have bounds for all levels by feet on the surface
(``foot_bounds``). Where feet do not decide, and for all other faces, the leaves of a level are mapped onto their
triangles (``leaf_maps``) or measured (``leaf_deviations``), level by level, until all leaves of a face are within the
tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from ..bounds.norm_bounds import Vertices
from ..bounds.rounding import largest_coordinates
from ..deviation.measure import rounding_allowance
from ..distance.face_feet import FaceFeet
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from ..surface.limit_positions import limit_positions
from .certified_depth import certified_level_bounds
from .disproved_levels import DisprovedLevels
from .level_leaves import DEEPEST_REGULAR, RINGS, LevelLeaves, mask, rings_around
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

# Up to the first number, on meshes of up to the second number of faces, regular faces with bounds beyond the tolerance
# are examined leaf by leaf at each level. Each takes some milliseconds. Otherwise the deepest faces alone are examined,
# up to the third number.
MOST_WITH_BOUNDS, MOST_OF_A_MESH, MOST_DEEPEST = 1 << 9, 1 << 12, 1 << 13

# The level of faces of which no level was passed over.
NO_LEVEL = np.iinfo(np.intp).max

# The number of faces cut out of the mesh together.
MOST_FACES_AT_ONCE = 1 << 11


def distance_depths(
    mesh: PolygonMesh, test: ToleranceTest, vertices: Vertices, faces: IndexArray, tick: Callable[[], None]
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop.

    At level 0 vertices are control points, as no modifier moves anything; polygons with more than four corners have
    depth 1 at least.
    """
    some = _SomeFaces.of(mesh, faces, test, vertices, tick)
    disproved = DisprovedLevels.of(mesh, vertices, test, tick)
    whole = FaceDepths.undecided(faces)
    passed = np.full(len(faces), NO_LEVEL)

    def found(places: IndexArray, level: int) -> FaceDepths:
        # Until then, bounds are without the allowance.
        if level:
            whole.exact[places] = disproved.all_before(level, faces[places], tick)
        chosen = FaceDepths(*(column[places] for column in vars(whole).values()))
        chosen.bounds[:] += test.allowance
        return chosen

    left = np.arange(len(faces))
    level = 0
    while len(left):
        bounds, lasting, alone, is_passed = some.at(level, left)
        passed[left[is_passed]] = np.minimum(passed[left[is_passed]], level)
        is_settled = np.isfinite(bounds)
        settled = left[is_settled]
        whole.depths[settled], whole.bounds[settled] = level, bounds[is_settled]
        whole.lasting[settled], whole.alone[settled] = lasting[is_settled], alone[is_settled]
        yield found(settled[passed[settled] == NO_LEVEL], level)
        left = left[~is_settled]
        level += 1
    some.lower_deepest(whole, passed)
    held = np.flatnonzero(passed < NO_LEVEL)
    for depth in np.unique(whole.depths[held]).tolist():
        yield found(held[whole.depths[held] == depth], depth)


def distance_bounds_at(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    levels: NDArray[np.int32],
    tick: Callable[[], None],
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces, each at its own level, in the sense of ``distance_depths``, in chunks.

    levels: (F,) int32. tick: as of ``distance_depths``.
    """
    some = _SomeFaces.of(mesh, faces, test, vertices, tick)
    for level in np.unique(levels[faces]).tolist():
        places = np.flatnonzero(levels[faces] == level)
        bounds, lasting, alone, is_passed = some.at(level, places)
        passed = np.flatnonzero(is_passed)
        if len(passed) <= MOST_DEEPEST:
            bounds[passed], alone[passed] = some.by_leaves_within(level, places[passed]), True
        yield LevelBounds(faces[places], bounds + test.allowance, lasting, alone)


def distance_level_bounds(
    mesh: PolygonMesh,
    test: ToleranceTest,
    vertices: Vertices,
    faces: IndexArray,
    level: int,
    tick: Callable[[], None],
    is_proved: BoolArray | None = None,
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, both ways, in chunks. tick, is_proved: as of
    ``level_bounds_in_chunks``."""
    if not len(faces):
        return
    some = _SomeFaces.of(mesh, faces, test, vertices, tick)
    rest = np.ones(len(faces), dtype=bool)
    for found in some.feet.bounds(np.arange(len(faces)), level, some.shown(level), some.limit, tick):
        short = found.faces[found.are_short]
        rest[short] = False
        yield LevelBounds(faces[short], found.bounds[found.are_short] + test.allowance)
    if level == 0:
        triangles, others = rest & (mesh.face_sizes[faces] == 3), rest & (mesh.face_sizes[faces] > 4)
        yield from some.of_triangles(faces[triangles])
        yield LevelBounds(faces[others], np.full(np.count_nonzero(others), np.inf))
        rest &= ~(triangles | others)
    for block in some.by_leaves(faces[rest], level, are_joined=True, is_proved=is_proved):
        yield LevelBounds(block.faces, np.where(block.bounds <= some.limit, block.bounds + test.allowance, np.inf))


@dataclass(frozen=True)
class _SomeFaces:
    """Some faces (n,) of a mesh, ascending. feet: the bounds by feet of a mesh with these as its first faces."""

    mesh: PolygonMesh
    faces: IndexArray
    feet: FaceFeet
    vertices: Vertices
    test: ToleranceTest
    rounded: float
    tick: Callable[[], None]

    @staticmethod
    def of(
        mesh: PolygonMesh, faces: IndexArray, test: ToleranceTest, vertices: Vertices, tick: Callable[[], None]
    ) -> _SomeFaces:
        around, count = mesh, mesh.face_count
        if len(faces) < mesh.face_count:
            # The faces that touch the given ones need bounds as well, and so the faces around them.
            near = submesh(mesh, faces)[1]
            around, count = submesh(mesh, near)[0].changed(axes=mesh.axes), len(near)
        feet = FaceFeet.of(around, vertices, np.zeros(count, dtype=bool), tick)
        rounded = rounding_allowance(mesh, float(largest_coordinates(mesh).max()))
        return _SomeFaces(mesh, faces, feet, vertices, test, rounded, tick)

    @property
    def limit(self) -> float:
        """The largest useful distance, without the allowance."""
        return self.test.tolerance - self.test.allowance

    def shown(self, level: int) -> Vertices:
        """The vertices of a level: at level 0 the control points, as no modifier moves anything there."""
        return self.vertices if level else Vertices.CONTROL

    def at(self, level: int, places: IndexArray) -> tuple[FloatArray, BoolArray, BoolArray, BoolArray]:
        """(m,) each, for the faces at some places (m,): bounds at a level, infinite without a proof within the limit;
        whether the bounds last; whether they are by leaves; and whether the level was passed over: leaves that are
        likely within the limit were not examined."""
        bounds = np.full(len(self.faces), np.inf)
        lasting, is_open, alone, is_passed = np.zeros((4, len(self.faces)), dtype=bool)
        for found in self.feet.bounds(places, level, self.shown(level), self.limit, self.tick):
            bounds[found.faces], lasting[found.faces], is_open[found.faces] = found.bounds, found.lasting, found.is_open
        if level == 0:
            sizes = self.mesh.face_sizes[self.faces]
            for block in self.of_triangles(self.faces[places[sizes[places] == 3]]):
                bounds[np.searchsorted(self.faces, block.faces)] = block.bounds - self.test.allowance
            is_open &= sizes == 4
        is_open &= (self.feet.places[: len(self.faces)] < 0) | (level <= DEEPEST_REGULAR)
        has_bound = is_open & np.isfinite(bounds)
        if np.count_nonzero(has_bound) > MOST_WITH_BOUNDS or self.mesh.face_count > MOST_OF_A_MESH:
            is_passed[has_bound] = self.feet.likely(np.flatnonzero(has_bound), level, self.shown(level)) <= self.limit
            is_open[has_bound] = False
        left = places[is_open[places]]
        bounds[left], alone[left] = self.by_leaves_within(level, left), True
        bounds[bounds > self.limit] = np.inf
        return bounds[places], lasting[places], alone[places], is_passed[places]

    def of_triangles(self, faces: IndexArray) -> Iterator[LevelBounds]:
        """The bounds of triangles at level 0, in chunks: a triangle is drawn as it is at equal parameters. Where a
        corner is too far from its limit position, there is none."""
        if not len(faces):
            return
        gaps = np.sqrt(squared_norms(limit_positions(self.mesh) - self.mesh.positions))
        corners = self.mesh.corner_vertices[self.mesh.face_starts[faces][:, None] + np.arange(3)]
        is_far = self.test.exceeds(gaps[corners].max(axis=1))
        yield LevelBounds(faces[is_far], np.full(np.count_nonzero(is_far), np.inf))
        near = faces[~is_far]
        yield from certified_level_bounds(self.mesh, near, self.test, Vertices.CONTROL, 0, self.tick, nearly=False)

    def by_leaves_within(self, level: int, places: IndexArray) -> FloatArray:
        """(m,): bounds of the faces at some places (m,), by their leaves at a level; infinite beyond the limit."""
        blocks = self.by_leaves(self.faces[places], level, are_joined=False)
        bounds = np.concatenate([np.zeros(0), *(block.bounds for block in blocks)])
        return np.where(bounds <= self.limit, bounds, np.inf)

    def lower_deepest(self, whole: FaceDepths, passed: IndexArray) -> None:
        """Lower the deepest depths of the faces to the least level allowed by the others and proved by leaves.
        passed: (n,) intp, the first level passed over of each face, ``NO_LEVEL`` without one."""
        least, deepest = int(np.minimum(whole.depths, passed).max(initial=0)), int(whole.depths.max(initial=0))
        for level in range(least, deepest):
            deep = np.flatnonzero(whole.depths > level)
            if len(deep) > MOST_DEEPEST:
                continue
            found = []
            for block in self.by_leaves(self.faces[deep], level, are_joined=False):
                if np.any(block.bounds > self.limit):
                    break
                found.append(block.bounds)
            else:
                whole.depths[deep], whole.bounds[deep] = level, np.concatenate(found)
                whole.lasting[deep], whole.alone[deep] = False, True
                return

    def by_leaves(
        self, faces: IndexArray, level: int, *, are_joined: bool, is_proved: BoolArray | None = None
    ) -> Iterator[LevelBounds]:
        """The bounds of some faces of the mesh by their leaves at a level, in their order, in chunks. are_joined:
        whether bounds hold both ways with any neighbours. is_proved: (F,) bool, whether each face has been proved at
        this level by its leaves."""
        # Leaves with feet for a depth have feet as well where bounds are joined, whatever the rounding.
        limit = self.limit * (1 if are_joined else 1 - FEET_MARGIN)
        at_once = min(MOST_FACES_AT_ONCE, LEAVES_AT_ONCE >> 2 * min(level, MOST_DIVIDED))

        def bound(some: IndexArray) -> LevelBounds:
            leaves = LevelLeaves.of(self.mesh, some, level, self.shown(level), limit, MOST_LEAVES)
            if leaves is None:
                parts = [bound(part) for part in np.array_split(some, min(len(some), 4))]
                return LevelBounds(some, np.concatenate([part.bounds for part in parts]))
            proved = np.zeros(len(some), dtype=bool) if is_proved is None else is_proved[some]
            return LevelBounds(some, _distances(leaves, self.limit, self.rounded, proved, are_joined=are_joined))

        return map_in_threads(bound, index_chunks(faces, at_once), self.tick)


def _distances(
    found: LevelLeaves, limit: float, rounded: float, is_proved: BoolArray, *, are_joined: bool
) -> FloatArray:
    """(B,): the largest bound of each face's leaves, both ways: at equal parameters, or if that is beyond the limit by
    a map, or else the deviation. is_proved: (B,) bool, whether the limit is a bound of each leaf of a face without feet
    already. are_joined: whether the surface over neighbouring leaves counts as well, as feet may not cover it there.
    rounded: the rounding allowance of a deviation."""
    leaves, mesh = found.leaves, found.leaves.refinement.mesh
    off = np.zeros(len(found.bases))
    own_leaves, places = leaves.keep(found.is_own), np.flatnonzero(found.is_own)
    off[found.is_own] = own_leaves.at_equal_parameters(rounded)
    is_open = off > limit
    if is_open.any():
        beside = rings_around(mesh, is_open, 1) & ~found.is_own & are_joined
        off[beside] = leaves.keep(beside).at_equal_parameters(rounded)
        beside &= off > limit
        off[is_open] = limit
        own = is_open & ~np.append(is_proved, False)[found.bases]
        # A face with one leaf beyond the limit is beyond it; each leaf around the faces counts by itself.
        groups = np.where(found.is_own, found.bases, len(found.bounds) + np.arange(len(off)))
        beyond = own_leaves.surface_beyond(np.flatnonzero(own[places]), leaves, limit)
        is_lost = own & np.isin(groups, groups[places[beyond]])
        is_left = (own | beside) & ~is_lost
        for some in index_chunks(np.flatnonzero(is_left), MEASURED_AT_ONCE):
            bounds = leaves.keep(mask(len(off), some)).mapped(limit, rounded)
            is_mapped = bounds <= limit
            off[some[is_mapped]], is_left[some] = bounds[is_mapped], ~is_mapped
        for some in index_chunks(np.flatnonzero(is_left & own), MEASURED_AT_ONCE):
            near = rings_around(mesh, mask(len(off), some), 1)
            which = np.flatnonzero(near)
            beyond = leaves.keep(near).drawn_beyond(np.flatnonzero(np.isin(which, some)), limit)
            is_lost |= own & np.isin(groups, groups[which[beyond]])
        is_left &= ~is_lost
        off[is_lost] = np.inf
        for some in index_chunks(np.flatnonzero(is_left), MEASURED_AT_ONCE):
            measured = mask(len(off), some)
            # Leaves measured together are around one another, and so are those that nothing more is asked of.
            around = rings_around(mesh, measured, 1) | (rings_around(mesh, measured, RINGS) & is_lost)
            own_groups = np.unique(groups[around], return_inverse=True)[1]
            deviations = leaves.keep(around).deviations(
                measured[around], (own & measured)[around], own_groups, limit, rounded
            )
            off[some] = deviations[measured[around]]
        off[is_open] = np.maximum(off, _largest_around(mesh, np.where(beside, off, 0.0)))[is_open]
    bounds = found.bounds.copy()
    np.maximum.at(bounds, found.bases[found.is_own], off[found.is_own])
    return bounds


def _largest_around(mesh: PolygonMesh, values: FloatArray) -> FloatArray:
    """(n,): the largest of values (n,) of the first n faces, quads, that share a vertex with each."""
    corners = mesh.corner_vertices[: 4 * len(values)].reshape(-1, 4)
    at_vertices = np.zeros(mesh.vertex_count)
    np.maximum.at(at_vertices, corners, values[:, None])
    return at_vertices[corners].max(axis=1)
