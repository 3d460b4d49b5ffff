# SPDX-License-Identifier: GPL-3.0-or-later
"""Matrix products: exact where the numbers are, the same bits for a column whatever stands beside it."""

from __future__ import annotations

import numpy as np
import pytest

from ccdepth_addon.core.arrays.matrix_products import COLUMNS_AT_ONCE, matrix_product

pytestmark = pytest.mark.thorough

SHAPES = [
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
]


@pytest.mark.parametrize(("rows", "size", "columns"), SHAPES)
def test_products_of_whole_numbers_are_exact(rows: int, size: int, columns: int) -> None:
    """Sums of 2¹⁸ products below 2¹⁴ stay below 2⁵³, so that no order of summation rounds."""
    generator = np.random.default_rng(rows + size + columns)
    matrix, right = generator.integers(-127, 128, (rows, size)), generator.integers(-127, 128, (size, columns))
    found = matrix_product(matrix.astype(np.float64), right.astype(np.float64))
    np.testing.assert_array_equal(found, matrix @ right)


@pytest.mark.parametrize("first", [0, 3, COLUMNS_AT_ONCE - 2])
def test_a_column_has_the_same_bits_among_others(first: int) -> None:
    generator = np.random.default_rng(first)
    matrix, right = generator.random((5, 16)), generator.random((16, COLUMNS_AT_ONCE + 9))
    whole = matrix_product(matrix, right)
    part = matrix_product(matrix, np.ascontiguousarray(right[:, first : first + 8]))
    np.testing.assert_array_equal(part, whole[:, first : first + 8])
