# SPDX-License-Identifier: GPL-3.0-or-later
"""The proof of the limit-vertex factors of ``ccdepth_addon.core.bounds``, valence by valence (needs scipy).

    python -m proofs.certify_limit_factors [LAST_VALENCE]

Claim: on an extraordinary facet with limit vertices, ‖L̂ - S‖ ≤ factor · M for every net of that valence.

Proof. ``certificates`` has the tiles and the bounds of their Bernstein coefficients. The rest after the last tile, [0,
2⁻ᵐ]², is a facet of its own at level m: there ‖L̂ - S‖ ≤ max over its corners of ‖L̂ - L̂ᵐ‖ (a difference of bilinear
functions) + the published bound of level m with the corners' way to the limit (``norm_bounds``), which has shrunk by
then.
"""

from __future__ import annotations

import sys

from ccdepth_addon.core.arrays.types import FloatArray
from ccdepth_addon.core.bounds.norm_bounds import (
    LAST_CERTIFIED_VALENCE,
    certified_limit_factor,
    limit_displacement,
    published_divisor,
    published_rate,
)
from ccdepth_addon.core.surface.limit_positions import limit_positions
from ccdepth_addon.core.surface.stencils import stencil_patch
from proofs.certificates import Certifier, bernstein, facet_corner, facet_over_tile, split, tiles

TILED_LEVELS = 14
SPLITS = (3, 1)  # how often the tiles of the first levels are halved both ways; the others stay whole


def certify(valence: int, claim: float) -> float:
    """A proved bound on ‖L̂ - S‖/M over all nets of a valence, ``claim`` if that can be proved."""
    patch = stencil_patch(valence)
    certifier = Certifier.of(valence)
    facet = limit_positions(patch)[patch.corner_vertices[:4]]
    proved = claim
    for level, tile, found in tiles(patch, TILED_LEVELS):
        if tile:
            pieces = (bernstein(found) - facet_over_tile(facet, level, tile))[None]
            for _ in range(SPLITS[level - 1] if level <= len(SPLITS) else 0):
                pieces = split(pieces)
            proved = max(proved, certifier.largest(pieces, claim))
        else:
            proved = max(proved, last_facet_bound(valence, certifier, facet, found, level))
    return proved


def last_facet_bound(valence: int, certifier: Certifier, facet: FloatArray, corners: FloatArray, level: int) -> float:
    """The bound on [0, 2⁻ᵐ]², see the module's docstring; corners: (4, 2n + 8) limit positions of its corners."""
    apart = certifier.largest(facet_corner(facet, level) - corners, 0.0)
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
