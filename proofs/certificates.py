# SPDX-License-Identifier: GPL-3.0-or-later
"""Certificates for constants of extraordinary patches (needs scipy).

Every point of a facet, of a refined net and of the surface is a linear functional c of the net. A functional that
vanishes on every net without second differences is c = Dᵀy for some y, D being the matrix of the 2n + 10 second
differences; then ‖c·V‖ = ‖y·(DV)‖ ≤ ‖y‖₁ · M. A small ‖y‖₁ is a certificate that anybody can check: least squares gives
one at once, and linear programming the least, equal to the largest c·V of all nets with M ≤ 1.

The facet without its extraordinary corner is tiled by the regular patches of every level; on each tile the surface and
the facet are bicubic, so their distance there is at most the largest Bernstein coefficient of their difference, on the
tile or on the pieces it is split into.

Functionals are rows over the net's 2n + 8 points; Bernstein blocks of them are (pieces, 4, 4, 2n + 8).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norms import second_differences
from ccdepth_addon.core.mesh.polygon_mesh import PolygonMesh
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.bicubic import HALVES, SPLINE_TO_BERNSTEIN, bilinear_coefficients
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import regular_nets

# More than double precision can lose in a certificate, as checked for each; far below the margins.
ROUNDING = 1e-10

# Singular values of D below this part of the largest are zero: the others are above 1/n of it.
RANK_TOLERANCE = 1e-10

# The number of solved programs remembered, to bound further functionals without solving theirs.
REMEMBERED = 32

# Children 1 and 2 of the facet (3 mirrors 1): their corners in the parent's parameters, in the child's own order.
TILES = {1: ((1, 0), (1, 0.5), (0.5, 0.5), (0.5, 0)), 2: ((1, 1), (0.5, 1), (0.5, 0.5), (1, 0.5))}


class NotCertifiedError(Exception):
    """The error of a claim without a certificate; the claim may still be true."""


def difference_matrix(valence: int) -> FloatArray:
    """D, the matrix of second differences: (2n + 10, 2n + 8)."""
    rows = second_differences(valence).T
    differences = np.zeros((len(rows), 2 * valence + 8))
    for row, (a, b, c) in enumerate(rows):
        np.add.at(differences[row], [a, b, c], [2, -1, -1])
    return differences


@dataclass
class _Solved:
    """Solved programs: the least-squares weights of each functional, the addition to them, the distance of the addition
    from changing no functional (`Certifier._off`), and the worst net."""

    weights: list[FloatArray] = field(default_factory=list)
    additions: list[FloatArray] = field(default_factory=list)
    off: list[float] = field(default_factory=list)
    nets: list[FloatArray] = field(default_factory=list)

    def add(self, weights: FloatArray, addition: FloatArray, off: float, net: FloatArray) -> None:
        new = ((self.weights, weights), (self.additions, addition), (self.off, off), (self.nets, net))
        for entries, entry in new:
            entries.append(entry)
            del entries[:-REMEMBERED]


@dataclass(frozen=True)
class Certifier:
    """Bounds on functionals of the nets with second differences of at most 1."""

    differences: FloatArray
    least_squares: FloatArray
    solved: _Solved = field(default_factory=_Solved)

    @staticmethod
    def of(valence: int) -> Certifier:
        differences = difference_matrix(valence)
        return Certifier(differences, np.linalg.pinv(differences.T, rcond=RANK_TOLERANCE))

    def solve(self, functional: FloatArray) -> float:
        """The least ‖y‖₁ with Dᵀy = functional, by linear programming; remembered with the net that reaches it."""
        count = len(self.differences)
        both_signs = np.hstack([self.differences.T, -self.differences.T])
        start = self._shortest(functional)
        scale = np.abs(start).max()
        made_of_differences = self.differences.T @ (start / scale)
        found = linprog(np.ones(2 * count), A_eq=both_signs, b_eq=made_of_differences, method="highs")
        if found.status:
            raise NotCertifiedError(found.message)
        weights = scale * (found.x[:count] - found.x[count:])
        weights += self.least_squares @ (functional - self.differences.T @ weights)
        self._check(weights[None], functional[None])
        net = found.eqlin.marginals / np.abs(self.differences @ found.eqlin.marginals).max()
        addition = weights - start
        self.solved.add(start, addition, float(self._off(addition, np.zeros_like(functional))), net)
        return float(np.abs(weights).sum()) + ROUNDING

    def upper(self, functionals: FloatArray) -> FloatArray:
        """(rows,): a bound on each functional, from least squares and the additions of the solved programs."""
        start = self._shortest(functionals)
        off = self._check(start, functionals)
        bounds = np.abs(start).sum(axis=1)
        for index in range(len(self.solved.weights)):
            bounds = np.minimum(bounds, self._with_addition(start, off, index))
        return bounds + ROUNDING

    def _shortest(self, functionals: FloatArray) -> FloatArray:
        """(…, 2n + 10): the least-squares weights of functionals, with a step against rounding."""
        start = functionals @ self.least_squares.T
        return start + (functionals - start @ self.differences) @ self.least_squares.T

    def _off(self, weights: FloatArray, functionals: FloatArray) -> FloatArray:
        """(rows,): bounds of the excess of the least sum of absolute weights for functionals c over that of weights y.

        c - Dᵀy vanishes with the second differences as c does, so y + L(c - Dᵀy) makes c, L being least squares,
        with a sum of absolute weights at most ‖L(c - Dᵀy)‖₁ above that of y.
        """
        return np.abs(weights @ self.differences - functionals) @ np.abs(self.least_squares).sum(axis=0)

    def _check(self, weights: FloatArray, functionals: FloatArray) -> FloatArray:
        """(rows,): ``_off`` of weights (rows, 2n + 10), 10⁻¹² or so. Raises NotCertifiedError unless the weights make
        the functionals but for rounding.

        The error of the functionals themselves, from products of some ten matrices of averages, counts alike: hence a
        half.
        """
        off = self._off(weights, functionals)
        if off.max(initial=0.0) > ROUNDING / 2:
            raise NotCertifiedError("a functional does not vanish with the second differences")
        return off

    def improved(self, bounds: FloatArray, functionals: FloatArray) -> FloatArray:
        """``upper`` bounds, with the program solved last taken into account."""
        start = self._shortest(functionals)
        latest = self._with_addition(start, self._check(start, functionals), -1)
        return np.minimum(bounds, latest + ROUNDING)

    def _with_addition(self, start: FloatArray, off: FloatArray, index: int) -> FloatArray:
        """(rows,): the sums of absolute weights of least squares with a multiple of what a program added.

        What a program added, z, has Dᵀz = 0 but for rounding, so a multiple qz of it leaves a certificate one:
        ``_off`` grows by |q| times that of z. Where the sum exceeds the rounding allowed for, the bound is infinite.
        """
        weights = self.solved.weights[index]
        likeness = start @ weights / (weights @ weights)
        sums = np.abs(start + likeness[:, None] * self.solved.additions[index]).sum(axis=1)
        return np.where(off + np.abs(likeness) * self.solved.off[index] <= ROUNDING / 2, sums, np.inf)

    def lower(self, functionals: FloatArray) -> FloatArray:
        """(rows,): the largest value of each functional on the worst nets of the solved programs."""
        if not self.solved.nets:
            return np.zeros(len(functionals))
        return np.abs(functionals @ np.stack(self.solved.nets, axis=1)).max(axis=1)

    def largest(self, functionals: FloatArray, enough: float, precision: float = 0.0) -> float:
        """A bound on all the functionals, (…, 2n + 8): ``enough``, or a larger bound to a relative precision."""
        rows = functionals.reshape(-1, functionals.shape[-1])
        bounds = self.upper(rows)
        while len(rows) and bounds.max() > enough:
            worst = int(bounds.argmax())
            least = self.solve(rows[worst])
            bounds = self.improved(bounds, rows)
            bounds[worst] = min(bounds[worst], least)
            enough = max(enough, bounds[worst] * (1 + precision))
        return enough

    def pieces_above(self, pieces: FloatArray, claim: float) -> NDArray[np.bool_]:
        """(pieces,) bool: whether Bernstein blocks have a coefficient above the claim for some net."""
        rows = pieces.reshape(-1, pieces.shape[-1])
        above = (self.lower(rows) > claim).reshape(-1, 16).any(axis=1)
        bounds = self.upper(rows)
        while True:
            doubtful = (bounds > claim) & np.repeat(~above, 16)
            if not doubtful.any():
                return above
            worst = int(np.where(doubtful, bounds, 0.0).argmax())
            least = self.solve(rows[worst])
            bounds = self.improved(bounds, rows)
            bounds[worst] = min(bounds[worst], least)
            above |= (self.lower(rows) > claim).reshape(-1, 16).any(axis=1)
            above[worst // 16] |= least > claim


def tiles(patch: PolygonMesh, levels: int) -> Iterator[tuple[int, int, FloatArray]]:
    """The tiles: (level, tile, net of the tile (4, 4, 2n + 8)); last (levels, 0, limits of the corners of the rest)."""
    for level in range(1, levels + 1):
        children = subdivide(submesh(patch, np.array([0]))[0])
        nets = regular_nets(children, np.array([1, 2]))
        for tile in TILES:
            yield level, tile, nets[:, :, tile - 1]
        patch = children
    yield levels, 0, limit_positions(patch)[patch.corner_vertices[:4]]


def bernstein(net: FloatArray) -> FloatArray:
    """(4, 4, D): the Bernstein coefficients of a net (4, 4, D)."""
    return np.einsum("ai,bj,ijd->abd", SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN, net)


def bilinear(corners: FloatArray, u: float, v: float) -> FloatArray:
    """(D,): the facet over four corners (4, D), in order (0,0), (1,0), (1,1), (0,1)."""
    return (1 - u) * (1 - v) * corners[0] + u * (1 - v) * corners[1] + u * v * corners[2] + (1 - u) * v * corners[3]


def facet_over_tile(corners: FloatArray, level: int, tile: int) -> FloatArray:
    """(4, 4, D): the Bernstein coefficients over a tile of the facet with corners (4, D)."""
    scale = 2.0 ** (1 - level)
    return bilinear_coefficients(np.stack([bilinear(corners, u * scale, v * scale) for u, v in TILES[tile]]))


def facet_corner(corners: FloatArray, level: int) -> FloatArray:
    """(4, D): the facet's values at the corners of [0, 2⁻ᵐ]²."""
    scale = 2.0**-level
    return np.stack([bilinear(corners, u * scale, v * scale) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))])


def split(pieces: FloatArray) -> FloatArray:
    """The Bernstein blocks after halving both ways: (4 · pieces, 4, 4, D)."""
    return np.concatenate([np.einsum("ai,bj,pijd->pabd", a, b, pieces) for a in HALVES for b in HALVES])
