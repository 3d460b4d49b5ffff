# SPDX-License-Identifier: GPL-3.0-or-later
"""Bicubic pieces near extraordinary patches, and bounds of their distance from the surface: matrices for each valence.

A patch with an extraordinary corner consists of regular patches, three at every level of its subdivision, and a rest at
that corner. The piece is fitted to the first regular patches. The differences of coefficients bound the distance
between a regular patch and the part of the piece with the same parameters; the rest at the last level lies, like the
piece there, around the corner's limit position. docs/deviation.md, Pieces.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..arrays.chunks import chunks
from ..arrays.matrix_products import matrix_product
from ..arrays.types import FloatArray, IndexArray
from ..arrays.vectors import squared_norms
from ..surface.bicubic import CORNERS, HALVES, NET_TO_BERNSTEIN
from ..surface.stencils import patch_stencils

# The number of levels with regular patches to fit the piece to, and of levels before the rest counts as a whole.
FITTED_LEVELS, LEVELS = 4, 12

# The number of patches bounded together.
NETS_AT_ONCE = 1 << 9

# A step reaches the next sector around the vertex, and all others by two sums alone: the points beside these sectors,
# counted from the patch's own, count as two sums. With fewer sectors all points count by themselves.
NEAR_SECTORS = np.arange(-LEVELS, LEVELS + 4)
MANY_SECTORS = 2 * len(NEAR_SECTORS)

# (16, 16): the coefficients of the quarter at corner 0 from those of a piece.
QUARTER = np.kron(HALVES[0], HALVES[0])


@dataclass(frozen=True)
class PieceStencils:
    """Matrices for nets of 2n + 8 points in Stam's order, corner 0 at the extraordinary vertex.

    coefficients: (16, 2n + 8), of the piece; its corners lie on the surface. children: (48, 2n + 8), of the regular
    children at corners 1 to 3. middle: (1, 2n + 8), of the surface's point at the piece's middle. apart: (rows, 2n +
    8), differences whose lengths bound the distance between surface and piece at equal parameters. At the corner the
    longest row of rest, (2n + 8, 2n + 8), and the longest row of piece, (16, 2n + 8), together bound the distance.
    With ``MANY_SECTORS`` all of these have columns for ``near_points`` alone, and rest has rows for the points that are
    not in the ring. ring: (n // 2 + 1, 2, 2) complex, of rest in the ring, its Fourier transform; centre: (2,), the
    weights of the vertex there.
    """

    coefficients: FloatArray
    children: FloatArray
    middle: FloatArray
    apart: FloatArray
    rest: FloatArray
    piece: FloatArray
    ring: NDArray[np.complex128] | None = None
    centre: FloatArray | None = None


@lru_cache(maxsize=64)
def piece_stencils(valence: int) -> PieceStencils:
    """The matrices for a valence of 3, 5 or more."""
    stencils = patch_stencils(valence)
    net = np.eye(2 * valence + 8)
    # The coefficients of the regular patches, and of the piece's parts beside them from those of the piece.
    patches, parts, part = [], [], np.eye(16)
    for _ in range(LEVELS):
        for corner, regular in enumerate(np.split(stencils.regular @ net, 3), start=1):
            patches.append(NET_TO_BERNSTEIN @ regular)
            parts.append(QUARTER @ _from_corner(corner) @ part)
        net, part = stencils.refined @ net, QUARTER @ part
    coefficients = _fitted(np.concatenate(patches), np.concatenate(parts), stencils.limits)
    apart = np.concatenate(patches) - np.concatenate(parts) @ coefficients
    corner = stencils.limits[0]
    # Corner 2 of the child at corner 2.
    middle = patches[1][CORNERS[2:3]]
    children = np.concatenate(patches[:3])
    rows = [coefficients, children, middle, apart, net - corner, part @ coefficients - corner]
    if valence < MANY_SECTORS:
        return PieceStencils(*rows)
    near, far = _near_columns(valence)
    rows = [np.concatenate([each[:, near], each[:, far].mean(axis=2)], axis=1) for each in rows]
    kernel = (net - corner)[1:3, 1 : 2 * valence + 1].reshape(2, valence, 2)
    rows[4] = rows[4][[0, *range(2 * valence + 1, 2 * valence + 8)]]
    # A row of the ring sees the others from its own sector on.
    ring = np.moveaxis(np.fft.rfft(kernel, axis=1).conj(), 1, 0)
    return replace(PieceStencils(*rows), ring=ring, centre=(net - corner)[1:3, 0])


def near_points(nets: FloatArray, valence: int) -> FloatArray:
    """The points of nets (2n + 8, P, 3) that ``PieceStencils`` have columns for."""
    if valence < MANY_SECTORS:
        return nets
    near, far = _near_columns(valence)
    return np.concatenate([nets[near], nets[far].sum(axis=1)])


@lru_cache(maxsize=64)
def _near_columns(valence: int) -> tuple[IndexArray, IndexArray]:
    """The points of a net that count by themselves; and the points of two sums, (2, m), of sides and of faces."""
    sectors = np.arange(valence)
    is_near = np.isin(sectors, NEAR_SECTORS % valence)
    near = 1 + 2 * sectors[is_near][:, None] + np.arange(2)
    near = np.concatenate([[0], near.ravel(), np.arange(2 * valence + 1, 2 * valence + 8)])
    return near, 1 + 2 * sectors[~is_near] + np.arange(2)[:, None]


def largest_rest(stencils: PieceStencils, nets: FloatArray, points: FloatArray) -> FloatArray:
    """(P,): the longest rows of rest for nets (2n + 8, P, 3). points: of ``near_points``."""
    longest: FloatArray = np.sqrt(squared_norms(matrix_product(stencils.rest, points)).max(axis=0))
    if stencils.ring is None or stencils.centre is None:
        return longest
    valence = (len(nets) - 8) // 2
    modes = np.fft.rfft(nets[1 : 2 * valence + 1].reshape(valence, 2, -1), axis=0)
    ring = np.fft.irfft(np.matmul(stencils.ring, modes), valence, axis=0)
    ring += stencils.centre[:, None] * nets[0].ravel()
    return np.maximum(longest, np.sqrt(squared_norms(ring.reshape(2 * valence, -1, 3)).max(axis=0)))


def pieces_of_nets(
    nets: FloatArray, valence: int, tick: Callable[[], None]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The pieces of nets (2n + 8, P, 3): their coefficients (P, 3, 16), the surface's points at their middles (P, 3),
    and their excess (P,). tick: called again and again; it may raise to stop."""
    stencils, count = piece_stencils(valence), nets.shape[1]
    excess = np.empty(count)
    points = near_points(nets, valence)
    for chunk in chunks(count, NETS_AT_ONCE):
        apart, piece = (
            np.sqrt(squared_norms(matrix_product(rows, points[:, chunk])).max(axis=0))
            for rows in (stencils.apart, stencils.piece)
        )
        excess[chunk] = np.maximum(apart, largest_rest(stencils, nets[:, chunk], points[:, chunk]) + piece)
        tick()
    coefficients, [middles] = (matrix_product(rows, points) for rows in (stencils.coefficients, stencils.middle))
    return np.moveaxis(coefficients, 0, 2), middles, excess


def children_of_nets(nets: FloatArray, valence: int) -> tuple[FloatArray, FloatArray]:
    """The nets of the children at corner 0, (2n + 8, P, 3), and the coefficients of the regular children at corners 1
    to 3, (P, 3, 3, 16)."""
    first, places, weights = _few_points(valence)
    refined = np.zeros_like(nets)
    refined[0] = matrix_product(first, nets)[0]
    for which, weight in zip(places, weights, strict=True):
        refined[1:] += weight[:, None, None] * nets[which]
    regular = matrix_product(piece_stencils(valence).children, near_points(nets, valence)).reshape(3, 16, -1, 3)
    return refined, np.moveaxis(regular, (2, 0, 3, 1), (0, 1, 2, 3))


@lru_cache(maxsize=64)
def _few_points(valence: int) -> tuple[FloatArray, IndexArray, FloatArray]:
    """The first row of the matrix of a step, (1, 2n + 8); and the points (9, 2n + 7) and weights of all other rows."""
    rows = patch_stencils(valence).refined
    places = np.argsort(rows[1:] == 0, axis=1, kind="stable")[:, :9]
    return rows[:1], places.T, np.take_along_axis(rows[1:], places, axis=1).T


def _from_corner(corner: int) -> FloatArray:
    """(16, 16): the coefficients counted from another corner, as subdivision counts those of the child there."""
    grid = np.arange(16).reshape(4, 4)
    return np.eye(16)[np.rot90(grid, -corner).ravel()]


def _fitted(patches: FloatArray, parts: FloatArray, limits: FloatArray) -> FloatArray:
    """(16, N): the coefficients that bring the parts nearest to the first patches, with the corners' limit
    positions."""
    rows = 48 * FITTED_LEVELS
    coefficients = np.zeros((16, limits.shape[1]))
    coefficients[CORNERS] = limits
    others = np.setdiff1d(np.arange(16), CORNERS)
    wanted = patches[:rows] - parts[:rows] @ coefficients
    coefficients[others] = np.linalg.lstsq(parts[:rows][:, others], wanted, rcond=None)[0]
    return coefficients
