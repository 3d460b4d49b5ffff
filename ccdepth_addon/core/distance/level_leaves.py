# SPDX-License-Identifier: GPL-3.0-or-later
"""The quads that a level divides some faces into, with those around them, as far as nothing simpler bounds them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arrays.chunks import index_chunks
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..mesh.polygon_mesh import PolygonMesh
from ..surface.patches import PatchKind, classify_patches
from ..surface.refinement import Refinement
from .face_feet import FaceFeet
from .leaf_distances import QUADS_AT_ONCE, Leaves
from .level_quads import turned_children

# Rings of leaves around those that are asked for: two on which places in the shell have to be known, and one more that
# gives these the triangles around.
RINGS = 3

# What is regular is divided into leaves no more often than this; where a level is farther, only this often, as smaller
# parts may have feet.
DEEPEST_REGULAR, REGULAR_TRIES = 5, 2


@dataclass(frozen=True)
class LevelLeaves:
    """Leaves of B faces at a level, with the leaves around these. bases: (K,) intp, the face of each, B for one around.
    is_own: (K,) bool, leaves of the faces that no bound of a larger part covers. bounds: (B,), of the parts that are
    covered."""

    leaves: Leaves
    bases: IndexArray
    is_own: BoolArray
    bounds: FloatArray

    @staticmethod
    def of(
        mesh: PolygonMesh, faces: IndexArray, level: int, vertices: Vertices, limit: float, tick: Callable[[], None]
    ) -> LevelLeaves:
        """Of some faces of a mesh. limit: no larger distance is of use. At level 0 faces have to be quads."""
        count = len(faces)
        around = _rings(mesh, _mask(mesh.face_count, faces), RINGS)
        around[faces] = False
        if level == 0:
            around &= mesh.face_sizes == 4
        refinement = Refinement.start(mesh, np.concatenate([faces, np.flatnonzero(around)]))
        bases = np.minimum(np.arange(len(refinement.bases)), count)
        is_own, is_turned = bases < count, np.zeros(len(bases), dtype=bool)
        regular_since = np.zeros(len(bases), dtype=np.intp)
        bounds = np.zeros(count)
        for own_level in range(level + 1):
            is_regular = _are_regular(refinement, is_own)
            feet = FaceFeet.of(refinement.mesh.changed(axes=mesh.axes), vertices, is_turned, tick)
            for found in feet.bounds(np.flatnonzero(is_regular), level - own_level, vertices, limit, tick):
                covered = found.faces[found.are_short]
                np.maximum.at(bounds, bases[covered], found.bounds[found.are_short])
                is_own[covered] = is_regular[covered] = False
                bounds[bases[found.faces[(found.bounds > limit) & ~found.is_open]]] = np.inf
            regular_since[~is_regular] = own_level + 1
            is_given_up = (regular_since == own_level - REGULAR_TRIES) & (level - regular_since > DEEPEST_REGULAR)
            bounds[bases[is_given_up]] = np.inf
            is_own &= np.isfinite(np.append(bounds, 0.0))[bases]
            reach = _rings(refinement.mesh, is_own, RINGS)
            refinement = refinement.keep(reach)
            bases, regular_since = bases[reach], regular_since[reach]
            is_own, is_turned = is_own[reach], is_turned[reach]
            tick()
            if own_level == level or not len(bases):
                break
            sizes = refinement.mesh.face_sizes[: len(bases)]
            is_turned = turned_children(is_turned, sizes)
            bases, regular_since = np.repeat(bases, sizes), np.repeat(regular_since, sizes)
            is_own = np.repeat(is_own, sizes)
            refinement = refinement.refined()
        leaves = Leaves.of(refinement, is_turned, vertices, limit, mesh.axes)
        leaves.shell.ranges[np.repeat(leaves.is_folded, 2)] = 0.0
        return LevelLeaves(leaves, bases, is_own, bounds)

    def own_distances(self, tick: Callable[[], None]) -> FloatArray:
        """(B,): the largest bound of each face's leaves, infinite where one has none."""
        found = self.bounds.copy()
        is_regular = _are_regular(self.leaves.refinement, self.is_own)
        # Irregular ones are the worst, mostly: where they are not within the limit, nothing else needs to be.
        for own in (np.flatnonzero(self.is_own & ~is_regular), np.flatnonzero(is_regular)):
            for some in index_chunks(own, QUADS_AT_ONCE):
                left = some[np.isfinite(found[self.bases[some]])]
                np.maximum.at(found, self.bases[left], np.minimum(*self.leaves.distances(left, tick)))
        return found

    def joined_distances(self, tick: Callable[[], None]) -> FloatArray:
        """(B,): the same, but bounds by places in the shell count only where all leaves around have one: then what is
        found holds both ways, whatever else is known of the faces around."""
        mesh, count = self.leaves.refinement.mesh, len(self.bases)
        looked_at = _rings(mesh, self.is_own, 2)
        quads = np.flatnonzero(looked_at)
        by_places, at_equal = np.full((2, count), np.inf)
        by_places[quads], at_equal[quads] = self.leaves.distances(quads, tick)
        is_alone = _rings(mesh, looked_at & ~np.isfinite(by_places), 2)
        own = np.flatnonzero(self.is_own)
        again = own[is_alone[own] & np.isfinite(by_places[own])]
        at_equal[again] = self.leaves.at_equal_parameters(again)
        bounds = np.where(is_alone, at_equal, np.minimum(by_places, at_equal))
        found = self.bounds.copy()
        np.maximum.at(found, self.bases[own], bounds[own])
        return found


def _mask(count: int, chosen: IndexArray) -> BoolArray:
    mask = np.zeros(count, dtype=bool)
    mask[chosen] = True
    return mask


def _rings(mesh: PolygonMesh, wanted: BoolArray, rings: int) -> BoolArray:
    """(n,) bool: wanted ones (n,) of the first n faces, and so many rings around them."""
    for _ in range(rings):
        wanted = _touching(mesh, wanted)
    return wanted


def _touching(mesh: PolygonMesh, wanted: BoolArray) -> BoolArray:
    """(n,) bool: those of the first n faces that share a vertex with wanted ones (n,), and these."""
    last = mesh.face_starts[len(wanted)]
    vertices, faces = mesh.corner_vertices[:last], mesh.corner_faces[:last]
    touched = _mask(mesh.vertex_count, vertices[wanted[faces]])
    return np.logical_or.reduceat(touched[vertices], mesh.face_starts[: len(wanted)]) if len(wanted) else wanted


def _are_regular(refinement: Refinement, is_own: BoolArray) -> BoolArray:
    """(K,) bool: the own faces that are regular."""
    return is_own & (classify_patches(refinement.mesh).kinds[: len(is_own)] == PatchKind.REGULAR)
