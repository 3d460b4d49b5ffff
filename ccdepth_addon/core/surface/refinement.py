# SPDX-License-Identifier: GPL-3.0-or-later
"""Feature-adaptive refinement: the descendants of some faces, level by level, with the neighbours they need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import corners_of_faces, joined_meshes, submesh
from .catmull_clark import subdivide
from .limit_positions import limit_positions
from .new_vertices import limits_of_new_vertices


@dataclass
class Refinement:
    """Descendants of base faces at one level.

    mesh: the descendants, its first faces, then all the other faces around their corners. bases: (descendants,) intp,
    the base face of each. origins: (descendants, 3) float64, the limit positions at their corners 0; None if unknown,
    or if some descendants come from n-gons. limits: ``limits_at_corners``; None until they are asked for.
    """

    mesh: PolygonMesh
    bases: IndexArray
    origins: FloatArray | None = None
    limits: FloatArray | None = None

    @staticmethod
    def start(mesh: PolygonMesh, faces: IndexArray) -> Refinement:
        """The faces themselves, each its own base: base b is ``faces[b]``."""
        return Refinement(submesh(mesh, faces)[0], np.arange(len(faces)))

    @staticmethod
    def joined(parts: Sequence[Refinement]) -> Refinement:
        """The descendants of several, one after the other, each its own base."""
        counts = [len(each.bases) for each in parts]
        mesh = joined_meshes([each.mesh for each in parts], counts)
        origins, limits = ([each.origins for each in parts], [each.limits for each in parts])
        return Refinement(mesh, np.arange(sum(counts)), _joined_if_known(origins), _joined_if_known(limits))

    def keep(self, wanted: BoolArray) -> Refinement:
        """The wanted descendants alone: (descendants,) bool."""
        if np.all(wanted):
            return self
        kept = np.flatnonzero(wanted)
        origins = None if self.origins is None else self.origins[kept]
        limits = None if self.limits is None else self.limits[corners_of_faces(self.mesh, kept)]
        return Refinement(submesh(self.mesh, kept)[0], self.bases[kept], origins, limits)

    def of(self, wanted: BoolArray) -> Refinement:
        """The descendants of wanted base faces: (base faces,) bool."""
        return self.keep(wanted[self.bases])

    def refined(self) -> Refinement:
        """The children of the descendants at the next level; a face's children are in the order of its corners."""
        if not len(self.bases):
            return self
        bases = np.repeat(self.bases, self.mesh.face_sizes[: len(self.bases)])
        return Refinement(subdivide(self.mesh), bases, self.limits if self.are_quads else None)

    def numbered(self) -> Refinement:
        """The refinement with each descendant as its own base."""
        return replace(self, bases=np.arange(len(self.bases)))

    def corner_vertices(self) -> IndexArray:
        """(C,) intp, the vertices at the corners of the descendants, face by face."""
        return self.mesh.corner_vertices[: self.mesh.face_starts[len(self.bases)]]

    @property
    def limits_at_corners(self) -> FloatArray:
        """(C, 3) float64, the limit positions of the vertices at the descendants' corners, computed once."""
        if self.limits is None:
            # No cached_property: before Python 3.12 one thread would wait for the other's.
            self.limits = self._find_limits()
        return self.limits

    def _find_limits(self) -> FloatArray:
        if self.origins is not None:
            new = limits_of_new_vertices(self.mesh, len(self.bases))
            return np.concatenate([self.origins[:, None], new], axis=1).reshape(-1, 3)
        vertices = self.corner_vertices()
        wanted = mask(self.mesh.vertex_count, vertices)
        return limit_positions(self.mesh, wanted)[vertices]

    @property
    def are_quads(self) -> bool:
        """Whether all descendants are."""
        return bool(np.all(self.mesh.face_sizes[: len(self.bases)] == 4))

    def limits_inside(self) -> tuple[FloatArray, FloatArray]:
        """(C, 3) twice: the limit positions of the middle of each side and of the centre of its face."""
        children = self.refined()
        if self.are_quads:
            new = limits_of_new_vertices(children.mesh, len(children.bases))
            return new[:, 0], new[:, 1]
        corners = children.limits_at_corners.reshape(-1, 4, 3)
        return corners[:, 1], corners[:, 2]

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


def _joined_if_known(parts: Sequence[FloatArray | None]) -> FloatArray | None:
    """The arrays, one after the other; None if one of them is unknown."""
    known = [each for each in parts if each is not None]
    return np.concatenate(known) if len(known) == len(parts) else None
