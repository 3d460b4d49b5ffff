# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds → depth: the least level at which every face is proved to lie within the tolerance of the limit surface.

A face whose patch is regular or extraordinary takes its depth from its bounds. An irregular one is refined, with its
neighbours, until what is left of it has a bound: its bound at level k is the largest of its level-k descendants'.
Patches take over as soon as a descendant has one; the first-order bound of the support holds for the rest from the
second level on, when n-gons, triangles and faces with several extraordinary corners have become patches.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bounds import PATCH_METHODS, Method, PatchBounds, PatchMethod, Vertices, support_bounds
from .mesh import FloatArray, IndexArray, PolygonMesh, validate
from .patches import PatchKind, PatchKinds, classify_patches, extraordinary_nets, regular_nets
from .refinement import Refinement, split

# Faces handled at a time: few enough for the caches and a responsive interface, enough to hide the interpreter.
REGULAR_FACES_AT_ONCE = 1 << 14
EXTRAORDINARY_POINTS_AT_ONCE = 1 << 18
IRREGULAR_FACES_AT_ONCE = 1 << 11

FIRST_SUPPORT_LEVEL = 2

METHODS = tuple(method.value for method in Method)
VERTICES = tuple(vertices.value for vertices in Vertices)


class ToleranceError(ValueError):
    """The tolerance decides nothing on this mesh; the message says why in a modeller's words."""


@dataclass(frozen=True)
class DepthResult:
    """depths: (F,) int32; bounds: (F,) float64, the proved distance at that depth in the unit of the positions."""

    depths: NDArray[np.int32]
    bounds: FloatArray


def largest_coordinate(mesh: PolygonMesh) -> float:
    """The largest absolute coordinate of a vertex that has a face."""
    used = mesh.positions[mesh.vertex_face_counts > 0]
    return float(np.abs(used).max(initial=0.0))


def smallest_tolerance(mesh: PolygonMesh) -> float:
    """The least tolerance that means anything: four steps of single precision at the largest coordinate."""
    return 2.0**-22 * largest_coordinate(mesh)


def rounding_allowance(mesh: PolygonMesh) -> float:
    """What double-precision rounding can hide from a bound, in the unit of the positions.

    A sum of s terms with weights that are not negative and add up to 1 is off by at most (s + 2)uR, u = 2⁻⁵³ and R the
    largest coordinate; s is at most twice the largest valence or face size, plus one. Hundred levels of such sums and
    a last difference of three points with its norm stay below 128(2s + 8)uR, some 10⁻⁷ of ``smallest_tolerance``.
    """
    terms = 2 * max(int(mesh.vertex_face_counts.max(initial=0)), int(mesh.face_sizes.max(initial=0))) + 1
    return 128 * (2 * terms + 8) * 2.0**-53 * largest_coordinate(mesh)


def face_depths(mesh: PolygonMesh, tolerance: float, method: str, vertices: str) -> DepthResult:
    """The depth of every face of a mesh whose sharpness is explicit (``catmull_clark.apply_boundary_rule``).

    tolerance: the largest distance allowed, in the unit of the positions. method, vertices: names of ``Method`` and
    ``Vertices``. Raises InvalidMeshError, ToleranceError, and ValueError for an unknown name.
    """
    steps = face_depths_stepwise(mesh, tolerance, method, vertices)
    while True:
        try:
            next(steps)
        except StopIteration as finished:
            return finished.value


def face_depths_stepwise(
    mesh: PolygonMesh, tolerance: float, method: str, vertices: str
) -> Generator[float, None, DepthResult]:
    """``face_depths`` in small steps: yields the fraction done, and returns the result at the end."""
    validate(mesh)
    _check_tolerance(mesh, tolerance)
    search = _Search(tolerance, rounding_allowance(mesh), PATCH_METHODS[Method(method)], Vertices(vertices))
    result = DepthResult(np.zeros(mesh.face_count, dtype=np.int32), np.zeros(mesh.face_count))
    done = 0
    for block in search.blocks(mesh):
        result.depths[block.faces] = block.depths
        result.bounds[block.faces] = block.bounds
        done += len(block.faces)
        yield done / mesh.face_count
    return result


def _check_tolerance(mesh: PolygonMesh, tolerance: float) -> None:
    if not np.isfinite(tolerance):
        raise ToleranceError("the tolerance is not a finite number")
    if tolerance <= 0:
        raise ToleranceError("the tolerance must be greater than zero")
    least = smallest_tolerance(mesh)
    if tolerance < least:
        raise ToleranceError(
            f"the tolerance {tolerance:.3g} is finer than the mesh's single-precision coordinates can show; "
            f"the smallest that means anything here is {least:.3g}"
        )


@dataclass(frozen=True)
class _FaceBlock:
    """Some faces of the mesh, settled: (P,) face indices, depths and bounds."""

    faces: IndexArray
    depths: NDArray[np.int32]
    bounds: FloatArray


@dataclass(frozen=True)
class _Piece:
    """Descendants of one kind that appear at one level: the base face of each (an index), and their bounds."""

    level: int
    bases: IndexArray
    bounds: PatchBounds

    def of(self, wanted: NDArray[np.bool_]) -> _Piece:
        """The part of it whose base faces are wanted: (base faces,) bool."""
        kept = wanted[self.bases]
        return _Piece(self.level, self.bases[kept], PatchBounds(self.bounds.value[kept], self.bounds.rate))


@dataclass(frozen=True)
class _Search:
    """How far each face has to be subdivided: one question, put to meshes and their refinements."""

    tolerance: float
    allowance: float
    method: PatchMethod
    vertices: Vertices

    def blocks(self, mesh: PolygonMesh) -> Iterator[_FaceBlock]:
        """Every face of the mesh, in blocks; some blocks are empty, to let the caller breathe."""
        patches = classify_patches(mesh)
        yield _NOTHING
        for faces, bounds in self._patches(mesh, patches, np.arange(mesh.face_count)):
            depths, reached = self._first_levels(bounds)
            yield _FaceBlock(faces, depths, reached)
        irregular = np.flatnonzero(patches.kinds == PatchKind.IRREGULAR)
        for faces in split(irregular, IRREGULAR_FACES_AT_ONCE):
            yield from self._irregular_block(mesh, faces)

    def _patches(
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

    def _within(self, bounds: FloatArray) -> NDArray[np.bool_]:
        return bounds + self.allowance <= self.tolerance

    def _first_levels(self, bounds: PatchBounds) -> tuple[NDArray[np.int32], FloatArray]:
        """The first level of each patch whose bound is within the tolerance, and that bound: (P,) each."""
        levels = np.zeros(len(bounds.value), dtype=np.int32)
        reached = bounds.value.copy()
        undecided = np.flatnonzero(~self._within(reached))
        while len(undecided):
            levels[undecided] += 1
            reached[undecided] = bounds.value[undecided] * bounds.rate ** levels[undecided[0]]
            undecided = undecided[~self._within(reached[undecided])]
        return levels, reached + self.allowance

    def _irregular_block(self, mesh: PolygonMesh, faces: IndexArray) -> Iterator[_FaceBlock]:
        """The depth of irregular faces: all are refined in step with the level asked about."""
        depths = np.full(len(faces), -1, dtype=np.int32)
        bounds = np.zeros(len(faces))
        pieces: list[_Piece] = []
        refinement = Refinement.start(mesh, faces)
        level = 0
        while np.any(depths < 0):
            found, refinement = self._take_patches(refinement, level)
            pieces += found
            reached = self._bounds_at(level, pieces, refinement, len(faces))
            settled = (depths < 0) & self._within(reached)
            depths[settled] = level
            bounds[settled] = reached[settled] + self.allowance
            pieces = [piece.of(depths < 0) for piece in pieces]
            refinement = refinement.of(depths < 0).refined()
            level += 1
            yield _NOTHING
        yield _FaceBlock(faces, depths, bounds)

    def _take_patches(self, refinement: Refinement, level: int) -> tuple[list[_Piece], Refinement]:
        """The refinement's patches as pieces, and the refinement with its irregular descendants alone."""
        if not len(refinement.bases):
            return [], refinement
        patches = classify_patches(refinement.mesh)
        core = np.arange(len(refinement.bases))
        found = self._patches(refinement.mesh, patches, core)
        pieces = [_Piece(level, refinement.bases[block], bounds) for block, bounds in found]
        return pieces, refinement.keep(patches.kinds[core] == PatchKind.IRREGULAR)

    def _bounds_at(self, level: int, pieces: list[_Piece], refinement: Refinement, face_count: int) -> FloatArray:
        """(base faces,) float64: the largest bound at a level of each one's pieces and irregular descendants."""
        reached = np.zeros(face_count)
        for piece in pieces:
            np.maximum.at(reached, piece.bases, piece.bounds.at(level - piece.level))
        if level < FIRST_SUPPORT_LEVEL:
            reached[refinement.bases] = np.inf
        elif len(refinement.bases):
            found = support_bounds(refinement.mesh, self.vertices)[: len(refinement.bases)]
            np.maximum.at(reached, refinement.bases, found)
        return reached


_NOTHING = _FaceBlock(np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.int32), np.zeros(0))
