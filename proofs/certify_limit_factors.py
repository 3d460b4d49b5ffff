# SPDX-License-Identifier: GPL-3.0-or-later
"""Proves the limit-vertex factors of ``ccdepth_addon.core.bounds``, valence by valence (needs scipy).

    python -m proofs.certify_limit_factors [LAST_VALENCE]

Claim: on an extraordinary facet with limit vertices, ‖L̂ - S‖ ≤ factor · M for every net of that valence.

Proof. The facet without its extraordinary corner is tiled by the regular patches of every level m; on each tile both S
and L̂ are bicubic, so their distance there is at most the largest Bernstein coefficient of L̂ - S, on the tile or on the
pieces it is split into. Each coefficient is a linear functional c of the net that vanishes on every net without second
differences, so c = Dᵀy for some y, D being the matrix of the 2n + 10 second differences; then
‖c·V‖ = ‖y·(DV)‖ ≤ ‖y‖₁ · M. A small ‖y‖₁ is a certificate that anybody can check: least squares gives one at once, and
where it is not small enough linear programming gives the least. What is left after the last tile, [0, 2⁻ᵐ]², is a facet
of its own at level m: there ‖L̂ - S‖ ≤ max over its corners of ‖L̂ - L̂ᵐ‖ (a difference of bilinear functions) + the
published bound of level m with the corners' way to the limit (``bounds``), which has shrunk by then.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linprog

from ccdepth_addon.core.bounds import (
    LAST_CERTIFIED_VALENCE,
    certified_limit_factor,
    limit_displacement,
    published_divisor,
    published_rate,
)
from ccdepth_addon.core.catmull_clark import limit_positions, subdivide
from ccdepth_addon.core.mesh import FloatArray, PolygonMesh, polygon_mesh, submesh
from ccdepth_addon.core.norms import ring_index, second_differences
from ccdepth_addon.core.patches import regular_nets

TILED_LEVELS = 14
SPLITS = (3, 1)  # how often the tiles of the first levels are halved both ways; the others stay whole

# Far above what double precision can lose in a certificate, far below the margins that are met.
ROUNDING = 1e-9

SPLINE_TO_BERNSTEIN = np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6
FIRST_HALF = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8
HALVES = (FIRST_HALF, FIRST_HALF[::-1, ::-1])

# Children 1 and 2 of the facet (3 mirrors 1): their corners in the parent's parameters, in the child's own order.
TILES = {1: ((1, 0), (1, 0.5), (0.5, 0.5), (0.5, 0)), 2: ((1, 1), (0.5, 1), (0.5, 0.5), (1, 0.5))}


class NotCertifiedError(Exception):
    """No certificate was found; the claim may still be true."""


def stencil_patch(valence: int) -> PolygonMesh:
    """The faces of an extraordinary net of 2n + 8 points; vertex i stands at the i-th unit vector, so every position
    of a refinement is the stencil it has on the net. Face 0 is the facet, from its extraordinary vertex on."""
    n = valence

    def ring(number: int) -> int:
        return ring_index(n, number)

    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 1, 2 * n + 8)
    around = [[0, ring(2 * i + 2), ring(2 * i + 1), ring(2 * i)] for i in range(2, n + 2)]
    outer = [
        [ring(6), o4, o3, ring(5)],
        [ring(5), o3, o2, o6],
        [ring(4), ring(5), o6, o7],
        [ring(3), ring(4), o7, o8],
        [ring(7), o5, o4, ring(6)],
    ]
    corners = np.array(around + outer).reshape(-1)
    patch = polygon_mesh(np.eye(2 * n + 8), np.full(n + 5, 4), corners)
    # The net's outline is no boundary of the surface.
    return replace(patch, sharpness_is_explicit=True)


@dataclass(frozen=True)
class Certifier:
    """Bounds on functionals of the nets whose second differences are at most 1."""

    differences: FloatArray
    least_squares: FloatArray

    @staticmethod
    def of(valence: int) -> Certifier:
        rows = second_differences(valence)
        differences = np.zeros((len(rows), 2 * valence + 8))
        for row, (a, b, c) in enumerate(rows):
            np.add.at(differences[row], [a, b, c], [2, -1, -1])
        return Certifier(differences, np.linalg.pinv(differences.T))

    def least(self, functional: FloatArray) -> float:
        """The least ‖y‖₁ with Dᵀy = functional, by linear programming."""
        count = len(self.differences)
        both_signs = np.hstack([self.differences.T, -self.differences.T])
        found = linprog(np.ones(2 * count), A_eq=both_signs, b_eq=functional, method="highs")
        weights = found.x[:count] - found.x[count:]
        weights += self.least_squares @ (functional - self.differences.T @ weights)
        return float(np.abs(weights).sum())

    def largest(self, functionals: FloatArray, enough: float) -> float:
        """A bound on all the functionals, (…, 2n + 8); those with a certificate below ``enough`` count as that."""
        rows = functionals.reshape(-1, functionals.shape[-1])
        weights = rows @ self.least_squares.T
        missed = np.abs(weights @ self.differences - rows).max()
        if missed > ROUNDING:
            raise NotCertifiedError("a functional does not vanish with the second differences")
        doubtful = np.flatnonzero(np.abs(weights).sum(axis=1) + ROUNDING > enough)
        return max([enough, *(self.least(row) + ROUNDING for row in rows[doubtful])])


def tiles(patch: PolygonMesh, levels: int) -> Iterator[tuple[int, int, FloatArray]]:
    """(level, tile, Bernstein coefficients of S there (4, 4, 2n + 8)); last (levels, 0, corners of what is left)."""
    for level in range(1, levels + 1):
        children = subdivide(submesh(patch, np.array([0]))[0]).mesh
        nets = regular_nets(children, np.array([1, 2]))
        for tile in TILES:
            yield (
                level,
                tile,
                np.einsum("ai,bj,ijd->abd", SPLINE_TO_BERNSTEIN, SPLINE_TO_BERNSTEIN, nets[:, :, tile - 1]),
            )
        patch = children
    yield levels, 0, limit_positions(patch)[patch.corner_vertices[:4]]


def bilinear(corners: FloatArray, u: FloatArray | float, v: FloatArray | float) -> FloatArray:
    """The facet over four corners (4, D), in order (0,0), (1,0), (1,1), (0,1), at parameters that broadcast."""
    return (1 - u) * (1 - v) * corners[0] + u * (1 - v) * corners[1] + u * v * corners[2] + (1 - u) * v * corners[3]


def bernstein_of_bilinear(corners: FloatArray) -> FloatArray:
    """(4, 4, D): the bicubic Bernstein coefficients of a bilinear facet, its values at thirds."""
    thirds = np.arange(4) / 3
    return bilinear(corners, thirds[:, None, None], thirds[None, :, None])


def split(coefficients: FloatArray, times: int) -> FloatArray:
    """The Bernstein coefficients of the pieces after halving both ways so many times."""
    pieces = coefficients[None]
    for _ in range(times):
        pieces = np.concatenate([np.einsum("ai,bj,pijd->pabd", a, b, pieces) for a in HALVES for b in HALVES])
    return pieces


def certify(valence: int, claim: float) -> float:
    """A proved bound on ‖L̂ - S‖/M over all nets of a valence, ``claim`` when that much can be proved."""
    patch = stencil_patch(valence)
    certifier = Certifier.of(valence)
    limits = limit_positions(patch)
    facet = limits[[0, *(ring_index(valence, number) for number in (6, 5, 4))]]
    proved = claim
    for level, tile, values in tiles(patch, TILED_LEVELS):
        if tile:
            scale = 2.0 ** (1 - level)
            corners = np.stack([bilinear(facet, u * scale, v * scale) for u, v in TILES[tile]])
            distance = values - bernstein_of_bilinear(corners)
            times = SPLITS[level - 1] if level <= len(SPLITS) else 0
            proved = max(proved, certifier.largest(split(distance, times), claim))
        else:
            proved = max(proved, last_facet_bound(valence, certifier, facet, values, level))
    return proved


def last_facet_bound(valence: int, certifier: Certifier, facet: FloatArray, corners: FloatArray, level: int) -> float:
    """The bound on [0, 2⁻ᵐ]², see the module's docstring; corners: (4, 2n + 8) limit positions of its corners."""
    scale = 2.0**-level
    flat = np.stack([bilinear(facet, u * scale, v * scale) for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))])
    apart = certifier.largest(flat - corners, 0.0)
    own = 1 / published_divisor(valence) + limit_displacement(valence)
    return apart + own * published_rate(valence) ** level


def main() -> None:
    last = int(sys.argv[1]) if len(sys.argv) > 1 else LAST_CERTIFIED_VALENCE
    for valence in [3, *range(5, last + 1)]:
        claim = certified_limit_factor(valence)
        proved = certify(valence, claim)
        print(f"valence {valence:4d}: {proved:.6f} M {'certified' if proved <= claim else 'NOT CERTIFIED'}", flush=True)
        if proved > claim:
            raise SystemExit(1)


if __name__ == "__main__":
    main()
