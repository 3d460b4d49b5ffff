# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances to thin triangles against rational numbers: what Measure Deviation reaches is really there."""

from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ccdepth_addon.core.deviation import measure_deviation
from ccdepth_addon.core.deviation.findings import TOO_LONG
from ccdepth_addon.core.deviation.triangles import NEEDLE, distance_slack, to_triangles
from tests import meshes

# Roundings of the largest coordinate, which the allowance for a whole measurement covers a thousand times.
ROUNDINGS = 16 * 2.0**-53


def from_plane(place: np.ndarray, corners: np.ndarray) -> tuple[float, bool]:
    """The distance of a place (3,) from the plane of a triangle (3, 3), and whether its foot is inside."""
    *triangle, p = np.vectorize(Fraction, otypes=[object])(np.vstack([corners, place]))
    sides = [triangle[i - 2] - triangle[i] for i in range(3)]
    normal = np.cross(sides[0], sides[1])
    inside = all(np.cross(side, p - start) @ normal >= 0 for start, side in zip(triangle, sides, strict=True))
    squared = ((p - triangle[0]) @ normal) ** 2 / (normal @ normal)
    with localcontext(prec=60):
        return float((Decimal(squared.numerator) / Decimal(squared.denominator)).sqrt()), inside


def thin_triangles(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(count, 3) places over triangles (count, 3, 3), of all heights down to a needle's and at all distances."""
    random = np.random.default_rng(seed)
    turns = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    flat = np.zeros((count, 3, 3))
    flat[:, 1, 0] = 10 ** random.uniform(-3, 0, count)
    flat[:, 2, 0] = random.uniform(0, 1, count) * flat[:, 1, 0]
    flat[:, 2, 1] = NEEDLE * 10 ** random.uniform(0.01, 1, count) * flat[:, 1, 0]
    flat = np.take_along_axis(flat, random.permuted(np.tile(np.arange(3), (count, 1)), axis=1)[:, :, None], axis=1)
    shares = random.dirichlet(np.ones(3), count)
    feet = np.einsum("ns,nsi->ni", shares, flat)
    feet[:, 2] = random.choice([0.0, 1.0], count) * 10 ** random.uniform(-12, 0, count)
    origin = random.uniform(-1, 1, (count, 3))
    return (np.einsum("nij,nj->ni", turns, feet) + origin, np.einsum("nij,nkj->nki", turns, flat) + origin[:, None])


@given(st.integers(0, 2**32))
def test_distances_are_not_too_long(seed: int) -> None:
    places, corners = thin_triangles(seed, 40)
    found = to_triangles(places.T, corners.transpose(1, 2, 0))[0]
    slack = distance_slack(corners.swapaxes(0, 1))
    for place, triangle, distance, allowed in zip(places, corners, found, slack, strict=True):
        true, inside = from_plane(place, triangle)
        if inside:
            assert distance * (1 - TOO_LONG) - allowed <= true + ROUNDINGS * max(1.0, np.abs(triangle).max())


@given(st.integers(0, 2**32))
def test_nothing_is_reached_where_nothing_is_off(seed: int) -> None:
    """A flat square, turned, and six triangles that cover it."""
    random = np.random.default_rng(seed)
    low, high = NEEDLE * random.uniform(1, 2) * np.array([1, 1 + 10 ** random.uniform(0, 1)])
    corners = [[0, 0], [1, 0], [1, 1], [0, 1], [random.uniform(0.2, 0.8), low], [random.uniform(0.2, 0.8), high]]
    flat = np.column_stack([corners, np.zeros(6)])
    points = flat @ np.linalg.qr(random.normal(size=(3, 3)))[0].T
    square = meshes.from_faces(points[:4], [[0, 1, 2, 3]])
    edges = {(0, 1): 1.0, (1, 2): 1.0, (2, 3): 1.0, (0, 3): 1.0}
    square = meshes.creased(square, edges, dict.fromkeys(range(4), 1.0))
    triangles = np.array([[0, 1, 4], [1, 5, 4], [1, 2, 5], [2, 3, 5], [3, 0, 5], [0, 4, 5]])
    assert measure_deviation(meshes.build(square), points, triangles, max_pieces=2000).reached <= ROUNDINGS
