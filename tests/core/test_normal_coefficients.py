# SPDX-License-Identifier: GPL-3.0-or-later
"""Bounds of angles over pieces of the surface, against dense samples of the pieces' own formulas."""

from math import comb

import numpy as np
import pytest
from numpy.typing import NDArray

from ccdepth_addon.core.surface.normal_coefficients import grid_of, largest_angles, linear_grid, normal_grid
from ccdepth_addon.core.surface.triangle_coefficients import bicubic_basis, coefficients_over

STEPS = 25
SQUARE = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, STEPS)], indexing="ij"), axis=-1).reshape(-1, 2)
TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.25, 1.0]])


def patches(count: int, seed: int) -> NDArray:
    """(16, 3, P): sheets over a square, bent and uneven."""
    generator = np.random.default_rng(seed)
    places = np.array([(i / 3, j / 3, 0.0) for i in range(4) for j in range(4)])
    return places[:, :, None] + generator.normal(0.0, 0.06, (16, 3, count))


def derivatives(points: NDArray) -> tuple[NDArray, NDArray]:
    """(N, 16) twice: those of the basis, from differences of the basis of lower degree."""

    def lower(t: NDArray, degree: int) -> NDArray:
        return np.stack([comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)], axis=1)

    found = []
    for axis in (0, 1):
        t, s = points[:, axis], points[:, 1 - axis]
        slope = 3 * (np.pad(lower(t, 2), ((0, 0), (1, 0))) - np.pad(lower(t, 2), ((0, 0), (0, 1))))
        pair = (slope, lower(s, 3)) if axis == 0 else (lower(s, 3), slope)
        found.append(np.einsum("ni,nj->nij", *pair).reshape(-1, 16))
    return found[0], found[1]


def normals_at(nets: NDArray, points: NDArray) -> NDArray:
    """(N, 3, P)."""
    along, across = (np.einsum("ni,icp->ncp", each, nets) for each in derivatives(points))
    return np.cross(along, across, axis=1)


def angles_between(a: NDArray, b: NDArray) -> NDArray:
    cosines = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    return np.arccos(np.clip(cosines, -1, 1))


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("triangle", [True, False])
def test_bounds_are_above_all_samples_and_near_them(triangle: bool, linear: bool) -> None:
    nets = patches(200, seed=1)
    corners = np.random.default_rng(2).normal([[0.0], [0.0], [1.0]], 0.15, (4, 3, 200))
    if triangle:
        weights = SQUARE[SQUARE.sum(axis=1) <= 1 + 1e-12]
        weights = np.column_stack([1 - weights.sum(axis=1), weights])
        points, coefficients = weights @ TRIANGLE, np.einsum("ri,icp->rcp", coefficients_over(TRIANGLE), nets)
        drawn = np.einsum("nk,kcp->ncp", weights, corners[:3])
        directions = linear_grid(corners[:3])
    else:
        u, v = SQUARE.T
        weights = np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)
        points, coefficients, directions = SQUARE, nets, linear_grid(corners)
        drawn = np.einsum("nk,kcp->ncp", weights, corners)
    if not linear:
        # A polynomial of the degree of the surface.
        others = np.random.default_rng(3).normal([[0.0], [0.0], [1.0]], 0.05, (16, 3, 200))
        drawn = np.einsum("ni,icp->ncp", bicubic_basis(points), others)
        over = coefficients_over(TRIANGLE) if triangle else np.eye(16)
        directions = grid_of(np.einsum("ri,icp->rcp", over, others))
    bounds, reached = largest_angles(normal_grid(coefficients), directions, triangle=triangle)
    truth = angles_between(normals_at(nets, points), drawn).max(axis=0)
    # Computed in other ways, both are off by roundings of small angles.
    assert (bounds >= truth - 1e-7).all()
    # An angle beyond a right angle is told as π.
    assert (reached <= np.where(truth < np.pi / 2, truth, np.pi) + 1e-7).all()
    # Coefficients of degrees up to 16 exceed the polynomials by a part that quarters would remove.
    assert np.median(bounds / truth) < 1.5


def test_nothing_is_proved_where_normals_turn_over() -> None:
    nets = patches(1, seed=1)
    nets[:, 0] = np.repeat([0.0, 1.5, -0.5, 1.0], 4)[:, None]
    bounds, _ = largest_angles(
        normal_grid(nets), linear_grid(np.tile([[0.0], [0.0], [1.0]], (4, 1, 1))), triangle=False
    )
    assert bounds[0] > np.pi / 2


def test_points_without_a_normal_do_not_count() -> None:
    flat = np.array([(i / 3, j / 3, 0.0) for i in range(4) for j in range(4)])[:, :, None]
    flat[:4] = flat[0]
    bounds, _ = largest_angles(
        normal_grid(flat), linear_grid(np.tile([[0.0], [0.0], [1.0]], (4, 1, 1))), triangle=False
    )
    assert bounds[0] < 1e-9
