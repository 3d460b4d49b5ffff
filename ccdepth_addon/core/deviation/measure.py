# SPDX-License-Identifier: GPL-3.0-or-later
"""The distance of a mesh from the limit surface of a control mesh: a proved upper bound, and a reached lower bound.

The distance is the two-sided Hausdorff distance: the largest distance from a point of either to the nearest point of
the other. Measuring checks adaptive subdivision, and shares no bound with that. docs/deviation.md has the proofs.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from ..arrays.types import FloatArray, IndexArray
from ..bounds.rounding import largest_valence
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.validation import validate
from ..progress import Progress, no_report
from ..tolerance.variation import Variation
from .bezier_pieces import bezier_pieces
from .findings import Findings
from .kept_proofs import KeptProofs
from .mesh_to_surface import MeshToSurface
from .piece_factors import PieceFactors
from .surface_to_mesh import SurfaceToMesh
from .triangles import Triangles

# The largest number of pieces and parts: for each triangle and each quad of the first level, and these besides.
PIECES_OF_EACH, PIECES_BESIDES = 16, 1 << 21

# The number of triangles of a unit, about, at the beginning.
TRIANGLES_OF_A_UNIT = 8

# Distances below this part of the tolerance need not be told apart.
PART_OF_TOLERANCE = 1e-3

# The rounding of a point's distance from a side, as a part of the largest coordinate.
MARGIN = 2.0**-40


@dataclass(frozen=True)
class Deviation:
    """The bounds of a two-sided Hausdorff distance: proved ≥ distance ≥ reached, in the unit of the positions, with
    rounding covered. Where the tolerance varies, every distance is *reduced*: a distance at a point of the surface is
    divided by the factor on the tolerance there, and the nearest point of the surface has the least reduced distance.

    face_bounds: (F,) float64, per control face, and triangle_bounds: (T,) float64, per triangle: the proved distances
    of their parts, both ways. A part of the surface counts for its control face and for the triangle it was compared
    with, a part of a triangle likewise; so the largest of either array is ``proved``.
    worst_point, worst_nearest: (3,) float64, the two points at the distance ``reached``: with surface_to_mesh a point
    of the surface and the nearest point of the mesh, otherwise the other way round. worst_face, worst_triangle: the
    control face and the triangle of the two points. accuracy_met: whether proved ≤ (1 + accuracy) · reached, or proved
    is at most ``enough``, or too small to count beside rounding or the tolerance. out_of_time: whether the time limit
    ended the measurement; if neither holds, max_pieces ended the measurement.
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
    variation: Variation | None = None,
    proofs: KeptProofs | None = None,
    progress: Progress = no_report,
) -> Deviation:
    """The deviation of a mesh of triangles from the limit surface of ``control``, both ways.

    control: with explicit sharpness (``sharpness.apply_boundary_rule``). positions: (V, 3) float64; triangles:
    (T, 3) intp. triangle_faces: (T,) intp, the control face of each triangle, if known: the triangle's distance then
    counts for that face. accuracy: the largest relative difference of ``proved`` and ``reached``. max_pieces
    (``PIECES_OF_EACH`` by default), time_limit (seconds): the measurement ends there with the bounds proved so far.
    tolerance: distances far below the tolerance need not be told apart. enough: bounds are not refined below this
    distance. limit: the measurement goes on until it decides whether all is within this distance, however near the
    result is. variation: of the tolerance over ``control``; None for the same everywhere. With a variation all
    distances given and returned are reduced. proofs: of the mesh measured before against the same control mesh with the
    same variation, and then of this one; what is reached is then reached at new triangles or near them. progress:
    receives the fraction done about every tenth of a second, and may raise to stop.
    Raises InvalidMeshError for the control mesh, ValueError for the other.
    """
    began = perf_counter()
    validate(control)
    _check(positions, triangles)
    proofs = KeptProofs() if proofs is None else proofs
    origin, size = _frame(control, positions, triangles, proofs.origin)
    rounding, least = measuring_allowance(control, size), 1.0 if variation is None else variation.least_factor
    allowance = rounding / least
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
    factors = None if variation is None else PieceFactors(variation, control, origin, rounding)
    pieces = proofs.pieces or bezier_pieces(moved, len(triangles) // TRIANGLES_OF_A_UNIT, findings.tick, factors)
    whole = 2 * np.sqrt(3) * size / least
    surface = SurfaceToMesh(pieces, mesh, findings, whole)
    other_way = MeshToSurface(surface, mesh, control.face_count, whole)
    left, triangles_left = proofs.take(other_way)
    surface.settle(left)
    other_way.settle(triangles_left)
    proofs.keep(other_way, origin)
    return _deviation(surface, other_way, triangle_faces, origin)


def measuring_allowance(control: PolygonMesh, size: float) -> float:
    """The largest distance that double-precision rounding can hide, in the unit of the positions. docs/deviation.md,
    Rounding.

    size: the largest coordinate, seen from the middle of both. Positions in the scene themselves carry three roundings
    of ``rounded_size``.
    """
    terms = 2 * largest_valence(control) + 1
    return (128 * (2 * terms + 8) + 2**14) * 2.0**-53 * size + 4 * 2.0**-53 * control.rounded_size


def _check(positions: FloatArray, triangles: IndexArray) -> None:
    if not len(triangles):
        raise ValueError("the mesh to measure has no triangles")
    used = positions[triangles]
    if not np.isfinite(used).all():
        raise ValueError("the mesh to measure has a vertex at no finite position")


def _frame(
    control: PolygonMesh, positions: FloatArray, triangles: IndexArray, origin: FloatArray | None
) -> tuple[FloatArray, float]:
    """The origin, by default the centre of the box around both meshes, and the largest coordinate seen from it."""
    used = np.zeros(len(positions), dtype=bool)
    used[triangles] = True
    points = np.concatenate([control.positions[control.vertex_face_counts > 0], positions[used]])
    low, high = points.min(axis=0), points.max(axis=0)
    origin = (low + high) / 2 if origin is None else origin
    return origin, float(np.maximum(high - origin, origin - low).max())


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
