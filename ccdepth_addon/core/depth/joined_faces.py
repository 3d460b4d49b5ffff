# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces of several poses of a mesh, evaluated together in units of the tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Method
from ..mesh.copies import side_by_side
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from ..surface.patches import PatchKind, regular_nets_in_poses
from .certified_depth import FacesToSearch, certified_bounds_at, certified_depths, certified_level_bounds
from .face_depths import depths_in_chunks, level_bounds_in_chunks
from .poses import PreparedMesh, ScaledPose, vertices_of
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Faces of all poses evaluated together.
FACES_TOGETHER = 1 << 16


def poses_together(face_count: int) -> int:
    """How many poses with so many faces each are evaluated together."""
    return max(1, FACES_TOGETHER // max(face_count, 1))


def are_enough(faces: Sequence[IndexArray]) -> bool:
    """Whether faces of several poses are so many that no more are evaluated with them."""
    return sum(map(len, faces)) > FACES_TOGETHER


def in_groups(items: Sequence[int], size: int) -> Iterator[list[int]]:
    """The items in order, at most so many at a time."""
    return (list(items[start : start + size]) for start in range(0, len(items), size))


@dataclass(frozen=True)
class JoinedFaces:
    """Faces of several poses, in units of the tolerance.

    prepared: of all poses. scaled: each pose. poses, bases: (P,) intp, the pose (its place among these, rising) and the
    face of each.
    """

    prepared: PreparedMesh
    scaled: Sequence[ScaledPose]
    poses: IndexArray
    bases: IndexArray

    @staticmethod
    def of(prepared: PreparedMesh, scaled: Sequence[ScaledPose], wanted: Sequence[IndexArray]) -> JoinedFaces:
        """wanted: of each pose the faces to evaluate, rising."""
        poses = np.repeat(np.arange(len(scaled)), [len(faces) for faces in wanted])
        return JoinedFaces(prepared, scaled, poses, np.concatenate(wanted))

    @property
    def tolerances(self) -> FloatArray:
        """(P,): of the pose of each."""
        return np.array([each.tolerance for each in self.scaled])[self.poses]

    @property
    def test(self) -> ToleranceTest:
        return ToleranceTest(1.0, max(each.allowance for each in self.scaled))

    def at(self, chosen: IndexArray) -> JoinedFaces:
        """Some of the faces, by index, rising."""
        return replace(self, poses=self.poses[chosen], bases=self.bases[chosen])

    def as_mesh(self) -> tuple[PolygonMesh, IndexArray]:
        """One mesh that has these faces, and their numbers (P,) there."""
        whole, union = self.prepared.mesh, np.unique(self.bases)
        if len(union) == whole.face_count:
            part, vertices = whole, np.arange(whole.vertex_count)
        else:
            part, kept = submesh(whole, union)
            vertices = vertices_of(whole, part, kept)
        places, copies = np.unique(self.poses, return_inverse=True)
        positions = np.concatenate([self.scaled[place].mesh.positions[vertices] for place in places.tolist()])
        mesh = side_by_side(part, len(places)).changed(positions=positions)
        return mesh, np.searchsorted(union, self.bases) + copies * part.face_count

    def to_search(self) -> FacesToSearch:
        """The faces as ``certified_depth`` wants them, named by their index."""
        is_regular = self.prepared.kinds.kinds[self.bases] == PatchKind.REGULAR
        others = np.flatnonzero(~is_regular)
        mesh, faces = self.at(others).as_mesh() if len(others) else (self.prepared.mesh, others)
        return FacesToSearch(
            np.arange(len(self.bases)), np.flatnonzero(is_regular), self._regular_nets, others, mesh, faces
        )

    def _regular_nets(self, chosen: IndexArray) -> FloatArray:
        """(4, 4, chosen, 3): the nets of some of the faces, all regular, by index."""
        places, counts = np.unique(self.poses[chosen], return_counts=True)
        positions = [self.scaled[place].mesh.positions for place in places.tolist()]
        return regular_nets_in_poses(self.prepared.mesh, positions, self.bases[chosen], counts)


def searched(joined: JoinedFaces, tick: Callable[[], None]) -> tuple[NDArray[np.int32], FloatArray, BoolArray]:
    """(P,) each: depths, bounds in units of the tolerance, and exactness of joined faces."""
    method, vertices = joined.prepared.method, joined.prepared.vertices
    found = FaceDepths.undecided(np.arange(len(joined.bases)))
    if method is Method.CERTIFIED:
        for part in certified_depths(joined.to_search(), joined.test, vertices, tick):
            found.update(part)
            tick()
    else:
        mesh, faces = joined.as_mesh()
        places = np.zeros(mesh.face_count, dtype=np.intp)
        places[faces] = np.arange(len(faces))
        for part in depths_in_chunks(mesh, joined.test, method, vertices, faces, tick):
            found.update(replace(part, faces=places[part.faces]))
            tick()
    return found.depths, found.bounds, found.exact


def bounds_at_level(joined: JoinedFaces, level: int, tick: Callable[[], None]) -> Iterator[LevelBounds]:
    """The proved bounds of joined faces at one level, in chunks."""
    method, vertices = joined.prepared.method, joined.prepared.vertices
    if method is Method.CERTIFIED:
        return certified_level_bounds(joined.to_search(), joined.test, vertices, level, tick)
    mesh, faces = joined.as_mesh()
    return level_bounds_in_chunks(mesh, faces, joined.test, method, vertices, level, tick)


def bounds_at(joined: JoinedFaces, levels: NDArray[np.int32], tick: Callable[[], None]) -> FloatArray:
    """(P,): the bounds, in units of the tolerance, of joined faces at their own levels (P,); inf where they are not
    proved to be within it."""
    method, vertices = joined.prepared.method, joined.prepared.vertices
    if method is Method.CERTIFIED:
        bounds = np.full(len(levels), np.inf)
        for block in certified_bounds_at(joined.to_search(), joined.test, vertices, levels, tick):
            bounds[block.faces] = block.bounds
            tick()
        return bounds
    mesh, faces = joined.as_mesh()
    found = np.full(mesh.face_count, np.inf)
    for level in np.unique(levels).tolist():
        some = faces[levels == level]
        for block in level_bounds_in_chunks(mesh, some, joined.test, method, vertices, level, tick):
            found[block.faces] = block.bounds
            tick()
    return found[faces]
