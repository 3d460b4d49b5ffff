# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of the method Sharp: never below what some net reaches, and never more than 1 % above it.

A constant is the largest value of some functionals c·V over all nets with |DV| ≤ 1, D being the second differences: a
linear program for each, solved here for the net itself, apart from the certificates of ``proofs``.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import (
    PATCH_METHODS,
    Method,
    PatchBounds,
    Vertices,
    second_order_extraordinary,
    second_order_regular,
    sharp_extraordinary,
)
from ccdepth_addon.core.bounds.sharp_constants import CONTROL_FACTORS, LIMIT_FACTORS, PERIOD, RATES
from ccdepth_addon.core.depth.face_depths import face_depths
from ccdepth_addon.core.surface.patches import extraordinary_nets
from ccdepth_addon.core.surface.sharpness import apply_boundary_rule
from proofs.certify_sharp_constants import sharp_constants
from tests import meshes, nets
from tests.linear_programs import PROGRAM_TOLERANCE, worst_of

FACTORS = {"CONTROL": CONTROL_FACTORS, "LIMIT": LIMIT_FACTORS}
LEVELS = range(len(CONTROL_FACTORS[3]))
SAMPLES = 4

every_kind_of_vertices = pytest.mark.parametrize("vertices", ["CONTROL", "LIMIT"])


@cache
def step(valence: int) -> FloatArray:
    """(2n + 8, 2n + 8): from a net to that of the child at its extraordinary vertex."""
    fine = nets.refined(nets.net_mesh(np.eye(2 * valence + 8)), 1)
    return extraordinary_nets(fine, np.array([0]), valence)[:, 0]


@cache
def facet_stencils(valence: int, vertices: str) -> FloatArray:
    """(samples, 2n + 8): L - S on face 0, where u ≥ v; what lies beyond the diagonal is its mirror image."""
    mesh, face = nets.net_mesh(np.eye(2 * valence + 8)), np.array([0])
    facet = nets.facet_grids(mesh, face, 0, vertices, SAMPLES)[0]
    offsets = facet - nets.limit_grids(mesh, face, SAMPLES)[0]
    offsets = offsets[np.tril_indices(len(offsets))]
    return offsets[np.abs(offsets).max(axis=1) > 1e-12]


def worst_at_level(valence: int, vertices: str, level: int) -> tuple[float, FloatArray]:
    """The largest ‖Lᵏ - S‖ sampled on the level-k facet at the extraordinary vertex, over all nets with M ≤ 1."""
    functionals = facet_stencils(valence, vertices) @ np.linalg.matrix_power(step(valence), level)
    return worst_of(functionals, nets.difference_matrix(valence))


def bounds_of(valence: int, norm: float, vertices: str) -> PatchBounds:
    """Sharp's bounds for a net of that norm."""
    net = np.zeros((2 * valence + 8, 1, 3))
    net[2 * valence + 1, 0, 0] = norm
    return sharp_extraordinary(net, Vertices(vertices))


def sharp_depth(valence: int, norm: float, tolerance: float) -> int:
    bounds = bounds_of(valence, norm, "CONTROL")
    return next(level for level in range(100) if bounds.at(level)[0] <= tolerance)


# The rates


@pytest.mark.parametrize(
    ("valence", "rates"),
    [
        (3, (0.6667, 0.2917, 0.1224, 0.0506)),
        (5, (0.7200, 0.4016, 0.2225, 0.1233)),
        (6, (0.7500, 0.4688, 0.2793, 0.1637)),
        (7, (0.8010, 0.5121, 0.3145, 0.1896)),
        (8, (0.7500, 0.4844, 0.3027, 0.1871)),
        (10, (0.8300, 0.5598, 0.3575, 0.2239)),
        (12, (0.8056, 0.5492, 0.3602, 0.2331)),
    ],
)
def test_rates_over_several_levels(valence: int, rates: tuple[float, ...]) -> None:
    differences = nets.difference_matrix(valence)
    for levels, rate in enumerate(rates, start=1):
        growth = worst_of(differences @ np.linalg.matrix_power(step(valence), levels), differences)[0]
        assert growth == pytest.approx(rate, abs=5.001e-5)


@pytest.mark.parametrize("valence", [3, 5, 8, 17, 64])
def test_tabled_rates_are_the_least(valence: int) -> None:
    differences = nets.difference_matrix(valence)
    growth = worst_of(differences @ np.linalg.matrix_power(step(valence), PERIOD), differences)[0]
    assert growth <= RATES[valence] * (1 + PROGRAM_TOLERANCE)
    assert RATES[valence] == pytest.approx(growth, rel=2e-4)


# The factors


@pytest.mark.parametrize(
    ("valence", "figures"),
    [
        (3, (0.3750, 0.0926, 0.0257, 0.0115, 0.0049)),
        (5, (0.3333, 0.1000, 0.0398, 0.0218, 0.0120)),
        (6, (0.3333, 0.1061, 0.0458, 0.0270, 0.0158)),
        (8, (0.3333, 0.1058, 0.0479, 0.0296)),
    ],
)
def test_figures_found_by_sampling(valence: int, figures: tuple[float, ...]) -> None:
    for factor, figure in zip(CONTROL_FACTORS[valence], figures, strict=False):
        assert figure - 5e-5 <= factor <= 1.005 * figure


def test_facets_themselves() -> None:
    """3/8 at valence 3 and 1/3 elsewhere, the corners' way to the limit; limit vertices have less than 1/4 but at 3."""
    assert CONTROL_FACTORS[3][0] == pytest.approx(3 / 8, abs=1.01e-5)
    assert [row[0] for row in CONTROL_FACTORS.values()][1:] == pytest.approx([1 / 3] * (len(RATES) - 1), abs=1.01e-5)
    assert 0.25814 < LIMIT_FACTORS[3][0] <= 0.25815 < 7 / 27
    assert max(row[0] for valence, row in LIMIT_FACTORS.items() if valence > 3) < 1 / 4


@pytest.mark.parametrize("valence", [3, 5, 6, 9, 64])
@every_kind_of_vertices
def test_factors_are_the_least(valence: int, vertices: str) -> None:
    for level in LEVELS:
        found = worst_at_level(valence, vertices, level)[0]
        if vertices == "CONTROL":
            # The regular corner opposite goes M/3 · 4⁻ᵏ to its limit, on a net whose differences are all equal.
            found = max(found, 4.0**-level / 3)
        factor = FACTORS[vertices][valence][level]
        assert 0.99 * factor <= found <= factor * (1 + PROGRAM_TOLERANCE)


@pytest.mark.parametrize("valence", [3, 5, 6, 7, 8, 12])
@pytest.mark.parametrize("level", [0, 1, 2])
@every_kind_of_vertices
def test_bad_nets_come_within_one_percent(valence: int, level: int, vertices: str) -> None:
    """The worst net, subdivided: the largest distance sampled on the whole face."""
    heights = worst_at_level(valence, vertices, level)[1]
    net = np.stack([np.zeros_like(heights), np.zeros_like(heights), heights], axis=1)
    bound = sharp_extraordinary(net[:, None], Vertices(vertices)).at(level)[0]
    distance = nets.largest_distances(nets.net_mesh(net), np.array([0]), level, vertices, level + SAMPLES)[0]
    assert 0.99 * bound <= distance <= bound


@pytest.mark.parametrize("valence", [3, 5, 8, 12])
@every_kind_of_vertices
def test_bad_nets_stay_within_the_tail(valence: int, vertices: str) -> None:
    """Beyond the table, where the factors recur."""
    for level in (LEVELS[-1] + 1, LEVELS[-1] + 5, LEVELS[-1] + PERIOD + 1):
        found = worst_at_level(valence, vertices, level)[0]
        assert 0.3 * bounds_of(valence, 1, vertices).at(level)[0] < found < bounds_of(valence, 1, vertices).at(level)[0]


@pytest.mark.parametrize("valence", [3, 5])
def test_program_makes_the_tables(valence: int) -> None:
    made = sharp_constants(valence)
    for vertices, factors in made.factors.items():
        assert FACTORS[vertices][valence] == pytest.approx(factors, rel=1e-4)
        assert made.reached[vertices] == pytest.approx(factors, rel=5e-4)
        assert np.all(np.array(made.reached[vertices]) <= factors)
    assert RATES[valence] == pytest.approx(made.rate, rel=1e-4)


# The method


def test_every_valence_of_the_tables_has_all_it_needs() -> None:
    valences = [3, *range(5, max(RATES) + 1)]
    assert max(RATES) >= 64
    assert list(RATES) == list(CONTROL_FACTORS) == list(LIMIT_FACTORS) == valences
    assert all(len(row) == len(LEVELS) for table in FACTORS.values() for row in table.values())


@every_kind_of_vertices
def test_bounds_fall_with_every_level_and_lie_below_the_published(vertices: str) -> None:
    """Where the factors begin to recur a bound can be a little above the one before, never above the last but one."""
    for valence in RATES:
        sharp = bounds_of(valence, 1, vertices)
        net = np.zeros((2 * valence + 8, 1, 3))
        net[2 * valence + 1, 0, 0] = 1
        published = second_order_extraordinary(net, Vertices(vertices))
        bounds = np.array([sharp.at(level)[0] for level in range(40)])
        assert np.all(np.diff(bounds[: len(LEVELS)]) < 0)
        assert np.all(bounds[1:] < 1.09 * bounds[:-1])
        assert np.all(bounds[2:] < bounds[:-2])
        assert np.all(bounds < [published.at(level)[0] for level in range(40)])


def test_factors_recur_beyond_the_last() -> None:
    bounds = PatchBounds(np.array([2.0]), rate=0.5, factors=(7.0, 4.0, 3.0), period=2)
    assert [bounds.at(level)[0] for level in range(8)] == [14, 8, 6, 4, 3, 2, 1.5, 1]


def test_published_constants_beyond_the_tables() -> None:
    valence = max(RATES) + 1
    net = np.random.default_rng(1).normal(size=(2 * valence + 8, 3, 3))
    for vertices in Vertices:
        sharp, published = sharp_extraordinary(net, vertices), second_order_extraordinary(net, vertices)
        for level in range(5):
            np.testing.assert_array_equal(sharp.at(level), published.at(level))


def test_regular_patches_have_the_published_bounds() -> None:
    """They are reached (``test_norm_bounds``)."""
    assert PATCH_METHODS[Method.SHARP].regular is second_order_regular


@pytest.mark.parametrize(
    ("valence", "norm", "published", "sharp"),
    [(3, 0.16, (2, 7, 13, 19), (0, 2, 4, 7)), (5, 0.81 * 25 / 18, (7, 14, 21, 28), (2, 5, 9, 13))],
)
def test_printed_examples(valence: int, norm: float, published: tuple[int, ...], sharp: tuple[int, ...]) -> None:
    tolerances = (0.1, 0.01, 0.001, 0.0001)
    assert tuple(nets.published_depth(valence, norm, tolerance) for tolerance in tolerances) == published
    assert tuple(sharp_depth(valence, norm, tolerance) for tolerance in tolerances) == sharp


@every_kind_of_vertices
@pytest.mark.parametrize("valence", [3, 5, 7, 12])
def test_depths_lie_between_certified_and_published(valence: int, vertices: str) -> None:
    data = meshes.bumpy(meshes.trapezohedron(valence), 0.2)
    mesh = nets.refined(apply_boundary_rule(meshes.to_polygon_mesh(data), smooth_corners=True), 1)
    spared = 0
    for tolerance in (0.1, 0.01, 0.001):
        certified, sharp, published = (
            face_depths(mesh, tolerance, method, vertices).depths for method in ("CERTIFIED", "SHARP", "SECOND_ORDER")
        )
        assert np.all(certified <= sharp)
        assert np.all(sharp <= published)
        spared += np.sum(published - sharp)
    assert spared > 0
