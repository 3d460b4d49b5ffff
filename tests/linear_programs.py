# SPDX-License-Identifier: GPL-3.0-or-later
"""The largest values of functionals c·V over all V with |DV| ≤ 1, D being differences: a linear program for each."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray

# What HiGHS leaves unsatisfied of a constraint, relative to coefficients of about 1.
PROGRAM_TOLERANCE = 1e-7

# How far functionals may be from what the differences make of them, by rounding.
ROUNDING = 1e-9


def worst_of(functionals: FloatArray, differences: FloatArray) -> tuple[float, FloatArray]:
    """The largest value over many functionals, (…, D), and a net that has it.

    Least squares gives weights y with Dᵀy = c, and Σ|y| is at least the largest c·V: once it is below the largest value
    found so far, that row and all the following need no program.
    """
    rows = functionals.reshape(-1, functionals.shape[-1])
    rows = rows[np.abs(rows).max(axis=1) > 1e-12]
    # Functionals that are the same but for rounding are solved once.
    rows = rows[np.unique(np.round(rows, 12), axis=0, return_index=True)[1]]
    weights = rows @ np.linalg.pinv(differences.T, rcond=1e-10).T
    size = max(1.0, np.abs(rows).max(initial=0.0))
    assert np.all(np.abs(weights @ differences - rows) <= ROUNDING * size), "not made of the differences"
    most = np.abs(weights).sum(axis=1)
    both_signs = np.vstack([differences, -differences])
    found, net = 0.0, np.zeros(rows.shape[1])
    for row in np.argsort(-most):
        if most[row] <= found:
            break
        scale = np.abs(rows[row]).max()
        solution = linprog(-rows[row] / scale, A_ub=both_signs, b_ub=np.ones(len(both_signs)), bounds=(None, None))
        assert solution.status == 0, "the functional is not made of the differences"
        if -scale * solution.fun > found:
            found, net = -scale * solution.fun, solution.x
    return found, net


def largest_of(functionals: FloatArray, differences: FloatArray) -> float:
    """The largest value over many functionals, (…, D)."""
    return worst_of(functionals, differences)[0]
