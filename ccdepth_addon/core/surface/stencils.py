# SPDX-License-Identifier: GPL-3.0-or-later
"""Stencils of extraordinary patches: every refined point is a fixed combination of the net's 2n + 8 points.

The matrices come from one Catmull-Clark step of a patch whose vertices are the unit vectors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ..arrays.matrix_products import matrix_product
from ..arrays.types import BoolArray, FloatArray, IndexArray
from ..mesh.polygon_mesh import PolygonMesh, polygon_mesh
from .catmull_clark import subdivide
from .limit_positions import limit_positions
from .patches import PatchKind, PatchKinds, extraordinary_nets, regular_nets, ring_index

# Computing the stencils of a valence takes time proportional to its cube; beyond this, refining the mesh is faster.
LARGEST_STENCIL_VALENCE = 64


def stencil_patch(valence: int) -> PolygonMesh:
    """The faces of an extraordinary net of 2n + 8 points, vertex i at the i-th unit vector.

    Every position of a refinement is then its stencil on the net. Face 0 is the facet, from its extraordinary vertex
    on.
    """
    n = valence

    def ring(number: int) -> int:
        return ring_index(n, number)

    o2, o3, o4, o5, o6, o7, o8 = range(2 * n + 1, 2 * n + 8)
    around = [[0, ring(2 * i + 2), ring(2 * i + 1), ring(2 * i)] for i in range(2, n + 2)]
    outer = [
        [ring(6), o4, o3, ring(5)],
        [ring(5), o3, o2, o6],
        [ring(4), ring(5), o6, o7],
        [ring(3), ring(4), o7, o8],
        [ring(7), o5, o4, ring(6)],
    ]
    corners = np.array(around + outer).reshape(-1)
    patch = polygon_mesh(np.eye(2 * n + 8), np.full(n + 5, 4), corners)
    # The border of the net is no boundary of the surface.
    return replace(patch, sharpness_is_explicit=True)


@dataclass(frozen=True)
class PatchStencils:
    """Matrices for the nets of one valence.

    refined: (2n + 8, 2n + 8), the net of the child at the extraordinary vertex. regular: (3 · 16, 2n + 8), the nets of
    the children at V₆, V₅ and V₄. limits: (4, 2n + 8), the limit positions of the facet's corners.
    """

    refined: FloatArray
    regular: FloatArray
    limits: FloatArray


@lru_cache(maxsize=64)
def patch_stencils(valence: int) -> PatchStencils:
    """The matrices for a valence of 3, 5 or more."""
    patch = stencil_patch(valence)
    children = subdivide(patch)
    size = 2 * valence + 8
    return PatchStencils(
        refined=extraordinary_nets(children, np.array([0]), valence).reshape(size, size),
        regular=regular_nets(children, np.array([1, 2, 3])).reshape(16, 3, size).swapaxes(0, 1).reshape(48, size),
        limits=limit_positions(patch)[patch.corner_vertices[:4]],
    )


def child_at_vertex(nets: FloatArray) -> FloatArray:
    """(2n + 8, P, D): the nets of the children at the extraordinary vertices of nets (2n + 8, P, D)."""
    return matrix_product(patch_stencils(valence_of(nets)).refined, nets)


def regular_children(nets: FloatArray) -> FloatArray:
    """(4, 4, 3P, D): the nets of the other children, child after child, at V₆, V₅ and V₄."""
    children = matrix_product(patch_stencils(valence_of(nets)).regular, nets).reshape(3, 16, *nets.shape[1:])
    return children.swapaxes(0, 1).reshape(4, 4, -1, nets.shape[2])


def valence_of(nets: FloatArray) -> int:
    """The valence n of nets (2n + 8, P, D)."""
    return (len(nets) - 8) // 2


def by_valence(
    mesh: PolygonMesh, faces: IndexArray, kinds: PatchKinds, largest: int | None = None
) -> tuple[IndexArray, list[tuple[int, IndexArray, IndexArray]], BoolArray]:
    """Which of the faces (n,) are regular, by index; valence by valence up to a largest one, by default
    ``LARGEST_STENCIL_VALENCE``, which are extraordinary, and their extraordinary corners; and (n,) bool, the rest."""
    largest = LARGEST_STENCIL_VALENCE if largest is None else largest
    own, corners = kinds.kinds[faces], kinds.extraordinary_corners[faces]
    valences = mesh.vertex_face_counts[mesh.corner_vertices[corners]]
    is_small = (own == PatchKind.EXTRAORDINARY) & (valences <= largest)
    extraordinary = []
    for valence in np.unique(valences[is_small]).tolist():
        chosen = np.flatnonzero(is_small & (valences == valence))
        extraordinary.append((valence, chosen, corners[chosen]))
    return np.flatnonzero(own == PatchKind.REGULAR), extraordinary, ~is_small & (own != PatchKind.REGULAR)
