# SPDX-License-Identifier: GPL-3.0-or-later
"""Products in blocks, and vectors with their coordinates apart."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.arrays.coordinates import applied, chosen_vectors, coordinates_apart
from ccdepth_addon.core.arrays.matrix_products import COLUMNS_AT_ONCE, product
from ccdepth_addon.core.arrays.vectors import cross_products, squared_norms

# Sums of at most 2¹⁸ positive numbers, each rounded by 2⁻⁵³ of the sum at most, in another order.
ROUNDING = 2.0**-34


@pytest.mark.parametrize(
    ("rows", "size", "columns"),
    [
        (1, 1, 1),
        (9, 16, 24576),
        (50, 16, 100),
        (3908, 20, 7),
        (3908, 728, 70),
        (1, 1 << 18, 3),
        (2, 0, 4),
        (0, 3, 5),
        (5, 3, 0),
        (2, 3, 2 * COLUMNS_AT_ONCE + 1),
    ],
)
def test_products_are_those_of_the_whole(rows: int, size: int, columns: int) -> None:
    generator = np.random.default_rng(rows + size + columns)
    matrix, right = generator.random((rows, size)), generator.random((size, columns))
    np.testing.assert_allclose(product(matrix, right), matrix @ right, rtol=ROUNDING)


def test_vectors_are_the_same_with_their_coordinates_apart() -> None:
    generator = np.random.default_rng(1)
    nets, others, matrix = generator.random((5, 7, 3)), generator.random((5, 7, 3)), generator.random((4, 5))
    chosen = np.array([6, 0, 0, 3])
    apart = coordinates_apart(nets)
    np.testing.assert_array_equal(apart, nets)
    np.testing.assert_array_equal(chosen_vectors(apart, chosen), nets[:, chosen])
    np.testing.assert_array_equal(chosen_vectors(nets, chosen), nets[:, chosen])
    np.testing.assert_allclose(applied(matrix, apart), np.einsum("rn,npi->rpi", matrix, nets), rtol=ROUNDING)
    np.testing.assert_array_equal(cross_products(apart, coordinates_apart(others)), cross_products(nets, others))
    np.testing.assert_array_equal(squared_norms(apart), squared_norms(nets))


def test_coordinates_stay_apart() -> None:
    """Or it would take longer than it needs."""
    nets = coordinates_apart(np.random.default_rng(2).random((5, 7, 3)))
    made = [
        nets + nets,
        chosen_vectors(nets, np.array([1, 4])),
        applied(np.ones((2, 5)), nets),
        cross_products(nets, nets),
        np.concatenate([nets, nets], axis=1),
    ]
    for vectors in made:
        assert vectors.swapaxes(1, 2).flags.c_contiguous
