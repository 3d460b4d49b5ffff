# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of the method Sharp, ``ccdepth_addon/core/bounds/sharp_constants.py``, and their proof.

    python -m proofs.certify_sharp_constants [VALENCE …]

Without arguments the program makes the file; with valences it prints their constants. Needs scipy.

Claim: for every net of valence n with second-order norm M, ‖Lᵏ - S‖ ≤ factors[k] · M on the whole face at level k, with
control or with limit vertices; after these the last ``PERIOD`` recur, times ``rate`` each time.

Proof (``certificates`` has the means). T is the matrix of a step from the net to the net of the child at the
extraordinary vertex, so bounds of L - S hold of Lᵏ - S on the level-k facet at that vertex with each functional times
Tᵏ.

- That facet: Bernstein coefficients of L - S on the tiles of levels 1 … ``TILED_LEVELS``, times Tᵏ, split where they
  exceed the claim. On the rest, [0, 2⁻ᵐ]² of it, ‖L - S‖ ≤ max over the corners of ‖L - L̂ᵐ‖ + the published bound of
  the level k + m, whose norm is at most the sum of the weights of its differences.
- The regular level-k subfaces, children of level m of the facet or descendants of such. With A = S_uu, B = S_vv and R =
  S_uuvv of the child, j = k - m levels on ‖L - S‖ ≤ s(‖A‖ + ‖B‖) + s²‖R‖, s = 4⁻ʲ/6, or 4⁻ʲ/8 with limit vertices
  (docs/methods.md); a patch with too large a bound is split by knot insertion, and at its own level L - S is taken in
  Bernstein form.
- Further on, with s = ``PERIOD``: level k + s at the child of level s is level k of a net whose norm is at most rM, r
  being the largest second difference of Tˢ for M ≤ 1. The regular children of levels 1 to s have the bound above;
  that it is at most rate · factors[k] at level k + s, for each of the last s levels k of the table, is part of how
  the rate is found (``certified_rate``: the larger of r and these). At level k + (i + 1)s it then holds by induction:
  the child of level s is at level k + is of its own net, and for the regular children the bound falls by 4⁻ˢ from
  period to period, the rate being larger.

How sharp: each factor is rounded up from what some net reaches, times 1 + ``MARGIN``, and raised by as much again while
it would take more than ``MOST_SPLITS`` splits to prove it.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import Vertices, limit_displacement, published_divisor
from ccdepth_addon.core.mesh.submesh import submesh
from ccdepth_addon.core.surface.bicubic import SPLINE_HALVES, bilinear_coefficients, second_derivatives
from ccdepth_addon.core.surface.catmull_clark import subdivide
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.patches import extraordinary_nets
from ccdepth_addon.core.surface.stencils import stencil_patch
from proofs.certificates import Certifier, bernstein, facet_corner, facet_over_tile, split, tiles

# The first and the last valence of each row of the tables.
ROWS = [(3, 3), *((valence, valence) for valence in range(5, 33)), (33, 48), (49, 64), (65, 96), (97, 128)]
LAST_LEVEL = 9
PERIOD = 8
TILED_LEVELS = 24

DIGITS = 5
MARGIN = 1e-5
MOST_SPLITS = 8

# The divisors of the second derivatives in the distance of a regular patch's facets (docs/methods.md).
DIVISORS = {Vertices.CONTROL: 6, Vertices.LIMIT: 8}

TABLES = Path(__file__).parents[1] / "ccdepth_addon" / "core" / "bounds" / "sharp_constants.py"


@dataclass(frozen=True)
class SharpConstants:
    """The constants of one valence, in units of M, by kind of vertices; reached: the distance that some net reaches at
    each level."""

    valence: int
    factors: dict[Vertices, list[float]]
    reached: dict[Vertices, list[float]]
    rate: float


@dataclass(frozen=True)
class Geometry:
    """An extraordinary patch as stencils, rows over the D = 2n + 8 points of its net.

    step: (D, D), to the net of the child at the extraordinary vertex. facets: (4, D), the corners of the facet.
    children: the regular children, (level, tile, net (4, 4, D)). last_corners: (4, D), the limits of the corners of the
    rest.
    """

    step: FloatArray
    facets: dict[Vertices, FloatArray]
    children: list[tuple[int, int, FloatArray]]
    last_corners: FloatArray

    @staticmethod
    def of(valence: int) -> Geometry:
        patch = stencil_patch(valence)
        corners = patch.corner_vertices[:4]
        facets = {Vertices.CONTROL: patch.positions[corners], Vertices.LIMIT: limit_positions(patch)[corners]}
        fine = subdivide(submesh(patch, np.array([0]))[0])
        *children, (_, _, last_corners) = tiles(patch, TILED_LEVELS)
        return Geometry(extraordinary_nets(fine, np.array([0]), valence)[:, 0], facets, children, last_corners)

    def facet_error(self, vertices: Vertices) -> FloatArray:
        """(tiles, 4, 4, D): the Bernstein blocks of S - L on the facet's tiles."""
        facet = self.facets[vertices]
        return np.stack([bernstein(net) - facet_over_tile(facet, level, tile) for level, tile, net in self.children])

    def last_gaps(self, vertices: Vertices) -> FloatArray:
        """(4, D): S - L at the corners of the rest beside the tiles."""
        return self.last_corners - facet_corner(self.facets[vertices], TILED_LEVELS)

    def children_of_level(self, level: int) -> Iterator[FloatArray]:
        return (net for at, _, net in self.children if at == level)


def regular_error(net: FloatArray, vertices: Vertices) -> FloatArray:
    """(4, 4, D): the Bernstein block of S - L on a regular patch's own facet."""
    values = bernstein(net)
    corners = net[[1, 2, 2, 1], [1, 1, 2, 2]] if vertices is Vertices.CONTROL else values[[0, 3, 3, 0], [0, 0, 3, 3]]
    return values - bilinear_coefficients(corners)


def later_error(certifier: Certifier, net: FloatArray, vertices: Vertices, levels: int) -> float:
    """A bound on a regular patch's facets a number of levels after its own, (‖A‖ + ‖B‖)s + ‖R‖s²."""
    scale = 1 / DIVISORS[vertices] / 4**levels
    derivatives = certifier.upper(second_derivatives() @ net.reshape(16, -1))
    a, b, r = (float(part.max()) for part in (derivatives[:8], derivatives[8:16], derivatives[16:]))
    return scale * (a + b + scale * r)


def regular_pieces(
    certifier: Certifier, net: FloatArray, vertices: Vertices, levels: int, enough: float
) -> Iterator[FloatArray]:
    """The Bernstein blocks of S - L that may exceed ``enough``, a number of levels after a regular patch's own."""
    if levels == 0:
        yield regular_error(net, vertices)
    elif later_error(certifier, net, vertices, levels) > enough:
        for a in SPLINE_HALVES:
            for b in SPLINE_HALVES:
                part = np.einsum("ai,bj,ijd->abd", a, b, net)
                yield from regular_pieces(certifier, part, vertices, levels - 1, enough)


def rounded_up(value: float) -> float:
    """The number rounded up to ``DIGITS`` significant digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) + 1 - DIGITS)
    return float(f"{np.ceil(value / unit) * unit:.{DIGITS}g}")


def corner_rows(pieces: FloatArray) -> FloatArray:
    """(4 · pieces, D): the coefficients that are values of the piece."""
    return pieces[:, [0, 3, 3, 0], [0, 0, 3, 3]].reshape(-1, pieces.shape[-1])


def certified_factor(certifier: Certifier, pieces: FloatArray, least: float) -> tuple[float, float]:
    """A bound on Bernstein blocks, ``least`` or more, ``rounded_up`` from the value that some net reaches; and that
    value."""
    corners = corner_rows(pieces)
    certifier.largest(corners, 0.0, MARGIN)
    reached = float(certifier.lower(corners).max())
    claim = max(rounded_up(reached * (1 + MARGIN)), least)
    splits = 0
    while True:
        pieces = pieces[certifier.pieces_above(pieces, claim)]
        if not len(pieces):
            return claim, reached
        pieces = split(pieces)
        reached = max(reached, float(certifier.lower(corner_rows(pieces)).max()))
        splits += 1
        if splits > MOST_SPLITS:
            claim, splits = rounded_up(claim * (1 + MARGIN)), 0
        claim = max(claim, rounded_up(reached * (1 + MARGIN)))


def level_factor(
    valence: int, geometry: Geometry, certifier: Certifier, vertices: Vertices, level: int
) -> tuple[float, float]:
    """The factor of a level, and the distance that some net reaches there."""
    power = np.linalg.matrix_power(geometry.step, level)
    pieces = geometry.facet_error(vertices) @ power
    certifier.largest(corner_rows(pieces), 0.0, MARGIN)
    enough = float(certifier.lower(corner_rows(pieces)).max())
    regular = [
        piece
        for born in range(1, level + 1)
        for net in geometry.children_of_level(born)
        for piece in regular_pieces(certifier, net, vertices, level - born, enough)
    ]
    pieces = np.concatenate([pieces, np.array(regular).reshape(-1, *pieces.shape[1:])])
    last_differences = certifier.differences @ np.linalg.matrix_power(geometry.step, level + TILED_LEVELS)
    own = 1 / published_divisor(valence) + limit_displacement(valence)
    rest = own * float(certifier.upper(last_differences).max())
    gaps = certifier.largest(geometry.last_gaps(vertices) @ power, max(enough - rest, 0.0)) + rest
    return certified_factor(certifier, pieces, rounded_up(max(gaps, enough)))


def certified_rate(geometry: Geometry, certifier: Certifier, factors: dict[Vertices, list[float]]) -> float:
    """The rate by which the last ``PERIOD`` factors shrink when they recur, rounded up."""
    norm = certifier.largest(certifier.differences @ np.linalg.matrix_power(geometry.step, PERIOD), 0.0)
    regular = max(
        later_error(certifier, net, vertices, level + PERIOD - born) / factors[vertices][level]
        for vertices in Vertices
        for level in range(LAST_LEVEL + 1 - PERIOD, LAST_LEVEL + 1)
        for born in range(1, PERIOD + 1)
        for net in geometry.children_of_level(born)
    )
    return rounded_up(max(norm, regular))


def sharp_constants(valence: int) -> SharpConstants:
    geometry, certifier = Geometry.of(valence), Certifier.of(valence)
    factors: dict[Vertices, list[float]] = {}
    reached: dict[Vertices, list[float]] = {}
    for vertices in Vertices:
        found = [level_factor(valence, geometry, certifier, vertices, level) for level in range(LAST_LEVEL + 1)]
        factors[vertices] = [factor for factor, _ in found]
        reached[vertices] = [value for _, value in found]
    return SharpConstants(valence, factors, reached, certified_rate(geometry, certifier, factors))


def joined(some: list[SharpConstants]) -> SharpConstants:
    """The largest constants of some valences, as those of the last one."""
    factors, reached = (
        {vertices: np.max([vars(each)[name][vertices] for each in some], axis=0).tolist() for vertices in Vertices}
        for name in ("factors", "reached")
    )
    return SharpConstants(some[-1].valence, factors, reached, max(each.rate for each in some))


def report(constants: SharpConstants, seconds: float) -> None:
    print(f"valence {constants.valence}: rate {constants.rate:g} over {PERIOD} levels ({seconds:.1f} s)")
    for vertices in Vertices:
        print(f"  {vertices:7s} proved ", *(f"{value:10.5g}" for value in constants.factors[vertices]))
        print("          reached", *(f"{value:10.5g}" for value in constants.reached[vertices]), flush=True)


def written(constants: list[SharpConstants]) -> str:
    """The tables as a module."""

    def rows(vertices: Vertices) -> str:
        return "".join(
            f"    {found.valence}: ({', '.join(map(compact, found.factors[vertices]))}),\n" for found in constants
        )

    rates = "".join(f"    {found.valence}: {compact(found.rate)},\n" for found in constants)
    return f'''# SPDX-License-Identifier: GPL-3.0-or-later
"""The factors of the method Sharp by valence, in units of the second-order norm M, computed and proved by

    python -m proofs.certify_sharp_constants

Each row has the factors of levels 0, 1, 2, …; after these the last PERIOD factors recur, times the rate each time. A
row of a valence over 32 has the largest factors since the row before.
"""

PERIOD = {PERIOD}

CONTROL_FACTORS: dict[int, tuple[float, ...]] = {{
{rows(Vertices.CONTROL)}}}

LIMIT_FACTORS: dict[int, tuple[float, ...]] = {{
{rows(Vertices.LIMIT)}}}

RATES: dict[int, float] = {{
{rates}}}
'''


def compact(value: float) -> str:
    """The number in the form 1.2345e-3, with the same width for all."""
    mantissa, exponent = f"{value:.{DIGITS - 1}e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def main() -> None:
    chosen = [int(argument) for argument in sys.argv[1:]]
    rows = []
    for first, last in zip(chosen, chosen, strict=True) if chosen else ROWS:
        begun = time.perf_counter()
        rows.append(joined([sharp_constants(valence) for valence in range(first, last + 1)]))
        report(rows[-1], time.perf_counter() - begun)
    if not chosen:
        TABLES.write_text(written(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
