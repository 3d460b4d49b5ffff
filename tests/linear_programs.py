# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest values of functionals c·V over all V with |DV| ≤ 1, D being differences: a linear program for each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray

# What HiGHS leaves unsatisfied of a constraint, relative to coefficients of about 1.
PROGRAM_TOLERANCE = 1e-7

# How far functionals may be from what the differences make of them, by rounding.
ROUNDING = 1e-9


def largest(functional: FloatArray, differences: FloatArray) -> float:
    """The largest c·V: the least Σ|y| with Dᵀy = c, by duality."""
    count = len(differences)
    weights = np.hstack([differences.T, -differences.T])
    solution = linprog(np.ones(2 * count), A_eq=weights, b_eq=functional, bounds=(0, None))
    assert solution.status == 0, "the functional is not made of the differences"
    return float(solution.fun)


def worst_net(functional: FloatArray, differences: FloatArray) -> tuple[float, FloatArray]:
    """The largest c·V, and that V."""
    both_signs = np.vstack([differences, -differences])
    scale = np.abs(functional).max()
    solution = linprog(-functional / scale, A_ub=both_signs, b_ub=np.ones(len(both_signs)), bounds=(None, None))
    assert solution.status == 0, "the functional is not made of the differences"
    return -scale * solution.fun, solution.x


def largest_of(functionals: FloatArray, differences: FloatArray) -> float:
    """The largest over many functionals, (…, D); those that are the same but for rounding are solved once."""
    rows = functionals.reshape(-1, functionals.shape[-1])
    rows = rows[np.abs(rows).max(axis=1) > 1e-12]
    rows = rows[np.unique(np.round(rows, 12), axis=0, return_index=True)[1]]
    found = 0.0
    for row, most in _from_the_most(rows, differences):
        if most <= found:
            break
        found = max(found, largest(rows[row], differences))
    return found


def worst_of(functionals: FloatArray, differences: FloatArray) -> tuple[float, FloatArray]:
    """The largest over many functionals, (rows, D), and its net."""
    found, net = 0.0, np.zeros(functionals.shape[-1])
    for row, most in _from_the_most(functionals, differences):
        if most <= found:
            break
        value, worst = worst_net(functionals[row], differences)
        if value > found:
            found, net = value, worst
    return found, net


def _from_the_most(functionals: FloatArray, differences: FloatArray) -> Iterator[tuple[int, float]]:
    """Rows and what each can be at most, the largest first.

    Least squares gives weights y with Dᵀy = c, and Σ|y| is at least what the program for c finds: once it is below the
    largest found so far, that row and all the following need no program.
    """
    weights = functionals @ np.linalg.pinv(differences.T, rcond=1e-10).T
    size = max(1.0, np.abs(functionals).max(initial=0.0))
    assert np.all(np.abs(weights @ differences - functionals) <= ROUNDING * size), "not made of the differences"
    most = np.abs(weights).sum(axis=1)
    for row in np.argsort(-most).tolist():
        yield row, float(most[row])
