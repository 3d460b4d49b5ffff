# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances of triangles of the control mesh from the surface, by the nets of their quarters.

docs/adaptive.md (Triangles on the surface) has the derivation.

A quarter has a corner of the triangle's, of whatever valence, and the centroid, of valence 3; the others are of
valence 4. Where all around is smooth and inside the surface, S is a known function of its net (``stencils``): bicubic
but for a last square at either of the two. A bilinear facet F is linear in its corners. So S - F is linear in both,
and a matrix for each valence bounds it over all quarters at once. Other quarters are refined (``irregular_bounds``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...arrays.chunks import index_chunks
from ...arrays.types import BoolArray, FloatArray, IndexArray
from ...arrays.vectors import selected_vectors
from ...bounds.norm_bounds import certified_limit_factor
from ...surface.bicubic import FACET_ROWS
from ...surface.patches import classify_patches
from ...surface.refinement import Refinement
from ...surface.stencils import LARGEST_STENCIL_VALENCE, patch_stencils, quad_nets
from .triangle_bounds import (
    ExtraordinaryRows,
    LastSquare,
    differences_at_vertex,
    extraordinary_distances,
    quad_pieces,
    square_at,
)

# Quarters evaluated together: temporary arrays stay in cache.
QUARTERS_AT_ONCE = 1 << 8


@lru_cache(maxsize=LARGEST_STENCIL_VALENCE)
def _quarter_rows(valence: int) -> ExtraordinaryRows:
    """For nets around a vertex of this valence: S - F over a quarter, as functionals of the net's points and then of
    the corners of F. Over the last squares at the vertex and at the centroid B - F is bilinear."""
    pieces = quad_pieces((valence, 4, 3, 4))
    bicubic = [np.hstack([surface, -FACET_ROWS @ _at_corners(path)]) for path, surface in pieces.bicubic]
    last = []
    for path, own, net in pieces.last:
        corners = np.hstack([patch_stencils(own).limits @ net, -_at_corners(path)])
        differences = differences_at_vertex(own, net)
        with_facet = np.hstack([differences, np.zeros((len(differences), 4))])
        last.append(LastSquare(corners, with_facet, certified_limit_factor(own)))
    return ExtraordinaryRows(np.concatenate(bicubic), last)


def _at_corners(path: int) -> FloatArray:
    """(4, 4): from the corners of a bilinear facet to its points at the corners of the square at a path."""
    u, v = square_at(path).corners().T
    return np.stack([(1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v], axis=1)


@dataclass(frozen=True)
class QuarterNets:
    """The nets of quarters of P triangles, numbered triangle by triangle. is_known: (P,) bool, the triangles whose
    three quarters have nets. valences: of the vertices there are; and for each the quarters (m,), ascending, and their
    nets (N, m, 3)."""

    is_known: BoolArray
    valences: Sequence[int]
    quarters: Sequence[IndexArray]
    nets: Sequence[FloatArray]

    @staticmethod
    def of(refinement: Refinement) -> QuarterNets:
        """refinement: of the quarters, with the faces around them."""
        mesh, count = refinement.mesh, len(refinement.bases)
        around = mesh.vertex_face_counts[mesh.corner_vertices[mesh.face_starts[:count]]]
        is_inside = classify_patches(mesh).inside[:count] & (around <= LARGEST_STENCIL_VALENCE)
        is_known = np.logical_and.reduce(is_inside.reshape(-1, 3), axis=1)
        with_nets = np.repeat(is_known, 3)
        valences = np.unique(around[with_nets]).tolist()
        quarters = [np.flatnonzero(with_nets & (around == valence)) for valence in valences]
        nets = [
            quad_nets(mesh, mesh.face_starts[own], (valence, 4, 3, 4))
            for valence, own in zip(valences, quarters, strict=True)
        ]
        return QuarterNets(is_known, valences, quarters, nets)

    def distances(self, chosen: IndexArray, facets: FloatArray) -> FloatArray:
        """(C,): upper bounds of ‖S - F‖ over chosen quarters (C,), ascending, whose triangles are known, for bilinear
        facets over their corners (4, C, 3)."""
        found = np.empty(len(chosen))
        for valence, quarters, nets in zip(self.valences, self.quarters, self.nets, strict=True):
            own = np.flatnonzero(np.isin(chosen, quarters, assume_unique=True))
            for block in index_chunks(own, QUARTERS_AT_ONCE):
                of_block = selected_vectors(nets, np.searchsorted(quarters, chosen[block]))
                given = np.concatenate([of_block, selected_vectors(facets, block)])
                found[block] = extraordinary_distances(_quarter_rows(valence), given)
        return found
