# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a mesh from the limit surface of a control mesh: proved from above, reached from below.

The two-sided Hausdorff distance: the longest way from a point of either to the nearest point of the other. Nothing here
uses what adaptive subdivision relies on, as this is its check. docs/deviation.md has the proofs.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.validation import validate
from ..progress import Progress, no_report
from .bezier_pieces import bezier_pieces
from .findings import Findings
from .mesh_to_surface import MeshToSurface
from .surface_to_mesh import SurfaceToMesh
from .triangles import Triangles

# Of how many pieces and parts there may be: so many for each triangle and each quad to begin with, and these besides.
PIECES_OF_EACH, PIECES_BESIDES = 16, 1 << 21

# To begin with a unit has about so many triangles.
TRIANGLES_OF_A_UNIT = 8

# A tolerance is told from a distance this much smaller; nothing nearer needs to be known.
PART_OF_TOLERANCE = 1e-3

# What rounding can hide of how far a point lies inside a side, as a part of the largest coordinate.
MARGIN = 2.0**-40


@dataclass(frozen=True)
class Deviation:
    """proved ≥ true two-sided Hausdorff distance ≥ reached, in the positions' unit, rounding covered.

    face_bounds: (F,) float64 per control face and triangle_bounds: (T,) float64 per triangle: proved distances, both
    ways, of the parts that belong to each. Parts of the surface belong to their control face and to the triangle they
    were compared with, triangles likewise, so that the largest of either is ``proved``.
    worst_point, worst_nearest: (3,) float64, the pair that reaches ``reached``: a point of the surface and the nearest
    one of the mesh where surface_to_mesh, else the other way round. worst_face, worst_triangle: where they lie.
    accuracy_met: whether proved ≤ (1 + accuracy) · reached, or is enough, or so small that rounding, or the tolerance,
    hides it. out_of_time: whether the time limit ended it; where something was left to do, max_pieces did otherwise.
    """

    proved: float
    reached: float
    face_bounds: FloatArray
    triangle_bounds: FloatArray
    worst_point: FloatArray
    worst_nearest: FloatArray
    worst_face: int
    worst_triangle: int
    surface_to_mesh: bool
    accuracy_met: bool
    out_of_time: bool


def measure_deviation(
    control: PolygonMesh,
    positions: FloatArray,
    triangles: IndexArray,
    *,
    triangle_faces: IndexArray | None = None,
    accuracy: float = 0.05,
    max_pieces: int | None = None,
    time_limit: float | None = None,
    tolerance: float | None = None,
    enough: float = 0.0,
    limit: float = 0.0,
    progress: Progress = no_report,
) -> Deviation:
    """The deviation of a mesh of triangles from the limit surface of ``control``, both ways.

    control: with explicit sharpness (``sharpness.apply_boundary_rule``). positions: (V, 3) float64; triangles:
    (T, 3) intp. triangle_faces: (T,) intp, the control face each triangle belongs to, where that is known: its
    distance then counts for that face. accuracy: how near ``proved`` shall be to ``reached``. max_pieces
    (``PIECES_OF_EACH`` unless given), time_limit (seconds): where these are used up the result is what is proved until
    then. tolerance: distances far below it need not be told apart. enough: what is proved need not be less than this,
    so that it is soon known whether all is within it. limit: a distance of which it is to be told whether all is
    within, however near that is. progress: is told the fraction done, every tenth of a second or so, and may raise to
    stop.
    Raises InvalidMeshError for the control mesh, ValueError for the other.
    """
    began = perf_counter()
    validate(control)
    _check(positions, triangles)
    origin, size = _frame(control, positions, triangles)
    allowance = rounding_allowance(control, size)
    if max_pieces is None:
        max_pieces = PIECES_OF_EACH * (len(triangles) + len(control.corner_vertices)) + PIECES_BESIDES
    findings = Findings(
        accuracy=accuracy,
        limit=limit,
        floor=max(4 * allowance, PART_OF_TOLERANCE * (tolerance or 0.0)),
        enough=enough,
        allowance=allowance,
        margin=MARGIN * size,
        max_pieces=max_pieces,
        began=began,
        time_limit=np.inf if time_limit is None else time_limit,
        report=progress,
        in_faces=np.zeros(control.face_count),
    )
    mesh = Triangles.of(positions - origin, triangles, findings.tick)
    moved = control.changed(positions=control.positions - origin)
    pieces = bezier_pieces(moved, len(triangles) // TRIANGLES_OF_A_UNIT, findings.tick)
    whole = 2 * np.sqrt(3) * size
    surface = SurfaceToMesh(pieces, mesh, findings, whole)
    surface.settle(pieces.leaves())
    other_way = MeshToSurface(surface, mesh, control.face_count, whole)
    other_way.settle()
    return _deviation(surface, other_way, triangle_faces, origin)


def rounding_allowance(control: PolygonMesh, size: float) -> float:
    """The largest distance that double-precision rounding can hide, in the unit of the positions. docs/deviation.md,
    Rounding.

    size: the largest coordinate, seen from the middle of both. What positions in the scene are off themselves: three
    roundings, by ``rounded_size``.
    """
    terms = 2 * max(int(control.vertex_face_counts.max(initial=0)), int(control.face_sizes.max(initial=0))) + 1
    return (128 * (2 * terms + 8) + 2**14) * 2.0**-53 * size + 4 * 2.0**-53 * control.rounded_size


def _check(positions: FloatArray, triangles: IndexArray) -> None:
    if not len(triangles):
        raise ValueError("the mesh to measure has no triangles")
    used = positions[triangles]
    if not np.isfinite(used).all():
        raise ValueError("the mesh to measure has a vertex at no finite position")


def _frame(control: PolygonMesh, positions: FloatArray, triangles: IndexArray) -> tuple[FloatArray, float]:
    """The middle of the box around both, and the largest coordinate seen from there."""
    used = np.zeros(len(positions), dtype=bool)
    used[triangles] = True
    points = np.concatenate([control.positions[control.vertex_face_counts > 0], positions[used]])
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, float((high - low).max()) / 2


def _deviation(
    surface: SurfaceToMesh, other_way: MeshToSurface, triangle_faces: IndexArray | None, origin: FloatArray
) -> Deviation:
    leaves, findings = surface.pieces.leaves(), surface.findings
    face_bounds, triangle_bounds = other_way.face_upper.copy(), other_way.upper.copy()
    np.maximum.at(face_bounds, surface.pieces.faces[leaves], surface.upper[leaves])
    np.maximum.at(triangle_bounds, surface.triangles[leaves], surface.upper[leaves])
    if triangle_faces is not None:
        np.maximum.at(face_bounds, triangle_faces, other_way.upper)
    proved = float(triangle_bounds.max())
    return Deviation(
        proved=proved,
        reached=findings.reached,
        face_bounds=face_bounds,
        triangle_bounds=triangle_bounds,
        worst_point=findings.point + origin,
        worst_nearest=findings.nearest + origin,
        worst_face=findings.face,
        worst_triangle=findings.triangle,
        surface_to_mesh=findings.surface_to_mesh,
        accuracy_met=proved <= findings.accurate,
        out_of_time=findings.is_late(),
    )
