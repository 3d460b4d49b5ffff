# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth by distance: of the sets themselves, whatever the parameters. docs/distance.md.

Regular faces among regular ones have bounds for all levels by feet on the surface (``foot_bounds``). Where these do not
decide, and around everything else, the leaves of a level are looked at one by one (``leaf_distances``): level by level,
until all of a face's leaves are within the tolerance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..distance.face_feet import FaceFeet
from ..distance.level_leaves import DEEPEST_REGULAR, LevelLeaves
from ..mesh.polygon_mesh import PolygonMesh
from .disproved_levels import DisprovedLevels
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Leaves looked at together, about, with those around them.
LEAVES_AT_ONCE = 1 << 15

# Regular faces whose bounds are beyond the tolerance are looked at leaf by leaf only where these are no more leaves
# than so together: on a large mesh a few faces in a hundred would get one level less, after minutes.
MOST_LEAVES = 1 << 16

# Faces cut out of the mesh together.
MOST_FACES_AT_ONCE = 1 << 11


def distance_depths(
    mesh: PolygonMesh, test: ToleranceTest, vertices: Vertices, faces: IndexArray, tick: Callable[[], None]
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop.

    At level 0 no modifier moves anything, so there vertices are control points; other polygons than quads have depth 1
    at least.
    """
    feet = FaceFeet.of(mesh, vertices, np.zeros(mesh.face_count, dtype=bool), tick)
    limit = test.tolerance - test.allowance
    is_quad = mesh.face_sizes == 4
    disproved = DisprovedLevels.of(mesh, vertices, test, tick)
    left = faces
    level = 0
    while len(left):
        shown = vertices if level else Vertices.CONTROL
        bounds = np.full(mesh.face_count, np.inf)
        lasting, is_open = np.zeros((2, mesh.face_count), dtype=bool)
        for found in feet.bounds(left, level, shown, limit, tick):
            bounds[found.faces], lasting[found.faces], is_open[found.faces] = found.bounds, found.lasting, found.is_open
        is_open &= (is_quad | (level > 0)) & ((feet.places < 0) | (level <= DEEPEST_REGULAR))
        has_bound = is_open & np.isfinite(bounds)
        if np.count_nonzero(has_bound) > MOST_LEAVES >> 2 * level:
            is_open[has_bound] = False
        open_faces = left[is_open[left]]
        for by_leaves in _by_leaves(mesh, open_faces, level, shown, limit, tick, joined=False):
            bounds[by_leaves.faces] = by_leaves.bounds
        settled = left[bounds[left] <= limit]
        block = _settled(settled, level, bounds, lasting, test.allowance)
        block.exact[:] = disproved.all_before(level, settled, tick)
        yield block
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
    feet = FaceFeet.of(mesh, vertices, np.zeros(mesh.face_count, dtype=bool), tick)
    parts = [np.zeros(0, dtype=np.intp)]
    for found in feet.bounds(faces, level, shown, limit, tick):
        yield LevelBounds(found.faces[found.lasting], found.bounds[found.lasting] + test.allowance)
        parts.append(found.faces[~found.lasting])
    rest = np.concatenate(parts)
    if level == 0:
        others = mesh.face_sizes[rest] != 4
        yield LevelBounds(rest[others], np.full(np.count_nonzero(others), np.inf))
        rest = rest[~others]
    for block in _by_leaves(mesh, rest, level, shown, limit, tick, joined=True):
        yield LevelBounds(block.faces, np.where(block.bounds <= limit, block.bounds + test.allowance, np.inf))


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
