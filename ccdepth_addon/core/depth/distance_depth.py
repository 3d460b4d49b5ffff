# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth by distance: of the sets themselves, whatever the parameters. docs/distance.md.

Regular faces among regular ones have bounds for all levels by feet on the surface (``foot_bounds``). Where these do not
decide, and around everything else, the leaves of a level are looked at one by one (``leaf_distances``): level by level,
until all of a face's leaves are within the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from ..arrays.chunks import AT_ONCE, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..distance.foot_bounds import FootBounds, foot_bounds
from ..distance.level_leaves import DEEPEST_REGULAR, LevelLeaves
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.patches import PatchKind, classify_patches, regular_nets
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Leaves looked at together, about, with those around them.
LEAVES_AT_ONCE = 1 << 15

# Faces cut out of the mesh together.
MOST_FACES_AT_ONCE = 1 << 11


def distance_depths(
    mesh: PolygonMesh, test: ToleranceTest, vertices: Vertices, faces: IndexArray, tick: Callable[[], None]
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop.

    At level 0 no modifier moves anything, so there vertices are control points; other polygons than quads have depth 1
    at least.
    """
    feet = _Feet.of(mesh, vertices, tick)
    limit = test.tolerance - test.allowance
    is_quad = mesh.face_sizes == 4
    left = faces
    level = 0
    while len(left):
        shown = vertices if level else Vertices.CONTROL
        bounds = np.full(mesh.face_count, np.inf)
        lasting = np.zeros(mesh.face_count, dtype=bool)
        if level or shown is vertices:
            bounds[left] = feet.at(level, left)
            lasting[left] = feet.at(level, left, longest=0.5**level) <= limit
        open_faces = left[
            (bounds[left] > limit) & (is_quad[left] | (level > 0)) & feet.may_be_within(level, left, limit)
        ]
        for found in _by_leaves(mesh, open_faces, level, shown, limit, tick, joined=False):
            bounds[found.faces] = found.bounds
        settled = left[bounds[left] <= limit]
        yield _settled(settled, level, bounds, lasting, test.allowance)
        left = left[bounds[left] > limit]
        level += 1


def _settled(faces: IndexArray, level: int, bounds: FloatArray, lasting: BoolArray, allowance: float) -> FaceDepths:
    found = FaceDepths.undecided(faces)
    found.settle(np.ones(len(faces), dtype=bool), level, bounds[faces] + allowance)
    found.lasting[:] = lasting[faces]
    return found


def distance_level_bounds(
    mesh: PolygonMesh, test: ToleranceTest, vertices: Vertices, faces: IndexArray, level: int, tick: Callable[[], None]
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, both ways, in chunks. tick: as of ``distance_depths``."""
    shown = vertices if level else Vertices.CONTROL
    limit = test.tolerance - test.allowance
    # Ways no longer than a leaf ask for nothing of other faces but the leaves that touch it.
    bounds = _Feet.of(mesh, shown, tick).at(level, faces, longest=0.5**level)
    proved = bounds <= limit
    yield LevelBounds(faces[proved], bounds[proved] + test.allowance)
    rest = faces[~proved]
    if level == 0:
        others = mesh.face_sizes[rest] != 4
        yield LevelBounds(rest[others], np.full(np.count_nonzero(others), np.inf))
        rest = rest[~others]
    for found in _by_leaves(mesh, rest, level, shown, limit, tick, joined=True):
        yield LevelBounds(found.faces, np.where(found.bounds <= limit, found.bounds + test.allowance, np.inf))


def _by_leaves(
    mesh: PolygonMesh,
    faces: IndexArray,
    level: int,
    vertices: Vertices,
    limit: float,
    tick: Callable[[], None],
    *,
    joined: bool,
) -> Iterator[LevelBounds]:
    """The bounds of faces by their leaves at a level. joined: whether they hold both ways by themselves."""
    at_once = min(MOST_FACES_AT_ONCE, LEAVES_AT_ONCE >> 2 * min(level, DEEPEST_REGULAR))

    def bound(some: IndexArray) -> LevelBounds:
        leaves = LevelLeaves.of(mesh, some, level, vertices, limit, lambda: None)
        distances = leaves.joined_distances if joined else leaves.own_distances
        return LevelBounds(some, distances(lambda: None))

    return map_in_threads(bound, index_chunks(faces, at_once), tick)


# A sine: two normals that are nearer to a third one than 45° do not face apart.
LARGEST_TILT = 0.7


@dataclass(frozen=True)
class _Feet:
    """The bounds by feet of a mesh's faces. places: (F,) intp, of each face among the bounds, -1 where it has none.
    curvature, speed: of the faces with bounds, κ and α of all faces that touch them."""

    places: IndexArray
    bounds: FootBounds
    curvature: FloatArray
    speed: FloatArray

    @staticmethod
    def of(mesh: PolygonMesh, vertices: Vertices, tick: Callable[[], None]) -> _Feet:
        patches = classify_patches(mesh)
        regular = np.flatnonzero(patches.kinds == PatchKind.REGULAR)

        def bound(some: IndexArray) -> FootBounds:
            nets = regular_nets(mesh, some)
            first = foot_bounds(nets, vertices, np.zeros(len(some), dtype=bool))
            if vertices is Vertices.LIMIT:
                return first
            # Of control points nothing tells which diagonal is drawn.
            second = foot_bounds(nets, vertices, np.ones(len(some), dtype=bool))
            larger = {name: np.maximum(vars(first)[name], vars(second)[name]) for name in ("second", "plain")}
            return replace(first, **larger)

        parts = list(map_in_threads(bound, index_chunks(regular, AT_ONCE), tick))
        names = [field.name for field in fields(FootBounds)]
        joined = FootBounds(*(np.concatenate([np.zeros(0), *(vars(part)[name] for part in parts)]) for name in names))
        places = np.full(mesh.face_count, -1)
        places[regular] = np.arange(len(regular))
        at_vertices = np.zeros((2, mesh.vertex_count))
        corners = mesh.corner_vertices[mesh.face_starts[regular][:, None] + np.arange(4)]
        for own, values in zip(at_vertices, (joined.curvature, joined.speed), strict=True):
            for corner in range(4):
                np.maximum.at(own, corners[:, corner], values)
        # Feet stay where the surface is smooth, on faces whose curvature is known.
        others = patches.kinds != PatchKind.REGULAR
        unknown = np.zeros(mesh.vertex_count, dtype=bool)
        unknown[mesh.corner_vertices[others[mesh.corner_faces]]] = True
        at_vertices[:, unknown] = np.inf
        curvature, speed = at_vertices[:, corners].max(axis=2)
        curvature[~patches.inside[regular]] = np.inf
        if vertices is Vertices.LIMIT:
            # Triangles that might face apart would be drawn along the other diagonal: in the space where that is
            # chosen, normals are farther apart by the condition of its axes at most.
            condition = 1.0 if mesh.axes is None else float(np.linalg.cond(mesh.axes))
            curvature[~(joined.tilt <= LARGEST_TILT / condition)] = np.inf
        return _Feet(places, joined, curvature, speed)

    def at(self, level: int, faces: IndexArray, longest: float = 1.0) -> FloatArray:
        """(n,): the bounds of some faces at a level, infinite where there are none. longest: as of ``FootBounds``."""
        found = np.full(len(faces), np.inf)
        has, places = self._places(faces)
        if np.any(has):
            own = FootBounds(*(column[places] for column in vars(self.bounds).values()))
            found[has] = own.at(level, self.curvature[places], self.speed[places], longest)
        return found

    def may_be_within(self, level: int, faces: IndexArray, limit: float) -> BoolArray:
        """(n,) bool: faces that are worth looking at leaf by leaf."""
        found = np.ones(len(faces), dtype=bool)
        has, places = self._places(faces)
        # Without feet, as at borders, nothing else decides.
        is_shallow = np.isinf(self.curvature[places]) | (level <= DEEPEST_REGULAR)
        found[has] = is_shallow & (self.bounds.middle[places] * 0.25**level <= limit)
        return found

    def _places(self, faces: IndexArray) -> tuple[BoolArray, IndexArray]:
        places = self.places[faces]
        has = places >= 0
        return has, places[has]
