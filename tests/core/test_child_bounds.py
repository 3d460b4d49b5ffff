# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of quads' children from their parents' coefficients: against the surface itself, evaluated densely."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.stats import binom

from ccdepth_addon.core.adaptive.cells.control_faces import cells_of_faces
from ccdepth_addon.core.adaptive.cells.patch_cells import BicubicCells, ChildApproximations
from ccdepth_addon.core.adaptive.leaf_approximation import LeafApproximation
from ccdepth_addon.core.adaptive.leaf_bounds.child_bounds import child_distances
from ccdepth_addon.core.adaptive.quadtree import Quadtree
from ccdepth_addon.core.adaptive.request import AdaptiveRequest, Mode
from ccdepth_addon.core.adaptive.templates import Transitions
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from tests import meshes

pytestmark = pytest.mark.thorough

# Corners of a quad, counter-clockwise, and the triangles along its first and its second diagonal.
CORNERS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
TRIANGLES = [[(0, 1, 2), (0, 2, 3)], [(1, 2, 3), (1, 3, 0)]]

# Points along each side of a triangle; the middles of the sides are among them.
SAMPLES = 17
STEPS = np.arange(SAMPLES) / (SAMPLES - 1)
WEIGHTS = np.array([(a, b, 1 - a - b) for a in STEPS for b in STEPS if a + b <= 1])

# No result has so many.
MOST_FACES = 1_000_000

# Rounding of some hundred products of values around 1.
ROUNDING = 1e-12


def surface(coefficients: FloatArray, parameters: FloatArray) -> FloatArray:
    """(N, P, 3): points at parameters (N, 2). Bernstein polynomials are what the binomial distribution is made of."""
    along, across = (binom.pmf(np.arange(4), 3, column[:, None]) for column in parameters.T)
    return np.einsum("ni,nj,ijpk->npk", along, across, coefficients.reshape(4, 4, -1, 3))


def distances(coefficients: FloatArray, corner: int, diagonal: int) -> tuple[FloatArray, FloatArray]:
    """(P,) each, of the child at a corner: the largest distance at equal parameters, and that at sides' middles."""
    is_middle = np.sort(WEIGHTS, axis=1)[:, 1:].min(axis=1) == 0.5
    both = np.concatenate([np.linalg.norm(gaps, axis=2) for gaps in gaps_of(coefficients, corner, diagonal)])
    return both.max(axis=0), both[np.tile(is_middle, 2)].max(axis=0)


def gaps_of(coefficients: FloatArray, corner: int, diagonal: int) -> Iterator[FloatArray]:
    """For each triangle of the child at a corner: S - T at places all over it (N, P, 3)."""
    # The child's corners, from that one on: half-way from it to all.
    child = (CORNERS[corner] + np.roll(CORNERS, -corner, axis=0)) / 2
    for triangle in TRIANGLES[diagonal]:
        places = child[list(triangle)]
        yield surface(coefficients, WEIGHTS @ places) - np.tensordot(WEIGHTS, surface(coefficients, places), axes=1)


def random_coefficients(roughness: float) -> FloatArray:
    """(16, 60, 3): wavy quads over the unit square, and this much displaced at random."""
    generator = np.random.default_rng(5)
    grid = np.stack([*np.meshgrid(np.arange(4) / 3, np.arange(4) / 3, indexing="ij"), np.zeros((4, 4))], axis=-1)
    flat = np.repeat(grid.reshape(16, 1, 3), 60, axis=1)
    waves = np.sin(np.einsum("npi,ipj->npj", flat[..., :2], generator.normal(size=(2, 60, 3))))
    return flat + waves + roughness * generator.normal(size=flat.shape)


@pytest.mark.parametrize("roughness", [0.0, 0.01, 1.0])
def test_no_child_is_farther_than_its_bound(roughness: float) -> None:
    coefficients = random_coefficients(roughness)
    found = child_distances(coefficients, np.inf)
    for corner in range(4):
        for diagonal in range(2):
            largest, at_middles = distances(coefficients, corner, diagonal)
            assert np.all(largest <= found.bounds[corner, diagonal] + ROUNDING)
            np.testing.assert_allclose(found.sampled[corner, diagonal], at_middles, rtol=0, atol=ROUNDING)


def test_bounds_of_nearly_quadratic_quads_are_tight() -> None:
    """Quads of a smooth mesh after some levels: the bound is the largest distance but for a few per cent."""
    coefficients = random_coefficients(0.0)
    # A level divides the part that is not quadratic by eight, and the quadratic part by four.
    for _ in range(4):
        coefficients = first_children(coefficients)
    found = child_distances(coefficients, np.inf)
    for corner in range(4):
        for diagonal in range(2):
            largest, _ = distances(coefficients, corner, diagonal)
            ratios = found.bounds[corner, diagonal] / largest
            assert 1 <= np.median(ratios) < 1.05


def first_children(coefficients: FloatArray) -> FloatArray:
    """Of the children at corner 0, by blossoms: half the steps of de Casteljau in each direction."""
    halves = np.array([binom.pmf(np.arange(4), degree, 0.5) for degree in range(4)])
    found = np.einsum("ai,bj,ijpk->abpk", halves, halves, coefficients.reshape(4, 4, -1, 3))
    return found.reshape(16, -1, 3)


def test_far_children_are_those_beyond_the_limit_along_both_diagonals() -> None:
    coefficients = random_coefficients(0.01)
    everything = child_distances(coefficients, 0.0)
    limit = float(np.median(everything.sampled))
    far = child_distances(coefficients, limit).far
    expected = everything.sampled.min(axis=1) > limit
    assert 0 < np.count_nonzero(expected) < expected.size
    found = np.zeros_like(expected)
    found[far.at_corners, far.of_quads] = True
    np.testing.assert_array_equal(found, expected)
    order = everything.far.at_corners * coefficients.shape[1] + everything.far.of_quads
    same = np.searchsorted(np.sort(order), far.at_corners * coefficients.shape[1] + far.of_quads)
    np.testing.assert_array_equal(far.corners, everything.far.corners[:, np.argsort(order)[same]])


def test_points_are_those_of_the_whole_quads() -> None:
    coefficients = random_coefficients(1.0)
    middles = (CORNERS + np.roll(CORNERS, -1, axis=0)) / 2
    places = np.concatenate([CORNERS, middles, [[0.5, 0.5]]])
    found = child_distances(coefficients, np.inf).points
    np.testing.assert_allclose(found, surface(coefficients, places), rtol=0, atol=ROUNDING)


def through_parents(mesh: PolygonMesh, limit: float) -> tuple[ChildApproximations, LeafApproximation]:
    """Approximations of the children of a regular mesh's faces, by their parents' coefficients and by their own."""
    tree, request = Quadtree(mesh), AdaptiveRequest(limit, Mode.ADAPTIVE, Transitions.TRIANGLES, MOST_FACES)
    [parents] = [cells for cells in cells_of_faces(mesh) if isinstance(cells, BicubicCells)]
    tree.split(parents.nodes)
    nodes = tree.children_of_quads(parents.nodes).ravel()
    assert np.array_equal(np.sort(nodes), np.arange(mesh.face_count, len(tree.first_child)))
    [children] = parents.children(tree)
    own = children.approximate(np.zeros(4 * len(children.nodes), dtype=bool), request)
    order = np.argsort(children.nodes)
    to_nodes = order[np.searchsorted(children.nodes, nodes, sorter=order)]
    return parents.approximate_children(limit, request.axes), own.at(to_nodes)


@pytest.mark.parametrize("limit", [0.03, 0.05, 0.1])
def test_children_are_within_the_limit_as_they_are_by_themselves(limit: float) -> None:
    """But for the monomials, which are the parents', and finer bounds: that makes a third here, on few large quads."""
    mesh = apply_boundary_rule(meshes.to_polygon_mesh(meshes.bumpy(meshes.torus(9, 7), 0.2)), smooth_corners=True)
    found, own = through_parents(mesh, limit)
    approximation = found.approximation
    assert np.all(own.accepted[approximation.accepted])
    # All are within the largest limit.
    assert np.any(found.out_of_reach) == (limit < 0.1)
    assert not np.any(own.accepted[found.out_of_reach])
    np.testing.assert_allclose(approximation.least, own.least, rtol=0, atol=ROUNDING)
    # By themselves they have finer bounds along the better diagonal before the other one is tried.
    both = np.isfinite(approximation.bounds) & np.isfinite(own.bounds)
    same = np.flatnonzero(both & (approximation.alternatives == own.alternatives))
    assert len(same) > 0.5 * np.count_nonzero(both) > 0
    np.testing.assert_array_equal(approximation.folded[same], own.folded[same])
    ratios = approximation.bounds[same] / own.bounds[same]
    assert np.all((ratios > 0.7) & (ratios < 1.4))
    assert np.all(np.isinf(approximation.bounds[~approximation.accepted]))
    assert np.all(approximation.accepted[own.bounds < limit / 1.4])


def test_children_are_promising_as_they_are_by_themselves() -> None:
    """On a nearly flat sheet with bent sides: off at equal parameters, but not along the normals."""
    sheet = meshes.to_polygon_mesh(meshes.grid(9, 9))
    x, y, _ = sheet.positions.T
    bent = np.stack([x + 0.05 * y * y, y - 0.05 * x * x, 0.001 * (x * x - y * y)], axis=1)
    mesh = apply_boundary_rule(sheet.changed(positions=bent), smooth_corners=True)
    found, own = through_parents(mesh, 0.003)
    approximation = found.approximation
    np.testing.assert_array_equal(approximation.accepted, own.accepted)
    assert np.any(approximation.accepted)
    assert np.all(np.isinf(approximation.bounds))
    # Of two diagonals that are as good as each other either may come first.
    same = np.flatnonzero(approximation.accepted & (approximation.alternatives == own.alternatives))
    assert len(same) > 0.4 * np.count_nonzero(approximation.accepted)
    np.testing.assert_array_equal(approximation.folded[same], own.folded[same])
