# SPDX-License-Identifier: GPL-3.0-or-later
"""The bounds by feet of a mesh's faces: of whole faces for all levels at once, and of parts where these do not decide.

Regular faces without feet, as at borders, have bounds at equal parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, index_chunks
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.bicubic import SPLINE_HALVES, both_ways
from ..surface.patches import PatchKind, classify_patches, regular_nets
from .foot_bounds import LARGEST_TILT, FootBounds, equal_bounds, foot_bounds

# How often nets are halved both ways. What feet leave open of a part shrinks by about half each time.
NET_SPLITS = 3


@dataclass(frozen=True)
class FoundByFeet:
    """Some faces at a level. bounds: (n,), infinite where none is proved; lasting: (n,) bool, whether one within the
    limit is proved with ways no longer than a leaf: these ask for nothing of other faces but the leaves that touch
    theirs; is_open: (n,) bool, where feet prove nothing, and something else may be within the limit."""

    faces: IndexArray
    bounds: FloatArray
    lasting: BoolArray
    is_open: BoolArray


@dataclass(frozen=True)
class FaceFeet:
    """The bounds by feet of a mesh's faces. places: (F,) intp, of each face among the bounds, -1 where it has none.
    curvature, speed: of the faces with bounds, κ and α of all faces that touch them. equal: of the same faces, bounds
    at equal parameters times 4ʲ where there are no feet, infinite elsewhere. is_turned: of the same faces, whether they
    are drawn with the diagonal from corner 1 to 3."""

    mesh: PolygonMesh
    vertices: Vertices
    places: IndexArray
    whole: FootBounds
    curvature: FloatArray
    speed: FloatArray
    equal: FloatArray
    is_turned: BoolArray

    @staticmethod
    def of(mesh: PolygonMesh, vertices: Vertices, is_turned: BoolArray, tick: Callable[[], None]) -> FaceFeet:
        """is_turned: (K,) bool, of the mesh's first K faces, all faces around which are there: whether they are drawn
        with the diagonal from corner 1 to 3."""
        patches = classify_patches(mesh)
        is_regular = patches.kinds == PatchKind.REGULAR
        is_regular[len(is_turned) :] = False
        regular = np.flatnonzero(is_regular)

        def bound(some: IndexArray) -> FootBounds:
            return _as_drawn(regular_nets(mesh, some), vertices, is_turned[some])

        parts = list(map_in_threads(bound, index_chunks(regular, AT_ONCE), tick))
        names = [field.name for field in fields(FootBounds)]
        whole = FootBounds(*(np.concatenate([np.zeros(0), *(vars(part)[name] for part in parts)]) for name in names))
        places = np.full(mesh.face_count, -1)
        places[regular] = np.arange(len(regular))
        at_vertices = np.zeros((2, mesh.vertex_count))
        corners = mesh.corner_vertices[mesh.face_starts[regular][:, None] + np.arange(4)]
        for own, values in zip(at_vertices, (whole.curvature, whole.speed), strict=True):
            for corner in range(4):
                np.maximum.at(own, corners[:, corner], values)
        # Feet stay where the surface is smooth, on faces whose curvature is known.
        unknown = np.zeros(mesh.vertex_count, dtype=bool)
        unknown[mesh.corner_vertices[~is_regular[mesh.corner_faces]]] = True
        at_vertices[:, unknown] = np.inf
        curvature, speed = at_vertices[:, corners].max(axis=2)
        curvature[~patches.inside[regular]] = np.inf
        if vertices is Vertices.LIMIT:
            # Triangles that might face apart would be drawn along the other diagonal: in the space where that is
            # chosen, normals are farther apart by the condition of its axes at most.
            condition = 1.0 if mesh.axes is None else float(np.linalg.cond(mesh.axes))
            curvature[~(whole.tilt <= LARGEST_TILT / condition)] = np.inf
        equal = np.full(len(regular), np.inf)
        for rest in index_chunks(np.flatnonzero(np.isinf(curvature)), AT_ONCE):
            equal[rest] = equal_bounds(regular_nets(mesh, regular[rest]), vertices)
            tick()
        return FaceFeet(mesh, vertices, places, whole, curvature, speed, equal, is_turned[regular])

    def bounds(
        self, faces: IndexArray, level: int, shown: Vertices, limit: float, tick: Callable[[], None]
    ) -> Iterator[FoundByFeet]:
        """Of some faces at a level, in chunks. shown: where vertices are, ``vertices`` or control points. limit: no
        larger distance is of use."""
        places = self.places[faces]
        others = faces[places < 0]
        count = len(others)
        yield FoundByFeet(others, np.full(count, np.inf), np.zeros(count, dtype=bool), np.ones(count, dtype=bool))
        faces, places = faces[places >= 0], places[places >= 0]
        size = 0.5**level
        found, along_leaves = np.full((2, len(faces)), np.inf)
        if shown is self.vertices:
            own = FootBounds(*(column[places] for column in vars(self.whole).values()))
            equal = self.equal[places] * size**2
            found, along_leaves = (
                np.minimum(own.at(level, self.curvature[places], self.speed[places], longest), equal)
                for longest in (1.0, size)
            )
        middle = self.whole.middle if shown is self.vertices else self.whole.control_middle
        may_be_within = (along_leaves > limit) & (middle[places] * size**2 <= limit)
        has_feet = np.isfinite(self.curvature[places])
        is_divided = may_be_within & has_feet & ((level > 0) | (shown is not self.vertices))
        is_open = may_be_within & (found > limit)
        done = ~is_divided
        yield FoundByFeet(faces[done], found[done], along_leaves[done] <= limit, is_open[done])

        def divided(some: IndexArray) -> FoundByFeet:
            return self._divided(some, level, shown, limit)

        yield from map_in_threads(divided, index_chunks(faces[is_divided], FEW_AT_ONCE), tick)

    def _divided(self, faces: IndexArray, level: int, shown: Vertices, limit: float) -> FoundByFeet:
        """The same, part by part, until all parts of each face are within the limit or one can't be."""
        places = self.places[faces]
        nets, which = regular_nets(self.mesh, faces), np.arange(len(faces))
        found, along_leaves = np.zeros((2, len(faces)))
        is_beyond = np.zeros(len(faces), dtype=bool)
        last = min(level, NET_SPLITS)
        for split in range(last + 1):
            own = _as_drawn(nets, shown, self.is_turned[places[which]])
            state = level - split, self.curvature[places[which]], self.speed[places[which]]
            bounds, on_leaves = own.at(*state, 1.0), own.at(*state, 0.5**level)
            is_beyond[which[own.middle * 0.25 ** (level - split) > limit]] = True
            is_left = (on_leaves > limit) & ~is_beyond[which] & (split < last)
            np.maximum.at(found, which[~is_left], bounds[~is_left])
            np.maximum.at(along_leaves, which[~is_left], on_leaves[~is_left])
            nets, which = both_ways(SPLINE_HALVES, nets[:, :, is_left]), np.tile(which[is_left], 4)
        found[is_beyond] = along_leaves[is_beyond] = np.inf
        is_open = (found > limit) & ~is_beyond
        return FoundByFeet(faces, found, along_leaves <= limit, is_open)


def _as_drawn(nets: FloatArray, vertices: Vertices, is_turned: BoolArray) -> FootBounds:
    """Of nets (4, 4, P, 3) of regular faces. is_turned: (P,) bool, as of ``foot_bounds``."""
    first = foot_bounds(nets, vertices, is_turned)
    if vertices is Vertices.LIMIT:
        return first
    # Of control points nothing tells which diagonal is drawn.
    second = foot_bounds(nets, vertices, ~is_turned)
    return replace(first, **{name: np.maximum(vars(first)[name], vars(second)[name]) for name in ("second", "plain")})
