# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth from the norms of control nets: bounds for every level from one norm (``norm_bounds``).

The depth of a face with a regular or an extraordinary patch follows from the bounds of that patch. An irregular face is
refined with its neighbours; its bound at level k is the largest of its level-k descendants'. Patches bound their
descendants; supports bound all others, from the second level on, when n-gons, triangles and faces with several
extraordinary corners have become patches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import AT_ONCE, FEW_AT_ONCE, index_chunks
from ..arrays.tables import Table
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import PatchBounds, PatchMethod, Vertices, support_bounds
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from ..surface.refinement import Refinement
from ..surface.stencils import by_valence
from .tolerance import FaceDepths, LevelBounds, ToleranceTest

# Points of extraordinary nets evaluated together.
EXTRAORDINARY_POINTS_AT_ONCE = 1 << 18

FIRST_SUPPORT_LEVEL = 2


def norm_depths(
    mesh: PolygonMesh,
    test: ToleranceTest,
    method: PatchMethod,
    vertices: Vertices,
    faces: IndexArray,
    tick: Callable[[], None],
) -> Iterator[FaceDepths]:
    """The depths of some faces, in chunks. tick: called meanwhile, and may raise to stop."""
    evaluation = _NormEvaluation(test, method, vertices, tick)
    patches = classify_patches(mesh)
    falling = bounds_fall(patches, method)
    for some, bounds in evaluation.patch_bounds(mesh, patches, faces):
        found = evaluation.first_levels(some, bounds)
        found.lasting[:] = falling[some]
        yield found
    irregular = faces[patches.kinds[faces] == PatchKind.IRREGULAR]
    for some in index_chunks(irregular, FEW_AT_ONCE):
        yield evaluation.irregular_depths(mesh, some)


def norm_level_bounds(
    mesh: PolygonMesh,
    test: ToleranceTest,
    method: PatchMethod,
    vertices: Vertices,
    faces: IndexArray,
    level: int,
    tick: Callable[[], None],
) -> Iterator[LevelBounds]:
    """The proved bounds of some faces at one level, in chunks. tick: called meanwhile, and may raise to stop."""
    evaluation = _NormEvaluation(test, method, vertices, tick)
    patches = classify_patches(mesh)
    for some, bounds in evaluation.patch_bounds(mesh, patches, faces):
        yield evaluation.proved(some, bounds.after(level))
    irregular = faces[patches.kinds[faces] == PatchKind.IRREGULAR]
    for some in index_chunks(irregular, FEW_AT_ONCE):
        yield evaluation.irregular_at(mesh, some, level)


def bounds_fall(patches: PatchKinds, method: PatchMethod) -> BoolArray:
    """(F,) bool: the faces with bounds that fall with every level, so that a proof at one level holds at all later
    levels. Irregular faces have other bounds at other levels.
    """
    return np.isin(patches.kinds, method.falling)


@dataclass(frozen=True)
class _Piece(Table):
    """Descendants of one kind that appear at one level: the base face of each (an index), and their bounds."""

    level: int
    bases: IndexArray
    bounds: PatchBounds


@dataclass(frozen=True)
class _NormEvaluation:
    """One method and tolerance test, applied to meshes and their refinements. tick: called after every chunk, as the
    nets around a pole are many and large."""

    test: ToleranceTest
    method: PatchMethod
    vertices: Vertices
    tick: Callable[[], None]

    def patch_bounds(
        self, mesh: PolygonMesh, patches: PatchKinds, faces: IndexArray
    ) -> Iterator[tuple[IndexArray, PatchBounds]]:
        """The bounds of the regular and the extraordinary among the faces, a chunk of one kind at a time."""
        regular, extraordinary, _ = by_valence(mesh, faces, patches, largest=mesh.face_count)
        for chunk in index_chunks(faces[regular], AT_ONCE):
            yield chunk, self.method.regular(regular_nets(mesh, chunk), self.vertices)
        for valence, _, corners in extraordinary:
            for chunk in index_chunks(corners, max(1, EXTRAORDINARY_POINTS_AT_ONCE // (2 * valence + 8))):
                nets = extraordinary_nets(mesh, chunk, valence)
                yield mesh.corner_faces[chunk], self.method.extraordinary(nets, self.vertices)

    def first_levels(self, faces: IndexArray, bounds: PatchBounds) -> FaceDepths:
        """The first level of each patch whose bound is within the tolerance."""
        result = FaceDepths.undecided(faces)
        level = 0
        while np.any(result.depths < 0):
            reached = bounds.after(level)
            result.settle((result.depths < 0) & self.test.within(reached), level, reached + self.test.allowance)
            level += 1
        return result

    def irregular_depths(self, mesh: PolygonMesh, faces: IndexArray) -> FaceDepths:
        """The depth of irregular faces, refined together level by level."""
        result = FaceDepths.undecided(faces)
        pieces: list[_Piece] = []
        refinement = Refinement.start(mesh, faces)
        level = 0
        while np.any(result.depths < 0):
            found, refinement = self._collect_patches(refinement, level)
            pieces += found
            reached = self._bounds_at(level, pieces, refinement, len(faces))
            result.settle((result.depths < 0) & self.test.within(reached), level, reached + self.test.allowance)
            pieces = [piece.at(result.depths[piece.bases] < 0) for piece in pieces]
            refinement = refinement.of(result.depths < 0).refined()
            level += 1
            self.tick()
        return result

    def irregular_at(self, mesh: PolygonMesh, faces: IndexArray, level: int) -> LevelBounds:
        """Irregular faces at one level; descendants that their support proves near enough are refined no further."""
        reached = np.zeros(len(faces))
        refinement = Refinement.start(mesh, faces)
        for own in range(level):
            found, refinement = self._collect_patches(refinement, own)
            np.maximum(reached, self._bounds_of(found, level, len(faces)), out=reached)
            if own >= FIRST_SUPPORT_LEVEL and len(refinement.bases):
                bounds = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                within = self.test.within(bounds)
                np.maximum.at(reached, refinement.bases[within], bounds[within])
                refinement = refinement.keep(~within)
            refinement = refinement.refined()
            self.tick()
        found, refinement = self._collect_patches(refinement, level)
        np.maximum(reached, self._bounds_at(level, found, refinement, len(faces)), out=reached)
        return self.proved(faces, reached)

    def proved(self, faces: IndexArray, bounds: FloatArray) -> LevelBounds:
        """The proved bounds of faces (P,) from bounds (P,) without the rounding allowance."""
        return LevelBounds(faces, np.where(self.test.within(bounds), bounds + self.test.allowance, np.inf))

    def _collect_patches(self, refinement: Refinement, level: int) -> tuple[list[_Piece], Refinement]:
        """The refinement's patches as pieces, and the refinement of the irregular descendants alone."""
        if not len(refinement.bases):
            return [], refinement
        patches = classify_patches(refinement.mesh)
        core = np.arange(len(refinement.bases))
        pieces = []
        for chunk, bounds in self.patch_bounds(refinement.mesh, patches, core):
            pieces.append(_Piece(level, refinement.bases[chunk], bounds))
            self.tick()
        return pieces, refinement.keep(patches.kinds[core] == PatchKind.IRREGULAR)

    def _bounds_at(self, level: int, pieces: list[_Piece], refinement: Refinement, face_count: int) -> FloatArray:
        """(base faces,) float64: the largest bound at a level of each one's pieces and irregular descendants."""
        reached = self._bounds_of(pieces, level, face_count)
        if level < FIRST_SUPPORT_LEVEL:
            reached[refinement.bases] = np.inf
        elif len(refinement.bases):
            found = support_bounds(refinement.mesh, self.vertices)[: len(refinement.bases)]
            np.maximum.at(reached, refinement.bases, found)
        return reached

    @staticmethod
    def _bounds_of(pieces: list[_Piece], level: int, face_count: int) -> FloatArray:
        """(base faces,) float64: the largest bound at a level of each one's pieces."""
        reached = np.zeros(face_count)
        for piece in pieces:
            np.maximum.at(reached, piece.bases, piece.bounds.after(level - piece.level))
        return reached
