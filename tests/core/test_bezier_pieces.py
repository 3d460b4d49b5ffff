# SPDX-License-Identifier: GPL-3.0-or-later
"""Bézier pieces against points of the surface at the same parameters, found by subdivision and limit positions."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.deviation.bezier_pieces import BezierPieces, bezier_pieces
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes
from tests.brute_force import linear_children

# Levels below the units whose vertices are compared.
DEEPER = 5

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

# Coefficients are averages of coordinates up to about ten.
ROUNDING = 1e-13


def nothing() -> None:
    """For work that is not stopped."""


def points_of_units(units: PolygonMesh) -> tuple[FloatArray, FloatArray]:
    """(F, n, 2) parameters on each unit, and (F, n, 3) the surface there."""
    mesh, parameters = units, np.tile(SQUARE, (units.face_count, 1))
    for _ in range(DEEPER):
        parameters, mesh = linear_children(mesh, parameters), subdivide(mesh).mesh
    points = limit_positions(mesh)[mesh.corner_vertices]
    return parameters.reshape(units.face_count, -1, 2), points.reshape(units.face_count, -1, 3)


def evaluated(coefficients: FloatArray, parameters: FloatArray) -> FloatArray:
    """(n, 3): a piece (3, 16) at parameters (n, 2)."""
    bernstein = [np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1) for t in parameters.T]
    return np.einsum("ni,nj,dij->nd", *bernstein, coefficients.reshape(3, 4, 4))


def within(pieces: BezierPieces, unit: int, parameters: FloatArray, points: FloatArray) -> float:
    """The greatest part of its excess that a leaf of a unit is off the surface; wherever that is, it is no more."""
    corners = limit_positions(pieces.unit_mesh)[pieces.unit_mesh.corner_vertices[4 * unit : 4 * unit + 4]]
    turn = int(np.linalg.norm(corners - pieces.coefficients[unit][:, 0], axis=1).argmin())
    frames = [(unit, np.roll(SQUARE, -turn, axis=0))]
    worst = 0.0
    while frames:
        piece, frame = frames.pop()
        first = pieces.first_child[piece]
        if first >= 0:
            for child in range(4):
                frames.append((first + child, frame_of_child(pieces, piece, first, child, frame)))
            continue
        along, across = frame[1] - frame[0], frame[3] - frame[0]
        local = (parameters - frame[0]) @ np.linalg.inv(np.stack([along, across]))
        inside = np.flatnonzero(((local > -1e-9) & (local < 1 + 1e-9)).all(axis=1))
        if not len(inside):
            # Smaller than the steps between samples.
            continue
        off = np.linalg.norm(evaluated(pieces.coefficients[piece], local[inside]) - points[inside], axis=1).max()
        excess = pieces.excess[piece]
        assert off <= excess + ROUNDING
        middle = inside[np.abs(local[inside] - 0.5).max(axis=1) < 1e-9]
        if len(middle) and not pieces.is_bilinear(np.array([piece])):
            assert np.abs(pieces.middles[piece] - points[middle]).max() < ROUNDING
        worst = max(worst, off / excess if excess else 0.0)
    return worst


def frame_of_child(pieces: BezierPieces, piece: int, first: int, child: int, frame: FloatArray) -> FloatArray:
    """(4, 2): where the corners of a child lie, by where its own corners are on the surface."""
    middles = (frame + np.roll(frame, -1, axis=0)) / 2
    corner = [frame, middles, np.broadcast_to(frame.mean(axis=0), (4, 2)), np.roll(middles, 1, axis=0)]
    quads = np.stack(corner, axis=1)
    if pieces.excess[piece] == 0:
        # Quarters go by their place, each from the corner nearest to corner 0 of the whole.
        place = np.array([0, 1, 3, 2])[child]
        return np.roll(quads[place], place, axis=0)
    return quads[child]


CASES = {
    **{f"valence {n}": (lambda n=n: meshes.fan(n, 2)) for n in (3, 5, 6, 9, 20)},
    "several at a face": lambda: meshes.around_quad((3, 5, 6, 7)),
    "triangles": lambda: meshes.bumpy(meshes.bipyramid(7), 0.1),
    "creases": lambda: meshes.with_random_creases(meshes.triangles_and_quads()),
    "boundary": lambda: meshes.landscape(3, 2),
}


@pytest.mark.parametrize("name", CASES)
def test_surface_is_within_the_excess_at_equal_parameters(name: str) -> None:
    control = apply_boundary_rule(meshes.to_polygon_mesh(CASES[name]()), smooth_corners=True)
    pieces = bezier_pieces(control, 0, nothing)
    parameters, points = points_of_units(pieces.unit_mesh)
    for _ in range(2):
        for unit in range(pieces.unit_count):
            within(pieces, unit, parameters[unit], points[unit])
        pieces.split(pieces.leaves())


@pytest.mark.parametrize("valence", [3, 5, 6, 8, 12])
def test_excess_is_small_near_extraordinary_vertices(valence: int) -> None:
    control = apply_boundary_rule(meshes.to_polygon_mesh(meshes.fan(valence, 2)), smooth_corners=True)
    pieces = bezier_pieces(control, 0, nothing)
    parameters, points = points_of_units(pieces.unit_mesh)
    around = np.unique(pieces.unit_mesh.corner_faces[pieces.unit_mesh.corner_vertices == 0])
    assert len(around) == valence
    sizes = np.linalg.norm(np.ptp(pieces.coefficients[around], axis=2), axis=1)
    # A 25th of the piece at most, and at least a fifth of that is really there.
    assert np.all(pieces.excess[around] < sizes / 25)
    assert max(within(pieces, unit, parameters[unit], points[unit]) for unit in around) > 0.2
