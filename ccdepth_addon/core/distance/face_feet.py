# SPDX-License-Identifier: GPL-3.0-or-later
"""The bounds by feet of a mesh's faces: of whole faces for all levels at once, and of parts if these do not decide.

Regular faces without feet, as at borders, have bounds at equal parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, index_chunks
from ..arrays.masks import mask
from ..arrays.tables import Table
from ..arrays.threads import map_in_threads
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..mesh.level_quads import may_be_folded
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.bicubic import NET_CORNERS, SPLINE_HALVES
from ..surface.parts import Parts
from ..surface.patches import PatchKind, classify_patches, extraordinary_nets, regular_nets
from ..surface.stencils import by_valence, regular_children
from .foot_bounds import LARGEST_TILT, ROUNDING, FootBounds, Frame, equal_bounds, foot_bounds
from .leaf_feet import leaf_feet
from .middle_distances import likely_at_parts

# The number of times nets are halved both ways before parts without feet, or too far from equal parameters, are given
# up. Each time the undecided rest of a part shrinks by about half.
NET_SPLITS = 3


@dataclass(frozen=True)
class FoundByFeet(Table):
    """Some faces at a level. bounds: (n,), infinite without a proof; are_short: (n,) bool, whether a bound within the
    limit is proved with ways no longer than a leaf, and so depends only on the leaves that touch the face's own;
    lasting: (n,) bool, whether such a bound holds at every later level, too; is_open: (n,) bool, whether feet prove
    nothing, but another bound may be within the limit."""

    faces: IndexArray
    bounds: FloatArray
    are_short: BoolArray
    lasting: BoolArray
    is_open: BoolArray


@dataclass(frozen=True)
class FaceFeet:
    """The bounds by feet of a mesh's faces. places: (F,) intp, of each face among the bounds, -1 where it has none.
    whole: of the faces with bounds, with κ and α of all faces that touch them. equal: of the same faces, bounds at
    equal parameters times 4ʲ where there are no feet, infinite elsewhere. is_turned: of the same faces, whether they
    are drawn with the diagonal from corner 1 to 3."""

    mesh: PolygonMesh
    vertices: Vertices
    places: IndexArray
    whole: FootBounds
    equal: FloatArray
    is_turned: BoolArray

    @staticmethod
    def of(
        mesh: PolygonMesh,
        vertices: Vertices,
        is_turned: BoolArray,
        tick: Callable[[], None],
        is_near: BoolArray | None = None,
    ) -> FaceFeet:
        """is_turned: (K,) bool, of the mesh's first K faces, all faces around which are there: whether they are drawn
        with the diagonal from corner 1 to 3. is_near: (K,) bool, the faces with bounds and all faces that touch these;
        all of the K faces if there is none."""
        patches = classify_patches(mesh)
        is_regular = patches.kinds == PatchKind.REGULAR
        is_regular[len(is_turned) :] = False
        if is_near is not None:
            is_regular[: len(is_near)] &= is_near
        regular = np.flatnonzero(is_regular)

        def bound(some: IndexArray) -> FootBounds:
            return foot_bounds(_nets(mesh, some), vertices, is_turned[some])

        parts = list(map_in_threads(bound, index_chunks(regular, FEW_AT_ONCE), tick))
        whole = FootBounds(*np.zeros((8, 0))).joined(parts)
        places = np.full(mesh.face_count, -1)
        places[regular] = np.arange(len(regular))
        at_vertices = np.zeros((2, mesh.vertex_count))
        corners = mesh.corner_vertices[mesh.face_starts[regular][:, None] + np.arange(4)]
        for own, values in zip(at_vertices, (whole.curvature, whole.speed), strict=True):
            for corner in range(4):
                np.maximum.at(own, corners[:, corner], values)
        is_known, is_beside = is_regular.copy(), np.zeros(mesh.vertex_count, dtype=bool)
        for valence, faces, extraordinary in by_valence(mesh, np.arange(len(is_turned)), patches)[1]:
            is_known[faces] = True
            found = _of_children(mesh, extraordinary, valence)
            for at, *constants in zip(*found, strict=True):
                is_beside[at] = True
                for own, values in zip(at_vertices, constants, strict=True):
                    np.maximum.at(own, at, values)
        # Feet stay on faces with known curvature, where the surface is smooth.
        unknown = mask(mesh.vertex_count, mesh.corner_vertices[~is_known[mesh.corner_faces]])
        at_vertices[:, unknown] = np.inf
        curvature, speed = at_vertices[:, corners].max(axis=2)
        # Beside an extraordinary face, feet stay on the regular children there: they may go half as far.
        speed[is_beside[corners].any(axis=1)] *= 2
        curvature[~patches.inside[regular]] = np.inf
        if vertices is Vertices.LIMIT:
            # Triangles that might face apart would be drawn along the other diagonal; in the space of that choice,
            # normals are farther apart by the condition of its axes at most.
            condition = 1.0 if mesh.axes is None else float(np.linalg.cond(mesh.axes))
            curvature[~(whole.tilt <= LARGEST_TILT / condition)] = np.inf
        equal = np.full(len(regular), np.inf)
        for rest in index_chunks(np.flatnonzero(np.isinf(curvature)), FEW_AT_ONCE):
            equal[rest] = equal_bounds(_nets(mesh, regular[rest]), vertices)
            tick()
        whole = replace(whole, curvature=curvature, speed=speed)
        return FaceFeet(mesh, vertices, places, whole, equal, is_turned[regular])

    def bounds(
        self,
        faces: IndexArray,
        level: int,
        shown: Vertices,
        limit: float,
        tick: Callable[[], None],
        *,
        are_divided: bool = True,
    ) -> Iterator[FoundByFeet]:
        """The bounds of some faces at a level, in chunks. shown: the kind of vertices, ``vertices`` or control points.
        limit: the largest useful distance. are_divided: whether parts have bounds of their own."""
        others = faces[self.places[faces] < 0]
        never = np.zeros(len(others), dtype=bool)
        yield FoundByFeet(others, np.full(len(others), np.inf), never, never, ~never)
        rest = []
        for some in index_chunks(faces[self.places[faces] >= 0], AT_ONCE):
            is_divided, found = self._of_whole_faces(some, level, shown, limit, are_divided=are_divided)
            rest.append(some[is_divided])
            yield found

        def divided(some: IndexArray) -> FoundByFeet:
            return self._divided(some, level, shown, limit)

        yield from map_in_threads(divided, index_chunks(np.concatenate([faces[:0], *rest]), FEW_AT_ONCE), tick)

    def _of_whole_faces(
        self, faces: IndexArray, level: int, shown: Vertices, limit: float, *, are_divided: bool
    ) -> tuple[BoolArray, FoundByFeet]:
        """(n,) bool, whether parts of each of these regular faces may be within the limit; and the bounds of the other
        faces."""
        places, size = self.places[faces], 0.5**level
        found, on_leaves = np.full((2, len(faces)), np.inf)
        if shown is self.vertices:
            own = self.whole.at(places)
            equal = self.equal[places] * size**2
            found, on_leaves = (
                np.minimum(own.at_level(level, own.curvature, own.speed, longest), equal) for longest in (1.0, size)
            )
        middle = self.whole.middle if shown is self.vertices else self.whole.control_middle
        may_be_within = (on_leaves > limit) & (middle[places] * size**2 <= limit)
        is_divided = may_be_within & np.isfinite(self.whole.curvature[places]) & are_divided
        are_short = on_leaves <= limit
        is_open = may_be_within & (found > limit)
        return is_divided, FoundByFeet(faces, found, are_short, are_short, is_open).at(~is_divided)

    def likely(self, faces: IndexArray, level: int, shown: Vertices) -> FloatArray:
        """(n,): estimates of the distances of regular faces at a level, zero at level 0. Estimates prove nothing."""
        if level == 0:
            return np.zeros(len(faces))
        turned = self.is_turned[self.places[faces]]
        parts = (
            likely_at_parts(_nets(self.mesh, faces[some]), level, shown, turned[some])
            for some in index_chunks(np.arange(len(faces)), FEW_AT_ONCE)
        )
        return np.concatenate([np.zeros(0), *parts])

    def _divided(self, faces: IndexArray, level: int, shown: Vertices, limit: float) -> FoundByFeet:
        """The bounds of faces, part by part down to the leaves, until all parts of each face are within the limit or
        one can't be."""
        places, found = self.places[faces], _DividedFaces.none(len(faces), limit)
        parts, first = Parts(np.arange(len(faces)), _nets(self.mesh, faces)), 0
        if shown is self.vertices and level:
            # Whole faces have bounds already.
            found.is_beyond[:] = likely_at_parts(parts.values, level, shown, self.is_turned[places]) > limit
            parts, first = parts.at(~found.is_beyond).quarters(SPLINE_HALVES), 1
        for split in range(first, level + 1):
            if len(parts.faces):
                parts = self._undecided(found, parts, places, level, split, shown)
            if split < level:
                parts = parts.quarters(SPLINE_HALVES)
        lasting = ~mask(len(faces), parts.faces)
        for some in index_chunks(np.arange(len(parts.faces)), FEW_AT_ONCE):
            leaves = parts.at(some[~found.is_beyond[parts.faces[some]]])
            if len(leaves.faces):
                bounds, short, reached = self._of_leaves(leaves.values, places[leaves.faces], level, shown)
                found.is_beyond[leaves.faces[reached > limit]] = True
                found.include(leaves.faces, bounds, short)
        return found.by_feet(faces, lasting)

    def _undecided(
        self, found: _DividedFaces, parts: Parts, places: IndexArray, level: int, split: int, shown: Vertices
    ) -> Parts:
        """Bound parts of faces with bounds at these places, quartered as often as ``split``. Returns the parts that
        smaller parts may bring within the limit."""
        own_places, later = places[parts.faces], 0.25 ** (level - split)
        constants = self.whole.curvature[own_places], self.whole.speed[own_places]
        own = foot_bounds(parts.values, shown, self.is_turned[own_places])
        bounds, short = own.at_level(level - split, *constants), own.at_level(level - split, *constants, 0.5**level)
        found.is_beyond[parts.faces[own.middle * later > found.limit]] = True
        is_left = short > found.limit
        if split >= NET_SPLITS:
            # The error along the surface does not shrink.
            is_left &= np.isfinite(short) & (constants[0] * (own.reach * later) ** 2 < found.limit)
            bounds = np.where(bounds > found.limit, np.inf, bounds)
        found.include(parts.faces[~is_left], bounds[~is_left], short[~is_left])
        return parts.at(is_left & found.are_open[parts.faces])

    def _of_leaves(
        self, nets: FloatArray, places: IndexArray, level: int, shown: Vertices
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The bounds, as of ``leaf_feet``, of leaves (16, 3, P) at a level, in faces with bounds at these places
        (P,)."""
        is_turned = self.is_turned[places]
        curvature, speed, size = self.whole.curvature[places], self.whole.speed[places], 0.5**level
        found = leaf_feet(_turned(nets, is_turned), shown, curvature, speed, size)
        if shown is Vertices.CONTROL:
            corners = np.moveaxis(nets[NET_CORNERS], 2, 0)
            folded = np.flatnonzero(may_be_folded(corners, is_turned, self.mesh.axes))
            if len(folded):
                mirrored = _turned(nets[:, :, folded], ~is_turned[folded])
                others = leaf_feet(mirrored, shown, curvature[folded], speed[folded], size)
                for own, other in zip(found, others, strict=True):
                    own[folded] = np.maximum(own[folded], other)
        return found


@dataclass(frozen=True)
class _DividedFaces:
    """Faces (n,) whose parts are bounded, with a limit: the bounds of parts so far, with feet anywhere, and on leaves
    alone; and (n,) bool, the faces with a part estimated beyond the limit."""

    limit: float
    bounds: FloatArray
    on_leaves: FloatArray
    is_beyond: BoolArray

    @staticmethod
    def none(count: int, limit: float) -> _DividedFaces:
        """No part yet."""
        return _DividedFaces(limit, np.zeros(count), np.zeros(count), np.zeros(count, dtype=bool))

    @property
    def are_open(self) -> BoolArray:
        """(n,) bool: whether all parts so far may be within the limit."""
        return ~self.is_beyond & np.isfinite(self.bounds)

    def include(self, which: IndexArray, bounds: FloatArray, on_leaves: FloatArray) -> None:
        """Raise the bounds of faces to those of parts (P,)."""
        np.maximum.at(self.bounds, which, bounds)
        np.maximum.at(self.on_leaves, which, on_leaves)

    def by_feet(self, faces: IndexArray, lasting: BoolArray) -> FoundByFeet:
        """The bounds of the faces. lasting: (n,) bool, whether these hold at every later level, if they are short."""
        bounds, on_leaves = (np.where(self.is_beyond, np.inf, each) for each in (self.bounds, self.on_leaves))
        are_short = on_leaves <= self.limit
        return FoundByFeet(faces, bounds, are_short, lasting & are_short, (bounds > self.limit) & ~self.is_beyond)


def _of_children(mesh: PolygonMesh, corners: IndexArray, valence: int) -> tuple[IndexArray, FloatArray, FloatArray]:
    """(3, P) each, for faces with their extraordinary vertex at given corners: their other vertices, and κ and α of
    their regular children there, α in parameters of the face."""
    children = regular_children(extraordinary_nets(mesh, corners, valence))
    frame = Frame.of(_by_component(children))
    constants = frame.curvature, np.maximum(*frame.speeds) / 2
    curvature, speed = (np.where(frame.is_known, each * (1 + ROUNDING), np.inf).reshape(3, -1) for each in constants)
    first = mesh.face_starts[mesh.corner_faces[corners]]
    others = first + (corners - first + np.arange(1, 4)[:, None]) % 4
    return mesh.corner_vertices[others], curvature, speed


def _nets(mesh: PolygonMesh, faces: IndexArray) -> FloatArray:
    """(16, 3, P): the nets of regular faces, component by component."""
    return _by_component(regular_nets(mesh, faces))


def _by_component(nets: FloatArray) -> FloatArray:
    """(16, 3, P) from nets (4, 4, P, 3)."""
    return np.ascontiguousarray(nets.reshape(16, -1, 3).swapaxes(1, 2))


def _turned(nets: FloatArray, is_turned: BoolArray) -> FloatArray:
    """Nets (16, 3, P), mirrored where turned (P,), so that corners 1 and 3 become 0 and 2."""
    return np.where(is_turned, nets.reshape(4, 4, *nets.shape[1:])[::-1].reshape(nets.shape), nets)
