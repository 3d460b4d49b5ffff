# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth of every face: the least level proved to lie within a tolerance of the limit surface.

This is the door to the core: meshes and a tolerance in, depths out. ``norm_depth`` and ``certified_depth`` do the work.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import PATCH_METHODS, Method, Vertices
from ..mesh.polygon_mesh import PolygonMesh, validate
from .certified_depth import certified_blocks, certified_bounds
from .modifier_quality import unmet_corners
from .norm_depth import bounds_fall, norm_blocks, norm_bounds
from .tolerance_test import FaceBlock, LevelBlock, Question

METHODS = tuple(method.value for method in Method)
VERTICES = tuple(vertices.value for vertices in Vertices)

Answer = TypeVar("Answer")


class ToleranceError(ValueError):
    """The tolerance decides nothing on this mesh; the message says why in a modeller's words."""


@dataclass(frozen=True)
class DepthResult:
    """What was found, (F,) each; distances are in the unit of the positions.

    depths: int32. bounds: float64, the proved distance at that depth. distances: float64, a distance that is really
    reached there (0 where the method looks for none). exact: bool, whether every lesser depth is disproved.
    """

    depths: NDArray[np.int32]
    bounds: FloatArray
    distances: FloatArray
    exact: BoolArray


def largest_coordinate(mesh: PolygonMesh) -> float:
    """The largest absolute coordinate of a vertex that has a face."""
    has_faces = mesh.vertex_face_counts > 0
    used = mesh.positions if np.all(has_faces) else mesh.positions[has_faces]
    return max(float(used.max(initial=0.0)), -float(used.min(initial=0.0)))


def largest_valence(mesh: PolygonMesh) -> int:
    """The largest number of faces at a vertex, or of corners of a face."""
    return max(int(mesh.vertex_face_counts.max(initial=0)), int(mesh.face_sizes.max(initial=0)))


def modifier_rounding(mesh: PolygonMesh, level: int) -> float:
    """How far Blender's own single precision may put vertices of a level off, in the unit of the positions.

    (2n + 4k)uR, with n the largest valence or face size, k the level, u = 2⁻²⁴ and R the largest coordinate: by
    measurement up to valence 128, at least half as much again as was found (docs/methods.md, Single precision).
    """
    return (2 * largest_valence(mesh) + 4 * level) * 2.0**-24 * largest_coordinate(mesh)


def smallest_step(mesh: PolygonMesh) -> float:
    """Four steps of single precision at the largest coordinate: nothing finer can be told from the coordinates."""
    return 2.0**-22 * largest_coordinate(mesh)


def smallest_tolerance(mesh: PolygonMesh) -> float:
    """The least tolerance that a depth can be promised for: what single precision puts off at level 1 already."""
    return modifier_rounding(mesh, 1)


def rounding_allowance(mesh: PolygonMesh) -> float:
    """What double-precision rounding can hide from a bound, in the unit of the positions.

    A sum of s terms with weights that are not negative and add up to 1 is off by at most (s + 2)uR, u = 2⁻⁵³ and R the
    largest coordinate; s is at most twice the largest valence or face size, plus one, and 9 on a regular patch. Hundred
    levels of such sums and a last difference of three points with its norm stay below 128(2s + 8)uR, some 10⁻⁶ of
    ``smallest_step``. What it has to cover where triangles are drawn: docs/adaptive.md, Rounding.
    """
    terms = 2 * max(largest_valence(mesh), 4) + 1
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
    check_tolerance(tolerance, smallest_tolerance(mesh))
    question = Question(tolerance, rounding_allowance(mesh))
    whole = FaceBlock.undecided(np.arange(mesh.face_count))
    done = 0
    for block in _blocks(mesh, question, Method(method), Vertices(vertices)):
        whole.take(block)
        done += len(block.faces)
        yield done / mesh.face_count
    return DepthResult(whole.depths, whole.bounds, whole.distances, whole.exact)


def level_bounds(mesh: PolygonMesh, tolerance: float, method: str, vertices: str, level: int) -> FloatArray:
    """(F,) float64: what is proved of every face at one level, in the unit of the positions; inf where that is not
    within the tolerance.

    Arguments and errors are those of ``face_depths``.
    """
    validate(mesh)
    check_tolerance(tolerance, smallest_tolerance(mesh))
    bounds = np.full(mesh.face_count, np.inf)
    faces = np.arange(mesh.face_count)
    for block in _level_blocks(mesh, tolerance, Method(method), Vertices(vertices), faces, level):
        bounds[block.faces] = block.bounds
    return bounds


def uniform_level(mesh: PolygonMesh, tolerance: float, method: str, vertices: str) -> int:
    """The first level, from the deepest depth on, at which all faces are proved to be within the tolerance.

    A face can be farther from the surface at a level than at the one before, so that the deepest depth need not be it.
    With limit vertices, a margin is left at corners that Blender does not show quite on the surface
    (``modifier_quality``). Arguments and errors are those of ``face_depths``.
    """
    found = face_depths(mesh, tolerance, method, vertices)
    steps = uniform_level_stepwise(mesh, tolerance, method, vertices, found.depths)
    while True:
        try:
            next(steps)
        except StopIteration as finished:
            return finished.value


def uniform_level_stepwise(
    mesh: PolygonMesh, tolerance: float, method: str, vertices: str, depths: NDArray[np.int32], least: int = 0
) -> Generator[float, None, int]:
    """``uniform_level`` in small steps: yields the fraction done, which only rises, and returns the level.

    mesh, tolerance: such as ``face_depths`` takes. depths: (F,) what it found with the same arguments; these are proved
    at their own level, and where bounds only fall, at all later ones; all others are evaluated. least: no level before
    this one is wanted. With limit vertices level 1 is the first: a modifier at level 0 leaves every vertex where it is.
    """
    falls = bounds_fall(mesh, Method(method))
    with_margin, margin = np.zeros(mesh.face_count, dtype=bool), 0.0
    if Vertices(vertices) is Vertices.LIMIT:
        unmet = unmet_corners(mesh)
        with_margin[mesh.corner_faces[unmet.corners]] = True
        margin = unmet.margin(tolerance)
        least = max(least, 1)
    level = max(least, int(depths.max(initial=0)))
    # How many levels there will be is not known: each has half of what is left.
    begun = 0.0
    while True:
        parts = [(np.flatnonzero((depths != level) & ~falls & ~with_margin), tolerance)]
        if np.any(with_margin):
            parts.append((np.flatnonzero(with_margin), tolerance - margin))
        steps = _all_within(mesh, parts, Method(method), Vertices(vertices), level)
        if (yield from scaled(steps, begun, (1 - begun) / 2)):
            return level
        begun += (1 - begun) / 2
        level += 1


def scaled(steps: Generator[float, None, Answer], start: float, share: float) -> Generator[float, None, Answer]:
    """The same steps, with their fraction as a share of a larger whole."""
    while True:
        try:
            fraction = next(steps)
        except StopIteration as finished:
            answer: Answer = finished.value
            return answer
        yield start + share * fraction


def _all_within(
    mesh: PolygonMesh, parts: list[tuple[IndexArray, float]], method: Method, vertices: Vertices, level: int
) -> Generator[float, None, bool]:
    """Whether some faces are within a tolerance, others within another, at one level; ends with the first that is not.

    Yields the fraction done.
    """
    total, done = max(sum(len(faces) for faces, _ in parts), 1), 0
    for faces, tolerance in parts:
        for block in _level_blocks(mesh, tolerance, method, vertices, faces, level):
            done += len(block.faces)
            yield done / total
            if not block.all_within:
                return False
    return True


def _level_blocks(
    mesh: PolygonMesh, tolerance: float, method: Method, vertices: Vertices, faces: IndexArray, level: int
) -> Iterator[LevelBlock]:
    question = Question(tolerance, rounding_allowance(mesh))
    if method is Method.CERTIFIED:
        return certified_bounds(mesh, question, vertices, faces, level)
    return norm_bounds(mesh, question, PATCH_METHODS[method], vertices, faces, level)


def _blocks(mesh: PolygonMesh, question: Question, method: Method, vertices: Vertices) -> Iterator[FaceBlock]:
    if method is Method.CERTIFIED:
        return certified_blocks(mesh, question, vertices)
    return norm_blocks(mesh, question, PATCH_METHODS[method], vertices)


def check_tolerance(tolerance: float, least: float) -> None:
    """Raise ToleranceError unless it is a number, greater than zero and not below the least that means anything."""
    if not np.isfinite(tolerance):
        raise ToleranceError("the tolerance is not a finite number")
    if tolerance <= 0:
        raise ToleranceError("the tolerance must be greater than zero")
    if tolerance < least:
        raise ToleranceError(
            f"the tolerance {tolerance:.3g} is finer than the mesh's single-precision coordinates can show; "
            f"the smallest that means anything here is {least:.3g}"
        )
