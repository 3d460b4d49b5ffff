# SPDX-License-Identifier: GPL-3.0-or-later
"""Methods by norms: a control net's bound on the distance to the limit surface at every later level.

The distance of a face at level k is measured at equal parameters: the largest ‖Lᵏ(u, v) - S(u, v)‖, with S the face's
patch and Lᵏ bilinear over each of its level-k subfaces. With CONTROL vertices the corners of Lᵏ are the level-k control
points; with LIMIT vertices they are moved to the limit surface. M is the second-order norm, Δ the first-order norm. Our
own derivations are in docs/methods.md.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..arrays.tables import Table
from ..arrays.types import FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.bicubic import largest_norm
from ..surface.patches import PatchKind, faces_on_grids, regular_nets
from ..surface.refinement import Refinement
from . import sharp_constants
from .norms import (
    first_order_norm_extraordinary,
    first_order_norm_regular,
    second_order_norm_extraordinary,
    second_order_norm_regular,
)

# The parameters of the rows of a 4 × 4 net along a face from 0 to 1.
GRID_PLACES = np.arange(-1.0, 3.0)


class Vertices(StrEnum):
    """The places of the vertices of the subdivided mesh."""

    CONTROL = "CONTROL"
    LIMIT = "LIMIT"

    def of_level(self, level: int) -> Vertices:
        """The vertices of a level: at level 0 the control points, as no modifier moves anything there."""
        return self if level else Vertices.CONTROL

    def at_corners(self, refinement: Refinement) -> FloatArray:
        """(C, 3): the vertices at the corners of a refinement's descendants."""
        if self is Vertices.LIMIT:
            return refinement.limits_at_corners
        return refinement.mesh.positions[refinement.corner_vertices()]


class Method(StrEnum):
    """The way in which the distance is bounded."""

    DISTANCE = "DISTANCE"
    CERTIFIED = "CERTIFIED"
    SHARP = "SHARP"
    SECOND_ORDER = "SECOND_ORDER"
    FIRST_ORDER = "FIRST_ORDER"


@dataclass(frozen=True)
class PatchBounds(Table):
    """Bounds of P patches for every level from their own on: ``value · factors[j]`` after j more levels.

    Beyond the factors the last ``period`` of them recur, times ``rate`` each time.
    value: (P,) float64 in the unit of the positions; rate: below 1.
    """

    value: FloatArray
    rate: float
    factors: tuple[float, ...] = (1.0,)
    period: int = 1

    def after(self, levels: int) -> FloatArray:
        """(P,) float64: the bound a number of levels later."""
        beyond = max(levels - (len(self.factors) - 1), 0)
        rounds = -(-beyond // self.period)
        return self.value * (self.factors[levels - rounds * self.period] * self.rate**rounds)


def published_rate(valence: int) -> float:
    """1/w: the factor by which the second-order norm shrinks with each level at the least (Lemma 4)."""
    n = valence
    if n == 3:
        return 2 / 3
    if n == 5:
        return 18 / 25
    return (3 * n * n + 8 * n - 46) / (4 * n * n)


def published_divisor(valence: int) -> float:
    """z of Theorem 8: ‖L - S‖ ≤ M/z.

    For n > 8 Lemma 7 prints n²/(4(n² - 8n + 46)) as 1/z; the sum in its proof gives n²/(2(n² - 8n + 46)), as in Theorem
    8, and only this holds.
    """
    n = valence
    if n == 3:
        return 1.0
    if n <= 8:
        return 25 / 18
    return 2 * (n * n - 8 * n + 46) / (n * n)


def limit_displacement(valence: int) -> float:
    """The largest distance, in units of M, from a corner of an extraordinary patch to its limit position.

    At the extraordinary vertex V∞ - V = [4Σ(E - V) + Σ(F - V)] / (n(n + 5)); the spokes' differences sum to
    ‖Σ(E - V)‖ ≤ nM/2, those between the diagonals to ‖Σ(F - E)‖ ≤ nM/2, together 3M/(n + 5). At the regular corners
    it is M/3 (the bound of a regular patch, taken at its corner).
    """
    return max(1 / 3, 3 / (valence + 5))


# Valences up to this one have a limit factor proved by proofs/certify_limit_factors.py.
LAST_CERTIFIED_VALENCE = 400


def certified_limit_factor(valence: int) -> float:
    """‖L̂ - S‖/M on an extraordinary facet with limit vertices, proved net by net (proofs/certify_limit_factors.py)."""
    return 7 / 27 if valence == 3 else 1 / 4


def second_order_regular(net: FloatArray, vertices: Vertices) -> PatchBounds:
    """Lemma 1 and Lemma 2 (Theorem 3): M/3 · 4⁻ᵏ; with limit vertices M/4 · 4⁻ᵏ (docs/methods.md, Limit Vertices)."""
    divisor = 3 if vertices is Vertices.CONTROL else 4
    return PatchBounds(second_order_norm_regular(net) / divisor, rate=1 / 4)


def _extraordinary_factor(valence: int, vertices: Vertices) -> float:
    """The bound of an extraordinary patch in units of M.

    Lemma 7 for control vertices. For limit vertices the certified factor; beyond, Lemma 7 plus the corners'
    displacement.
    """
    published = 1 / published_divisor(valence)
    if vertices is Vertices.CONTROL:
        return published
    if valence <= LAST_CERTIFIED_VALENCE:
        return certified_limit_factor(valence)
    return published + limit_displacement(valence)


def second_order_extraordinary(net: FloatArray, vertices: Vertices) -> PatchBounds:
    """Lemma 4 and Lemma 7 (Theorem 8): M/z · w⁻ᵏ. Nets are (2n + 8, P, 3)."""
    valence = (len(net) - 8) // 2
    factor = _extraordinary_factor(valence, vertices)
    return PatchBounds(second_order_norm_extraordinary(net) * factor, published_rate(valence))


# The last valence with a row of its own in Sharp's tables.
LAST_ALONE = 32

SHARP_FACTORS = {
    Vertices.CONTROL: sharp_constants.CONTROL_FACTORS,
    Vertices.LIMIT: sharp_constants.LIMIT_FACTORS,
}


def sharp_extraordinary(net: FloatArray, vertices: Vertices) -> PatchBounds:
    """The best factors of M, level by level, where tabled (docs/methods.md, Sharp); beyond, the published ones.

    For regular patches the published factors are the best: M/3, M/4 and their rate of 1/4 are reached.
    """
    valence = (len(net) - 8) // 2
    rows = sharp_constants.RATES
    row = valence if valence in rows else min((last for last in rows if last > valence > LAST_ALONE), default=None)
    if row is None:
        return second_order_extraordinary(net, vertices)
    norm = second_order_norm_extraordinary(net)
    return PatchBounds(norm, rows[row], SHARP_FACTORS[vertices][row], sharp_constants.PERIOD)


def first_order_rate(valence: int) -> float:
    """The factor by which the first-order norm shrinks with each level at the least (docs/methods.md, First Order).

    An edge from an edge point to a face point halves; an edge from the extraordinary vertex is a sum of level-k edges
    with these weights: d along its own spoke, the two spokes beside it, the others, then the edges from spokes to
    diagonals, near and far.
    """
    n = valence
    own, beside, every = 7 / 16, 3 / 32, 7 / (4 * n * n)
    near, far = 1 / 32, 1 / (8 * n * n)
    spokes = abs(own - every) + 2 * abs(beside - every) + (n - 3) * every
    diagonals = 4 * abs(near - far) + (2 * n - 4) * far
    return max(spokes + diagonals, 1 / 2)


def first_order_regular(net: FloatArray, vertices: Vertices) -> PatchBounds:
    """M ≤ 2Δ in Lemma 1, and Δ halves: (2/3)Δ · 2⁻ᵏ; with limit vertices (1/2)Δ · 2⁻ᵏ."""
    factor = 2 / 3 if vertices is Vertices.CONTROL else 1 / 2
    return PatchBounds(first_order_norm_regular(net) * factor, rate=1 / 2)


def first_order_extraordinary(net: FloatArray, vertices: Vertices) -> PatchBounds:
    """M ≤ 2Δ in Lemma 7, and Δ shrinks by ``first_order_rate``."""
    valence = (len(net) - 8) // 2
    factor = 2 * _extraordinary_factor(valence, vertices)
    return PatchBounds(first_order_norm_extraordinary(net) * factor, first_order_rate(valence))


@dataclass(frozen=True)
class PatchMethod:
    """A method: its bounds of regular nets (4, 4, P, 3) and of extraordinary nets (2n + 8, P, 3).

    falling: the kinds of patches with bounds that fall by one rate with each level. The sharp factors rise a little
    where their period begins anew.
    """

    regular: Callable[[FloatArray, Vertices], PatchBounds]
    extraordinary: Callable[[FloatArray, Vertices], PatchBounds]
    falling: tuple[PatchKind, ...]


BOTH_KINDS = (PatchKind.REGULAR, PatchKind.EXTRAORDINARY)
PATCH_METHODS = {
    Method.SHARP: PatchMethod(second_order_regular, sharp_extraordinary, (PatchKind.REGULAR,)),
    Method.SECOND_ORDER: PatchMethod(second_order_regular, second_order_extraordinary, BOTH_KINDS),
    Method.FIRST_ORDER: PatchMethod(first_order_regular, first_order_extraordinary, BOTH_KINDS),
}


def support_bounds(mesh: PolygonMesh, vertices: Vertices) -> FloatArray:
    """(F,) float64: a bound of ‖L - S‖ for every face of a mesh of quads, with any rules at its vertices.

    Every rule is an average with non-negative weights, so a face's patch lies in the convex hull of its support, the
    points of all faces around its corners: no point of it is farther from the facet than the farthest support point is
    from a corner. With c a corner, p a point of a face around the corner c' and s(c') the distance
    from c' to the farthest such point, ‖c - p‖ ≤ ‖c - c'‖ + s(c'). The limit position of c lies within s(c) of c.

    The bound for limit vertices also holds at all later levels, for either kind of vertices: their facets lie in the
    same hull as S, and no two points of the support are farther apart.

    Faces on grids have a smaller bound (``_grid_bounds``).
    """
    corners = mesh.positions[mesh.corner_vertices].reshape(-1, 4, 3)
    apart = np.linalg.norm(corners[:, :, None] - corners[:, None, :], axis=3)
    farthest = np.zeros(mesh.vertex_count)
    np.maximum.at(farthest, mesh.corner_vertices, apart.max(axis=2).reshape(-1))
    reach = farthest[mesh.corner_vertices].reshape(-1, 4)
    distance = apart + reach[:, None, :]
    if vertices is Vertices.LIMIT:
        distance = distance + reach[:, :, None]
    bounds: FloatArray = distance.max(axis=(1, 2))
    on_grids = np.flatnonzero(faces_on_grids(mesh))
    bounds[on_grids] = np.minimum(bounds[on_grids], _grid_bounds(mesh, on_grids, vertices))
    return bounds


def _grid_bounds(mesh: PolygonMesh, faces: IndexArray, vertices: Vertices) -> FloatArray:
    """(faces,) float64: ‖L - S‖ of faces on grids (``patches.faces_on_grids``), which falls by four a level.

    The surface is S = Σ wᵢⱼ(u, v) Vᵢⱼ, with non-negative weights that sum to 1, and reproduces bilinear functions; so
    with L the facet of the control points, extended to the whole net, S - L = Σ wᵢⱼ (Vᵢⱼ - L(i, j)) is no longer than
    the longest Vᵢⱼ - L(i, j). The same bounds the distance from the corners to their limits, from the facet over the
    limits to L, and at all later levels from the corners of facets of either kind to L, as averages of the same kind;
    so twice the bound holds there too. Points beyond infinitely sharp sides have no weight; they can only raise the
    bound.
    """
    net = regular_nets(mesh, faces)
    corners = net[[1, 2, 2, 1], [1, 1, 2, 2]]
    along = np.stack([1.0 - GRID_PLACES, GRID_PLACES])
    weights = np.einsum("ki,kj->kij", along[[0, 1, 1, 0]], along[[0, 0, 1, 1]])
    off = largest_norm((net - np.einsum("kij,kpc->ijpc", weights, corners)).reshape(16, -1, 3))
    return 2.0 * off if vertices is Vertices.LIMIT else off
