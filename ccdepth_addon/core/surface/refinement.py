# SPDX-License-Identifier: GPL-3.0-or-later
"""Feature-adaptive refinement: the descendants of some faces, level by level, with the neighbours they need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import submesh
from .catmull_clark import subdivide
from .limit_positions import limit_positions


@dataclass(frozen=True)
class Refinement:
    """Descendants of base faces at one level.

    mesh: the descendants, its first faces, then all the other faces around their corners.
    bases: (descendants,) intp, the base face of each.
    """

    mesh: PolygonMesh
    bases: IndexArray

    @staticmethod
    def start(mesh: PolygonMesh, faces: IndexArray) -> Refinement:
        """The faces themselves, each its own base: base b is ``faces[b]``."""
        return Refinement(submesh(mesh, faces)[0], np.arange(len(faces)))

    def keep(self, wanted: BoolArray) -> Refinement:
        """The wanted descendants alone: (descendants,) bool."""
        if np.all(wanted):
            return self
        kept = np.flatnonzero(wanted)
        return Refinement(submesh(self.mesh, kept)[0], self.bases[kept])

    def of(self, wanted: BoolArray) -> Refinement:
        """The descendants of wanted base faces: (base faces,) bool."""
        return self.keep(wanted[self.bases])

    def refined(self) -> Refinement:
        """Their children at the next level; a face's children are in the order of its corners."""
        if not len(self.bases):
            return self
        bases = np.repeat(self.bases, self.mesh.face_sizes[: len(self.bases)])
        return Refinement(subdivide(self.mesh).mesh, bases)

    def numbered(self) -> Refinement:
        """The same, each descendant its own base."""
        return Refinement(self.mesh, np.arange(len(self.bases)))

    def corner_vertices(self) -> IndexArray:
        """(C,) intp, the vertices at the corners of the descendants, face by face."""
        return self.mesh.corner_vertices[: self.mesh.face_starts[len(self.bases)]]

    def limits_at_corners(self) -> FloatArray:
        """(C, 3) float64, the limit positions of those vertices."""
        vertices = self.corner_vertices()
        wanted = np.zeros(self.mesh.vertex_count, dtype=bool)
        wanted[vertices] = True
        return limit_positions(self.mesh, wanted)[vertices]

    def limits_inside(self) -> tuple[FloatArray, FloatArray]:
        """(C, 3) twice: the limit positions of the middle of each side and of the centre of its face."""
        corners = self.refined().limits_at_corners().reshape(-1, 4, 3)
        return corners[:, 1], corners[:, 2]

    def control_facets(self) -> FloatArray:
        """(4, descendants, 3): the control points at the corners of the descendants, all of them quads."""
        return self.mesh.positions[self.corner_vertices()].reshape(-1, 4, 3).swapaxes(0, 1)

    def facets_of_children(self, facets: FloatArray) -> FloatArray:
        """(4, C, 3): the bilinear facet of each descendant, given at its corners (C, 3), restricted to its children.

        An n-gon's facet is the fan of quads over corner, edge midpoint, centroid and edge midpoint.
        """
        count = len(self.bases)
        following, before = self.mesh.next_corner[: len(facets)], self.mesh.previous_corner[: len(facets)]
        sizes = self.mesh.face_sizes[:count]
        centroids = np.add.reduceat(facets, self.mesh.face_starts[:count]) / sizes[:, None]
        middles = (facets + facets[following]) / 2
        return np.stack([facets, middles, np.repeat(centroids, sizes, axis=0), middles[before]])
