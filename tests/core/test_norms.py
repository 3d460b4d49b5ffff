# SPDX-License-Identifier: GPL-3.0-or-later
"""The norms of control nets against the differences they are defined by, one by one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ccdepth_addon.core.bounds.norms import (
    first_order_norm_extraordinary,
    first_order_norm_regular,
    second_differences,
    second_order_norm_extraordinary,
    second_order_norm_regular,
)
from tests import nets

VALENCES = (3, 5, 6, 7, 8, 12, 64)

every_valence = pytest.mark.parametrize("valence", VALENCES)


def random_net(*shape: int) -> np.ndarray:
    return np.random.default_rng(sum(shape)).normal(size=shape)


def length(vector: np.ndarray) -> float:
    return float(np.sqrt(sum(x * x for x in vector.tolist())))


def test_second_order_norm_of_regular_nets() -> None:
    net = random_net(4, 4, 50, 3)
    assert len(set(nets.listed_regular_differences())) == 16
    for patch, found in enumerate(second_order_norm_regular(net)):
        v = net[:, :, patch]
        expected = max(length(2 * v[a] - v[b] - v[c]) for a, b, c in nets.listed_regular_differences())
        assert found == pytest.approx(expected, rel=1e-14)


@every_valence
def test_second_order_norm_of_extraordinary_nets(valence: int) -> None:
    net = random_net(2 * valence + 8, 20, 3)
    for patch, found in enumerate(second_order_norm_extraordinary(net)):
        v = {number: net[number - 1, patch] for number in range(1, 2 * valence + 9)}
        expected = max(length(2 * v[a] - v[b] - v[c]) for a, b, c in nets.listed_differences(valence))
        assert found == pytest.approx(expected, rel=1e-14)


@every_valence
def test_every_listed_difference_is_in_the_norm(valence: int) -> None:
    """Random nets do not reach each of the 2n + 10 as the largest, so the list itself is compared too."""
    listed = nets.listed_differences(valence)
    assert len(set(listed)) == len(listed) == 2 * valence + 10
    core = [(a + 1, *sorted((b + 1, c + 1))) for a, b, c in second_differences(valence).T.tolist()]
    assert sorted(core) == sorted((a, *sorted((b, c))) for a, b, c in listed)


def test_differences_of_valence_four_are_those_of_the_regular_net() -> None:
    """At valence 4 the list has the two differences across V₁ twice, and is otherwise the 16 of a 4×4 net."""
    assert len({(a, *sorted((b, c))) for a, b, c in nets.listed_differences(4)}) == 16


@every_valence
def test_first_order_norm_of_extraordinary_nets(valence: int) -> None:
    net = random_net(2 * valence + 8, 20, 3)
    edges = nets.net_edges(valence)
    assert len(edges) == 3 * valence + 12
    for patch, found in enumerate(first_order_norm_extraordinary(net)):
        expected = max(length(net[a, patch] - net[b, patch]) for a, b in edges)
        assert found == pytest.approx(expected, rel=1e-14)


def test_first_order_norm_of_regular_nets() -> None:
    net = random_net(4, 4, 50, 3)
    for patch, found in enumerate(first_order_norm_regular(net)):
        v = net[:, :, patch]
        along_i = [v[i + 1, j] - v[i, j] for i in range(3) for j in range(4)]
        along_j = [v[i, j + 1] - v[i, j] for i in range(4) for j in range(3)]
        assert found == pytest.approx(max(map(length, along_i + along_j)), rel=1e-14)


@every_valence
def test_second_order_norm_is_at_most_twice_the_first(valence: int) -> None:
    net = random_net(2 * valence + 8, 200, 3)
    assert np.all(second_order_norm_extraordinary(net) <= 2 * first_order_norm_extraordinary(net))


@pytest.mark.parametrize(
    ("norm", "shape"),
    [
        (second_order_norm_regular, (4, 4, 10, 3)),
        (first_order_norm_regular, (4, 4, 10, 3)),
        (second_order_norm_extraordinary, (18, 10, 3)),
        (first_order_norm_extraordinary, (18, 10, 3)),
    ],
)
def test_norms_of_moved_turned_and_scaled_nets(norm: Callable[..., np.ndarray], shape: tuple[int, ...]) -> None:
    net = random_net(*shape)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    np.testing.assert_allclose(norm(-3 * net @ turn + [5.0, -2.0, 1.0]), 3 * norm(net), rtol=1e-13)


@pytest.mark.parametrize("valence", [3, 5, 8])
def test_coinciding_points_have_norm_zero(valence: int) -> None:
    net = np.ones((2 * valence + 8, 4, 3))
    assert np.all(second_order_norm_extraordinary(net) == 0)
    assert np.all(first_order_norm_extraordinary(net) == 0)
