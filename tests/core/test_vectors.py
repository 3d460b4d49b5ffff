# SPDX-License-Identifier: GPL-3.0-or-later
"""Operations on arrays of vectors against numpy's own, in either memory layout."""

from __future__ import annotations

import numpy as np

from ccdepth_addon.core.arrays.vectors import (
    cross_products,
    dot_products,
    selected_vectors,
    squared_dots,
    squared_norms,
    sums_by_index,
    transformed_nets,
)

# Sums of a few products of numbers below 1, each rounded by 2⁻⁵³ of it at most.
ROUNDING = 2.0**-49


def component_major(vectors: np.ndarray) -> np.ndarray:
    """The same vectors, lying in memory as (…, 3, P)."""
    return np.ascontiguousarray(vectors.swapaxes(-1, -2)).swapaxes(-1, -2)


def nets(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((5, 7, 3))


def test_results_do_not_depend_on_the_layout() -> None:
    a, b, indices = nets(1), nets(2), np.array([6, 0, 0, 3])
    for one, other in ((a, b), (component_major(a), component_major(b)), (component_major(a), b)):
        np.testing.assert_array_equal(one, a)
        np.testing.assert_array_equal(selected_vectors(one, indices), a[:, indices])
        np.testing.assert_allclose(cross_products(one, other), np.cross(a, b), rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(dot_products(one, other), (a * b).sum(axis=2), rtol=ROUNDING)
        np.testing.assert_allclose(squared_norms(one), (a * a).sum(axis=2), rtol=ROUNDING)
        np.testing.assert_allclose(squared_dots(one, other[0]), (a * b[0]).sum(axis=2) ** 2, rtol=2 * ROUNDING)


def test_transformed_nets_are_combinations_of_their_points() -> None:
    a, matrix = nets(3), np.random.default_rng(4).random((4, 5))
    for one in (a, component_major(a)):
        np.testing.assert_allclose(transformed_nets(matrix, one), np.einsum("rn,npi->rpi", matrix, a), rtol=ROUNDING)


def test_the_layout_is_kept() -> None:
    """Results stay component-major, as the module promises: what follows would be slower otherwise."""
    a = component_major(nets(5))
    results = [a + a, selected_vectors(a, np.array([1, 4])), transformed_nets(np.ones((2, 5)), a), cross_products(a, a)]
    for vectors in results:
        assert vectors.swapaxes(1, 2).flags.c_contiguous


def test_sums_by_index() -> None:
    vectors = np.arange(12.0).reshape(4, 3)
    found = sums_by_index(np.array([2, 0, 2, 2]), vectors, 4)
    np.testing.assert_array_equal(found, [vectors[1], np.zeros(3), vectors[0] + vectors[2] + vectors[3], np.zeros(3)])
