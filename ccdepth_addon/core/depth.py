# SPDX-License-Identifier: GPL-3.0-or-later
"""The depth of every face: the least level proved to lie within a tolerance of the limit surface.

This is the door to the core: meshes and a tolerance in, depths out. ``norm_depth`` and ``certified_depth`` do the work.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bounds import PATCH_METHODS, Method, Vertices
from .certified_depth import certified_blocks
from .mesh import FloatArray, PolygonMesh, validate
from .norm_depth import norm_blocks
from .search import FaceBlock, Question

METHODS = tuple(method.value for method in Method)
VERTICES = tuple(vertices.value for vertices in Vertices)


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
    exact: NDArray[np.bool_]


def largest_coordinate(mesh: PolygonMesh) -> float:
    """The largest absolute coordinate of a vertex that has a face."""
    has_faces = mesh.vertex_face_counts > 0
    used = mesh.positions if np.all(has_faces) else mesh.positions[has_faces]
    return max(float(used.max(initial=0.0)), -float(used.min(initial=0.0)))


def smallest_tolerance(mesh: PolygonMesh) -> float:
    """The least tolerance that means anything: four steps of single precision at the largest coordinate."""
    return 2.0**-22 * largest_coordinate(mesh)


def rounding_allowance(mesh: PolygonMesh) -> float:
    """What double-precision rounding can hide from a bound, in the unit of the positions.

    A sum of s terms with weights that are not negative and add up to 1 is off by at most (s + 2)uR, u = 2⁻⁵³ and R the
    largest coordinate; s is at most twice the largest valence or face size, plus one, and 9 on a regular patch. Hundred
    levels of such sums and a last difference of three points with its norm stay below 128(2s + 8)uR, some 10⁻⁶ of
    ``smallest_tolerance``. What it has to cover where triangles are drawn: docs/adaptive.md, Rounding.
    """
    terms = 2 * max(int(mesh.vertex_face_counts.max(initial=0)), int(mesh.face_sizes.max(initial=0)), 4) + 1
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
