# SPDX-License-Identifier: GPL-3.0-or-later
"""Depth from the norms of control nets: bounds for every level from one norm (``norm_bounds``).

A face whose patch is regular or extraordinary takes its depth from its bounds. An irregular one is refined, with its
neighbours, until what is left of it has a bound: its bound at level k is the largest of its level-k descendants'.
Patches take over as soon as a descendant has one; the first-order bound of the support holds for the rest from the
second level on, when n-gons, triangles and faces with several extraordinary corners have become patches.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..arrays.chunks import split
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Method, PatchBounds, PatchMethod, Vertices, support_bounds
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from ..surface.refinement import Refinement
from .tolerance_test import FaceBlock, LevelBlock, Question

# Faces handled at a time: few enough for the caches and a responsive interface, enough to hide the interpreter.
REGULAR_FACES_AT_ONCE = 1 << 14
EXTRAORDINARY_POINTS_AT_ONCE = 1 << 18
IRREGULAR_FACES_AT_ONCE = 1 << 11

FIRST_SUPPORT_LEVEL = 2

Block = TypeVar("Block", FaceBlock, LevelBlock)


def norm_blocks(mesh: PolygonMesh, question: Question, method: PatchMethod, vertices: Vertices) -> Iterator[FaceBlock]:
    """Every face of the mesh with its depth, in blocks; some are empty, to let the caller breathe."""
    search = _Search(question, method, vertices)
    patches = classify_patches(mesh)
    yield FaceBlock.empty()
    for faces, bounds in search.patch_bounds(mesh, patches, np.arange(mesh.face_count)):
        yield search.first_levels(faces, bounds)
    irregular = np.flatnonzero(patches.kinds == PatchKind.IRREGULAR)
    for faces in split(irregular, IRREGULAR_FACES_AT_ONCE):
        yield from search.irregular_block(mesh, faces)


def norm_bounds(
    mesh: PolygonMesh, question: Question, method: PatchMethod, vertices: Vertices, faces: IndexArray, level: int
) -> Iterator[LevelBlock]:
    """Some faces with what is proved of them at one level, in blocks; some are empty, to let the caller breathe."""
    search = _Search(question, method, vertices)
    patches = classify_patches(mesh)
    yield LevelBlock.empty()
    for some, bounds in search.patch_bounds(mesh, patches, faces):
        yield search.proved(some, bounds.at(level))
    irregular = faces[patches.kinds[faces] == PatchKind.IRREGULAR]
    for some in split(irregular, IRREGULAR_FACES_AT_ONCE):
        yield from search.irregular_at(mesh, some, level)


def bounds_fall(mesh: PolygonMesh, method: Method) -> BoolArray:
    """(F,) bool: the faces that are within a tolerance at every level after one at which they are proved to be.

    Patches whose bound falls by one rate with each level. The sharp factors rise a little where their period begins
    anew, and irregular faces have other bounds at other levels. No certified distance is known to fall.
    """
    kinds = classify_patches(mesh).kinds
    if method is Method.CERTIFIED:
        return np.zeros(len(kinds), dtype=bool)
    one_rate = kinds == PatchKind.REGULAR
    if method is not Method.SHARP:
        one_rate |= kinds == PatchKind.EXTRAORDINARY
    return one_rate


@dataclass(frozen=True)
class _Piece:
    """Descendants of one kind that appear at one level: the base face of each (an index), and their bounds."""

    level: int
    bases: IndexArray
    bounds: PatchBounds

    def of(self, wanted: BoolArray) -> _Piece:
        """The part of it whose base faces are wanted: (base faces,) bool."""
        kept = wanted[self.bases]
        return _Piece(self.level, self.bases[kept], self.bounds.of(kept))


@dataclass(frozen=True)
class _Search:
    """How far each face has to be subdivided: one question, put to meshes and their refinements."""

    question: Question
    method: PatchMethod
    vertices: Vertices

    def patch_bounds(
        self, mesh: PolygonMesh, patches: PatchKinds, faces: IndexArray
    ) -> Iterator[tuple[IndexArray, PatchBounds]]:
        """The bounds of the regular and the extraordinary among the faces, a block of one kind at a time."""
        kinds = patches.kinds[faces]
        for regular in split(faces[kinds == PatchKind.REGULAR], REGULAR_FACES_AT_ONCE):
            yield regular, self.method.regular(regular_nets(mesh, regular), self.vertices)
        extraordinary = faces[kinds == PatchKind.EXTRAORDINARY]
        valences = mesh.vertex_face_counts[mesh.corner_vertices[patches.extraordinary_corners[extraordinary]]]
        for valence in np.unique(valences).tolist():
            at_once = max(1, EXTRAORDINARY_POINTS_AT_ONCE // (2 * valence + 8))
            for block in split(extraordinary[valences == valence], at_once):
                nets = extraordinary_nets(mesh, patches.extraordinary_corners[block], valence)
                yield block, self.method.extraordinary(nets, self.vertices)

    def first_levels(self, faces: IndexArray, bounds: PatchBounds) -> FaceBlock:
        """The first level of each patch whose bound is within the tolerance."""
        block = FaceBlock.undecided(faces)
        level = 0
        while np.any(block.depths < 0):
            reached = bounds.at(level)
            block.settle((block.depths < 0) & self.question.within(reached), level, reached + self.question.allowance)
            level += 1
        return block

    def irregular_block(self, mesh: PolygonMesh, faces: IndexArray) -> Iterator[FaceBlock]:
        """The depth of irregular faces: all are refined in step with the level asked about."""
        block = FaceBlock.undecided(faces)
        pieces: list[_Piece] = []
        refinement = Refinement.start(mesh, faces)
        level = 0
        while np.any(block.depths < 0):
            found, refinement = yield from self._take_patches(refinement, level, FaceBlock.empty())
            pieces += found
            reached = self._bounds_at(level, pieces, refinement, len(faces))
            block.settle((block.depths < 0) & self.question.within(reached), level, reached + self.question.allowance)
            pieces = [piece.of(block.depths < 0) for piece in pieces]
            refinement = refinement.of(block.depths < 0).refined()
            level += 1
            yield FaceBlock.empty()
        yield block

    def irregular_at(self, mesh: PolygonMesh, faces: IndexArray, level: int) -> Iterator[LevelBlock]:
        """Irregular faces at one level; what their support alone proves to be near enough is refined no further."""
        reached = np.zeros(len(faces))
        refinement = Refinement.start(mesh, faces)
        for own in range(level):
            found, refinement = yield from self._take_patches(refinement, own, LevelBlock.empty())
            np.maximum(reached, self._bounds_of(found, level, len(faces)), out=reached)
            if own >= FIRST_SUPPORT_LEVEL and len(refinement.bases):
                bounds = support_bounds(refinement.mesh, Vertices.LIMIT)[: len(refinement.bases)]
                within = self.question.within(bounds)
                np.maximum.at(reached, refinement.bases[within], bounds[within])
                refinement = refinement.keep(~within)
            refinement = refinement.refined()
            yield LevelBlock.empty()
        found, refinement = yield from self._take_patches(refinement, level, LevelBlock.empty())
        np.maximum(reached, self._bounds_at(level, found, refinement, len(faces)), out=reached)
        yield self.proved(faces, reached)

    def proved(self, faces: IndexArray, bounds: FloatArray) -> LevelBlock:
        """(P,) faces with their bounds at one level, before rounding is allowed for."""
        return LevelBlock(faces, np.where(self.question.within(bounds), bounds + self.question.allowance, np.inf))

    def _take_patches(
        self, refinement: Refinement, level: int, empty: Block
    ) -> Generator[Block, None, tuple[list[_Piece], Refinement]]:
        """The refinement's patches as pieces, and the refinement with its irregular descendants alone.

        Yields an empty block now and then: the nets around a pole are as many as they are large.
        """
        if not len(refinement.bases):
            return [], refinement
        patches = classify_patches(refinement.mesh)
        core = np.arange(len(refinement.bases))
        pieces = []
        for block, bounds in self.patch_bounds(refinement.mesh, patches, core):
            pieces.append(_Piece(level, refinement.bases[block], bounds))
            yield empty
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
            np.maximum.at(reached, piece.bases, piece.bounds.at(level - piece.level))
        return reached
