# SPDX-License-Identifier: GPL-3.0-or-later
"""The quads of some faces at a level, with the quads around them, as far as no simpler bound covers them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays.masks import mask
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..bounds.norm_bounds import Vertices
from ..deviation.leaf_deviations import DrawnLeaves
from ..distance.face_feet import FaceFeet
from ..mesh.level_quads import turned_children
from ..mesh.polygon_mesh import PolygonMesh
from ..mesh.submesh import rings_around
from ..surface.patches import PatchKind, classify_patches
from ..surface.refinement import Refinement

# The number of rings of leaves around the wanted leaves: one ring where the surface counts as well, and one more for
# the triangles around.
RINGS = 2

# Regular parts are divided into leaves up to this number of times; if the level is farther away, up to the smaller
# number, as smaller parts may have feet.
DEEPEST_REGULAR, REGULAR_TRIES = 5, 2


@dataclass(frozen=True)
class LevelLeaves:
    """Leaves of B faces at a level, with the leaves around them. bases: (K,) intp, the face of each, B for a leaf
    around. is_own: (K,) bool, leaves of the faces without a bound of a larger part. bounds: (B,), of the larger
    parts."""

    leaves: DrawnLeaves
    bases: IndexArray
    is_own: BoolArray
    bounds: FloatArray

    @staticmethod
    def of(
        mesh: PolygonMesh, faces: IndexArray, level: int, vertices: Vertices, limit: float, most: int
    ) -> LevelLeaves | None:
        """The leaves of some faces of a mesh; None if several faces have more leaves than ``most``, with those around.
        limit: the largest useful distance. At level 0 faces have to be quads."""
        count = len(faces)
        around = rings_around(mesh, mask(mesh.face_count, faces), RINGS)
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
            near = rings_around(refinement.mesh, is_regular, 1)
            feet = FaceFeet.of(refinement.mesh.changed(axes=mesh.axes), vertices, is_turned, lambda: None, near)
            left = level - own_level
            for found in feet.bounds(
                np.flatnonzero(is_regular), left, vertices, limit, lambda: None, are_divided=left == 0
            ):
                covered = found.faces[found.are_short]
                np.maximum.at(bounds, bases[covered], found.bounds[found.are_short])
                is_own[covered] = is_regular[covered] = False
                bounds[bases[found.faces[(found.bounds > limit) & ~found.is_open]]] = np.inf
            regular_since[~is_regular] = own_level + 1
            is_given_up = (regular_since == own_level - REGULAR_TRIES) & (level - regular_since > DEEPEST_REGULAR)
            bounds[bases[is_given_up]] = np.inf
            is_own &= np.isfinite(np.append(bounds, 0.0))[bases]
            reach = rings_around(refinement.mesh, is_own, RINGS)
            refinement = refinement.keep(reach)
            bases, regular_since = bases[reach], regular_since[reach]
            is_own, is_turned = is_own[reach], is_turned[reach]
            if len(bases) > most and count > 1:
                return None
            if own_level == level or not len(bases):
                break
            sizes = refinement.mesh.face_sizes[: len(bases)]
            is_turned = turned_children(is_turned, sizes)
            bases, regular_since = np.repeat(bases, sizes), np.repeat(regular_since, sizes)
            is_own = np.repeat(is_own, sizes)
            refinement = refinement.refined()
        leaves = DrawnLeaves.of(refinement, is_turned, vertices, mesh.axes)
        return LevelLeaves(leaves, bases, is_own, bounds)


def _are_regular(refinement: Refinement, is_own: BoolArray) -> BoolArray:
    """(K,) bool: the own faces that are regular."""
    return is_own & (classify_patches(refinement.mesh).kinds[: len(is_own)] == PatchKind.REGULAR)
