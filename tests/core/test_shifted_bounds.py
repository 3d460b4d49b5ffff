# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds at shifted parameters against dense samples of the surface and of the triangles, both ways."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.adaptive.leaf_bounds.shifted_bounds import shifted_distances
from ccdepth_addon.core.adaptive.leaf_bounds.triangle_bounds import BICUBIC_POINTS, bicubic_basis
from ccdepth_addon.core.adaptive.templates import WHOLE, template_numbers, templates
from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.rounding import rounding_allowance
from tests import meshes
from tests.core.test_leaf_distance import (
    CHOICES,
    GRID,
    KINDS,
    ROUNDING,
    STEPS,
    assert_within,
    grid_facets,
    most_missed,
    random_coefficients,
)

pytestmark = pytest.mark.thorough


def bounds_of(coefficients: FloatArray, pattern: int, alternative: int) -> FloatArray:
    """(P,) of quads (16, P, 3)."""
    points = np.einsum("rk,kpi->rpi", BICUBIC_POINTS, coefficients)
    alternatives = np.full(coefficients.shape[1], alternative)
    return shifted_distances(coefficients, points, template_numbers(np.full_like(alternatives, pattern), alternatives))


@pytest.mark.parametrize("kind", KINDS)
def test_quads_are_within_their_bounds(kind: str) -> None:
    generator = np.random.default_rng(KINDS.index(kind))
    along = np.linspace(0, 1, STEPS + 1)
    basis = bicubic_basis(np.stack(np.meshgrid(along, along, indexing="ij"), axis=-1).reshape(-1, 2))
    for pattern, alternative in CHOICES:
        coefficients = random_coefficients(kind, generator)
        points = np.einsum("rk,kpi->rpi", BICUBIC_POINTS, coefficients)
        triangles = [list(triangle) for triangle in templates(pattern)[alternative]]
        for quad, bound in enumerate(bounds_of(coefficients, pattern, alternative).tolist()):
            surface = basis @ coefficients[:, quad]
            missed = most_missed(surface.reshape(STEPS + 1, STEPS + 1, 3))
            assert_within(surface, grid_facets(), points[triangles, quad], bound, missed)


def test_uneven_spacing_costs_nothing() -> None:
    """Quadratic along straight sides, by other amounts at opposite ones, and more or less in the middle."""
    low, high, square = np.array([3, 2, 1, 0]) / 3, np.array([0, 1, 2, 3]) / 3, np.array([0, 1, 1, 0]) / 3
    shift_u = np.outer(square, 0.3 * low - 0.2 * high + 0.4 * square).ravel()
    shift_v = np.outer(0.1 * low + 0.4 * high - 0.5 * square, square).ravel()
    places = GRID + np.stack([shift_u, shift_v], axis=1)
    sides = np.array([[1.0, 0.2, 0.1], [0.3, 0.8, -0.5]])
    for diagonal in (0, 1):
        assert bounds_of((places @ sides)[:, None], WHOLE, diagonal)[0] < ROUNDING


@pytest.mark.parametrize("offset", [1.0, 1e3, 1e6])
def test_rounding_far_from_the_origin_is_allowed_for(offset: float) -> None:
    """Moved, with coefficients that are exact in both places."""
    generator = np.random.default_rng(3)
    coefficients = np.concatenate([random_coefficients(kind, generator) for kind in KINDS], axis=1)
    step = np.spacing(8 * offset)
    coefficients = np.round(coefficients / step) * step
    moved = coefficients + offset
    np.testing.assert_array_equal(moved - offset, coefficients)
    cube = meshes.to_polygon_mesh(meshes.cube())
    allowance = rounding_allowance(cube) / np.abs(cube.positions).max() * np.abs(moved).max()
    for pattern, alternative in CHOICES:
        there, here = (bounds_of(each, pattern, alternative) for each in (moved, coefficients))
        assert np.all(there + allowance >= here)
