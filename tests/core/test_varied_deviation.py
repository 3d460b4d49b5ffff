# SPDX-License-Identifier: GPL-3.0-or-later
"""Deviations in parts of a tolerance that varies, against a fine mesh of the surface with its factors evaluated apart.

Every pair of a point and a triangle is compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
import pytest

from ccdepth_addon.core import FloatArray, IndexArray, PolygonMesh, SurfacePoints, Variation, limit_values
from ccdepth_addon.core.deviation import Deviation, KeptProofs, measure_deviation
from ccdepth_addon.core.deviation.bezier_pieces import bezier_pieces
from ccdepth_addon.core.deviation.piece_factors import PieceFactors
from ccdepth_addon.core.surface.bicubic import CORNERS
from tests import meshes, nets
from tests.core.test_variation import MESHES, build, factors_at, random_factors
from tests.thorough import cases, each
from tests.triangle_distances import point_to_triangles

ACCURACY = 0.1

# The number of cells along a side of a quarter, and of points that are compared each way.
CELLS, POINTS = 8, 24

ROUNDED = 1 + 1e-9


@dataclass(frozen=True)
class FineSurface:
    """N cells of the surface. corners: (N, 4, 3); factors: (N, 4), at these; faces: (N,) intp; sag: how far the cells'
    triangles are off the surface, about."""

    corners: FloatArray
    factors: FloatArray
    faces: IndexArray
    sag: float

    @staticmethod
    def of(mesh: PolygonMesh, factors: FloatArray) -> FineSurface:
        at, own, faces = grid_of_cells(mesh, CELLS)
        corners = limit_values(mesh, mesh.positions, at).reshape(-1, 4, 3)
        middles = SurfacePoints(at.corners[::4], at.parameters.reshape(-1, 4, 2).mean(axis=1))
        off = limit_values(mesh, mesh.positions, middles) - corners[:, [0, 2]].mean(axis=1)
        # The middle of the diagonal is off by about as much as the farthest point; twice that is more than enough.
        sag = 2 * float(np.linalg.norm(off, axis=1).max())
        return FineSurface(corners, factors_at(mesh, factors, at).reshape(-1, 4)[own], faces, sag)

    def at_least(self, points: FloatArray) -> FloatArray:
        """(P,): no more than the reduced distances from points (P, 3): over a cell the greatest factor is at a
        corner."""
        triangles = self.corners[:, [[0, 1, 2], [0, 2, 3]]]
        found = [pairs(points, triangles[:, which]) for which in range(2)]
        return ((np.min(found, axis=0) - self.sag) / self.factors.max(axis=1)).min(axis=1)

    def at_most(self, points: FloatArray) -> FloatArray:
        """(P,): no less than the reduced distances from points (P, 3): to corners of cells."""
        apart = np.linalg.norm(points[:, None, None] - self.corners, axis=3) / self.factors
        return apart.min(axis=(1, 2))


def grid_of_cells(mesh: PolygonMesh, cells: int) -> tuple[SurfacePoints, IndexArray, IndexArray]:
    """The corners of cells in all quarters, four after each other; of N cells their rows (N,) and faces (N,)."""
    steps = np.stack(np.meshgrid(np.arange(cells), np.arange(cells)), axis=-1).reshape(-1, 1, 2)
    square = (steps + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])) / cells
    corners = np.repeat(np.arange(mesh.corner_count), 4 * cells**2)
    points = SurfacePoints(corners, np.tile(square.reshape(-1, 2), (mesh.corner_count, 1)))
    rows = np.arange(mesh.corner_count * cells**2)
    return points, rows, mesh.corner_faces[corners[::4]]


def pairs(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """(P, N): the distances from points (P, 3) to triangles (N, 3, 3)."""
    every = np.repeat(points, len(triangles), axis=0), np.tile(triangles, (len(points), 1, 1))
    return point_to_triangles(*every).reshape(len(points), -1)


def drawn(mesh: PolygonMesh, rng: np.random.Generator) -> tuple[FloatArray, IndexArray]:
    """The first level as triangles, with its vertices moved by up to a twentieth of a face or so."""
    refined = nets.refined(mesh, 1)
    off = 0.05 * meshes.diagonal(mesh) * rng.random((refined.vertex_count, 1)) ** 3
    triangles = refined.corner_vertices.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return refined.positions + off * rng.normal(size=(refined.vertex_count, 3)), triangles


def assert_bounds(
    found: Deviation, fine: FineSurface, positions: FloatArray, triangles: IndexArray, rng: np.random.Generator
) -> None:
    """Bounds hold of each face and triangle, and the worst pair of points is as far apart as told."""
    cells = rng.integers(len(fine.corners), size=POINTS)
    there = pairs(fine.corners[cells, 0], positions[triangles]).min(axis=1) / fine.factors[cells, 0]
    assert np.all(there <= found.face_bounds[fine.faces[cells]] * ROUNDED)
    which = rng.integers(len(triangles), size=POINTS)
    points = np.einsum("nk,nkd->nd", rng.dirichlet(np.full(3, 0.5), size=POINTS), positions[triangles[which]])
    assert np.all(fine.at_least(points) <= found.triangle_bounds[which] * ROUNDED)
    worst = found.worst_point[None]
    if not found.surface_to_mesh:
        assert found.reached <= fine.at_most(worst)[0]
        return
    apart = np.linalg.norm(fine.corners - worst, axis=2)
    # The point lies in or beside a cell with a corner so near.
    sizes = np.linalg.norm(fine.corners[:, 2] - fine.corners[:, 0], axis=1)
    least = fine.factors[(apart <= sizes.max()).any(axis=1)].min()
    assert found.reached <= pairs(worst, positions[triangles]).min() / least


@pytest.mark.parametrize(("name", "seed"), cases(product(MESHES, range(1, 13)), product(MESHES, [1])))
def test_distances_are_divided_by_the_factors_at_the_surface(name: str, seed: int) -> None:
    mesh, rng = build(name, seed), np.random.default_rng(seed)
    factors, (positions, triangles) = random_factors(mesh, rng), drawn(mesh, rng)
    found = measure_deviation(mesh, positions, triangles, accuracy=ACCURACY, variation=Variation(factors))
    assert found.accuracy_met
    assert found.proved <= (1 + ACCURACY) * found.reached
    assert_bounds(found, FineSurface.of(mesh, factors), positions, triangles, rng)


@pytest.mark.parametrize("name", each(MESHES, ["n-gons"]))
def test_equal_factors_divide_everything(name: str) -> None:
    """But for rounding, and the wider margins for that."""
    mesh, rng = build(name, 1), np.random.default_rng(1)
    positions, triangles = drawn(mesh, rng)
    plain = measure_deviation(mesh, positions, triangles)
    found = measure_deviation(mesh, positions, triangles, variation=Variation(np.full(mesh.corner_count, 8.0)))
    assert found.proved == pytest.approx(plain.proved / 8, rel=1e-9)
    assert found.reached == pytest.approx(plain.reached / 8, rel=1e-9)
    np.testing.assert_allclose(found.face_bounds, plain.face_bounds / 8, rtol=1e-9)


@pytest.mark.parametrize("name", each(MESHES, ["n-gons", "valence 7", "creases"]))
def test_corners_of_pieces_are_at_their_places(name: str) -> None:
    """From whichever corner a piece is counted: there the surface is where the piece is, and factors lie between the
    piece's least and greatest."""
    mesh, rng = build(name, 1), np.random.default_rng(1)
    factors = random_factors(mesh, rng)
    places = PieceFactors(Variation(factors), mesh, np.zeros(3), 0.0)
    pieces = bezier_pieces(mesh, int(rng.integers(2)) * 10_000, lambda: None, places)
    for _ in range(3):
        leaves = pieces.leaves()
        pieces.split(leaves[rng.random(len(leaves)) < 40 / len(leaves)])
    chosen = rng.permutation(pieces.leaves())[:400]
    at = places.places(chosen, np.eye(4))
    surface = limit_values(mesh, mesh.positions, at)
    corners = pieces.coefficients[chosen][:, :, CORNERS].swapaxes(1, 2).reshape(-1, 3)
    np.testing.assert_allclose(corners, surface, atol=1e-12 * meshes.diagonal(mesh))
    inside = places.places(chosen, rng.dirichlet(np.ones(4), size=5))
    own = factors_at(mesh, factors, inside).reshape(-1, 5)
    assert np.all(pieces.least[chosen, None] <= own)
    assert np.all(own <= pieces.greatest[chosen, None])


@pytest.mark.parametrize("name", each(["torus", "n-gons"], ["n-gons"]))
def test_what_is_proved_of_one_mesh_holds_of_the_next_by_reduced_distances(name: str) -> None:
    mesh, rng = build(name, 1), np.random.default_rng(1)
    factors, (plain, triangles) = random_factors(mesh, rng), drawn(mesh, rng)
    fine, variation, proofs = FineSurface.of(mesh, factors), Variation(factors), KeptProofs()
    enough = 0.5 * measure_deviation(mesh, plain, triangles, variation=variation).proved
    for count in (0, 2, 0):
        positions = plain.copy()
        chosen = rng.choice(len(plain), count)
        positions[chosen] += 5 * enough * rng.uniform(-1, 1, (count, 3))
        found = measure_deviation(mesh, positions, triangles, enough=enough, variation=variation, proofs=proofs)
        assert_bounds(found, fine, positions, triangles, rng)
