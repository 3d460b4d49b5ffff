# SPDX-License-Identifier: GPL-3.0-or-later
"""The proofs of a mesh that hold of the next mesh, measured against the same surface, with many of the same triangles.

docs/deviation.md, One mesh after the other.
"""

from __future__ import annotations

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from .bezier_pieces import BezierPieces
from .box_tree import BoxTree, overlapping
from .mesh_to_surface import MeshToSurface
from .spread import NONE
from .triangles import places_among


class KeptProofs:
    """The proofs of the last of several meshes measured against one surface, none before the first.

    origin: (3,) float64, of the coordinates of all meshes; pieces: of the surface; last: the search that ended with the
    proofs. All are None before the first mesh.
    """

    def __init__(self) -> None:
        self.origin: FloatArray | None = None
        self.pieces: BezierPieces | None = None
        self.last: MeshToSurface | None = None

    def keep(self, search: MeshToSurface, origin: FloatArray) -> None:
        """Replace all proofs by those of a finished search."""
        self.last, self.pieces, self.origin = search, search.surface.pieces, origin

    def take(self, search: MeshToSurface) -> tuple[IndexArray, IndexArray]:
        """Give a search both ways, of the same pieces, the proofs that hold of its mesh, too, and are good enough;
        returns the pieces and the triangles left to bound."""
        surface, leaves = search.surface, search.surface.pieces.leaves()
        if self.last is None:
            return leaves, np.arange(search.mesh.count)
        last, enough = self.last, search.findings.enough
        places = places_among(last.mesh.rows, search.mesh.rows)
        holds = (places != NONE) & (last.upper <= enough)
        search.upper[places[holds]] = last.upper[holds]
        triangles = places[last.surface.triangles[leaves]]
        known = np.flatnonzero((triangles != NONE) & (last.surface.upper[leaves] <= enough))
        known = known[~_are_near(last, leaves[known], np.flatnonzero(places == NONE))]
        surface.upper[leaves[known]] = last.surface.upper[leaves[known]]
        surface.triangles[leaves[known]] = triangles[known]
        return np.delete(leaves, known), np.setdiff1d(np.arange(search.mesh.count), places[holds])


def _are_near(last: MeshToSurface, pieces: IndexArray, triangles: IndexArray) -> BoolArray:
    """(n,) bool: whether some of the triangles of a finished search may be as near to a point of a piece (n,) as the
    piece's bound."""
    found = np.zeros(len(pieces), dtype=bool)
    if len(pieces) and len(triangles):
        surface, corners = last.surface, last.mesh.points[:, triangles]
        reach = (surface.upper[pieces] * surface.pieces.greatest[pieces] + surface.findings.margin)[:, None]
        around = BoxTree.around(surface.pieces.low[pieces] - reach, surface.pieces.high[pieces] + reach)
        found[overlapping(around, BoxTree.around(corners.min(axis=0), corners.max(axis=0)))[0]] = True
    return found
